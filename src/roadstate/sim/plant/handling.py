"""What the cornering compliances of a plant's axles are made of, and how they become the vehicle file's."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from roadstate.core.constants import GRAVITY
from roadstate.sim.plant.chassis import Chassis
from roadstate.sim.plant.figures import PlantFigures
from roadstate.sim.plant.suspension import Suspension
from roadstate.sim.plant.tire_figures import corner_loads, tires_per_corner
from roadstate.tires.base import as_leaf
from roadstate.tires.magic_formula import MagicFormula
from roadstate.vehicles.parameters import Vehicle

_SMALL = 1e-4  # rad
_SPEED = 20.0  # m/s
# N·m/rad per kg of the vehicle: the range of the steering's stiffness
_SOFTEST, _STIFFEST = 2.0, 60.0
_ROUNDS = 12


class Linear(NamedTuple):
    """Front and rear axle, (2,) each, at small angles and static load; axes of ISO 8855.

    Attributes:
        cornering: ∂F_y/∂α, N/rad.
        thrust: −∂F_y/∂γ, N/rad: a wheel that leans to the right pulls there.
        returning: −∂M_z/∂α, N·m/rad.
        twisting: ∂M_z/∂γ, N·m/rad.
        camber: γ per lateral acceleration, rad/(m/s²).
    """

    cornering: np.ndarray
    thrust: np.ndarray
    returning: np.ndarray
    twisting: np.ndarray
    camber: np.ndarray


class Compliance(NamedTuple):
    """Angles per lateral acceleration, rad/(m/s²).

    Attributes:
        slip_front, slip_rear: the axles' slip angles.
        steering_moment: of the front wheels about their steering axes, N·m/(m/s²): over the stiffness of the
            steering it is the angle that the front wheels lose.
    """

    slip_front: float
    slip_rear: float
    steering_moment: float

    def understeer(self, stiffness: float) -> float:
        """Understeer gradient, rad/(m/s²), on a steering of a stiffness in N·m/rad."""
        return self.slip_front + self.steering_moment / stiffness - self.slip_rear


def linear(
    vehicle: Vehicle, figures: PlantFigures, tire: MagicFormula, chassis: Chassis, suspension: Suspension,
    vertical: float,
) -> Linear:  # fmt: skip
    """Slopes of tires and body at small lateral accelerations.

    The body rolls on springs and bars by l(1 + gφ)/Σk, l being its mass times its height over the roll axis
    and φ its roll in sum, and with the axles on their tires. Wheels lean with the body but for what the
    camber per travel takes back, which of a rigid axle is all.

    Args:
        vehicle: the file.
        figures: completed ones.
        tire, chassis, suspension: of the plant.
        vertical: stiffness of one tire, N/m.
    """
    g, count = vehicle.geometry, tires_per_corner(vehicle)[[0, 2]]
    loads = corner_loads(vehicle)[[0, 2]] / count
    small = _SMALL * np.eye(3)[:, :2, None]  # by slip angle, by camber, neither
    force = np.asarray(tire.forces(0.0, small[:, 0], loads, 1.0, _SPEED, camber=small[:, 1]).F_y)
    moment = np.asarray(tire.moments(0.0, small[:, 0], loads, 1.0, _SPEED, camber=small[:, 1]).M_z)
    by_force, by_moment = (2 * count * (a[:2] - a[2]) / _SMALL for a in (force, moment))

    track = np.array([g.track_front, g.track_rear])
    centre = np.array([figures.front.roll_centre_height, figures.rear.roll_centre_height])
    springs, bars = (np.asarray(a)[[0, 2]] for a in (suspension.stiffness, suspension.bar_stiffness))
    stiffness = (0.5 * springs + bars) * track**2
    share = np.array([g.cg_to_rear_axle, g.cg_to_front_axle]) / vehicle.wheelbase
    sprung = float(chassis.masses[0])
    lever = sprung * (g.cg_height + float(chassis.places[2, 0]) - share @ centre)
    hub, unsprung = (np.asarray(a)[[1, 3]] for a in (g.cg_height + chassis.places[2], 2 * chassis.masses))
    rolled = 0.0
    for _ in range(_ROUNDS):
        felt = 1 + GRAVITY * rolled
        on_springs = lever * felt / stiffness.sum()
        moment_on_tires = stiffness * on_springs + share * sprung * centre * felt + unsprung * hub
        on_tires = moment_on_tires / (0.5 * vertical * count * track**2)
        rolled = on_springs + float(share @ on_tires)
    upright = 0.5 * track * np.abs(np.asarray(chassis.carrier_turn)[0, [0, 2]])
    camber = rolled - (rolled - on_tires) * upright
    return Linear(by_force[0], -by_force[1], -by_moment[0], by_moment[1], camber)


def compliance(vehicle: Vehicle, axles: Linear, caster: float, hub: float) -> Compliance:
    """Slip angles and steering moment in steady turning, per lateral acceleration.

    From C_fα_f − N_fγ_f + C_rα_r − N_rγ_r = m and the moments about the centre of gravity, those of the tires
    included. About a steering axis that leans back act the tires' moment, the lateral force and, on a wheel
    that leans, its load.

    Args:
        vehicle: the file.
        axles: from :func:`linear`.
        caster: lean of the steering axis, rad.
        hub: height of the front wheel's centre, m.
    """
    g, C, N = vehicle.geometry, axles.cornering, axles.thrust
    arms = np.array([g.cg_to_front_axle, -g.cg_to_rear_axle])
    lean = axles.camber
    left = np.stack([C, arms * C - axles.returning])
    right = np.array([vehicle.mass + N @ lean, arms @ (N * lean) - axles.twisting @ lean])
    slips = np.linalg.solve(left, right)
    force = C[0] * slips[0] - N[0] * lean[0]
    about = axles.returning[0] * slips[0] - axles.twisting[0] * lean[0]
    load = vehicle.static_axle_loads[0]
    steering = np.cos(caster) * about + np.sin(caster) * hub * (force + load * lean[0])
    return Compliance(float(slips[0]), float(slips[1]), float(steering))


def matched(
    vehicle: Vehicle,
    figures: PlantFigures,
    tire: MagicFormula,
    chassis: Chassis,
    suspension: Suspension,
    vertical: float,
    *,
    as_measured: bool,
) -> tuple[MagicFormula, float]:
    """Tire and stiffness of the steering (N·m/rad) with which the axles are as soft as the vehicle file says.

    The rear axle by the tire's cornering stiffness, the front one by the steering's; if the front axle is too
    soft for that with the stiffest steering, the tire is made to match the understeer gradient.

    Args:
        vehicle: the file.
        figures: completed ones; a steering stiffness in them is kept.
        tire, chassis, suspension: of the plant.
        vertical: stiffness of one tire, N/m.
        as_measured: whether the tire stays as it is.
    """
    soft_front = 1 / (GRAVITY * vehicle.tires.cornering_stiffness_front)
    soft_rear = 1 / (GRAVITY * vehicle.tires.cornering_stiffness_rear)
    softest, stiffest = _SOFTEST * vehicle.mass, _STIFFEST * vehicle.mass
    hub = vehicle.geometry.cg_height + float(chassis.places[2, 1])
    kept = tire.coefficients["LKY"]
    factor, stiffness, gradient_only = 1.0, stiffest, False
    for _ in range(_ROUNDS):
        scaled = replace(tire, coefficients={**tire.coefficients, "LKY": as_leaf(factor * kept)})
        axles = linear(vehicle, figures, scaled, chassis, suspension, vertical)
        now = compliance(vehicle, axles, figures.steering.caster, hub)
        if figures.steering.stiffness is not None:
            stiffness = figures.steering.stiffness
        else:
            softer = soft_front - now.slip_front
            gradient_only = gradient_only or now.steering_moment > stiffest * softer
            stiffness = stiffest if gradient_only else now.steering_moment / softer
            stiffness = min(max(stiffness, softest), stiffest)
        if as_measured:
            return tire, stiffness
        wanted = now.slip_rear / soft_rear
        if gradient_only and now.understeer(stiffness) > 0 and soft_front > soft_rear:
            wanted = now.understeer(stiffness) / (soft_front - soft_rear)
        factor *= wanted
        if abs(wanted - 1) < 1e-6:
            break
    return scaled, stiffness
