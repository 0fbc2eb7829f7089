"""The world of the ideal filter of :mod:`benchmarks.accuracy.friction_bound`: its states and its equations.

States are errors about the truth: of the motion (v_x, v_y, r), of the sensors (biases b, gains γ, the
inertial unit's yaw ψ, the steering's offset and gain), of the road (grade θ, bank φ, their rates of
distance θ' and φ', ln μ of each piece of road) and of the car (ln m, ln I_z, ln h, ln R, rolling
resistance c_r, drag D, and of the plant's own Magic Formula the logarithms of its slip and cornering
stiffnesses and of its shape factors C_x and C_y). With the forces F(κ, α, F_z, μ) of the four wheels in
the car's axes

    v̇_x = (ΣF_x − D)/m + r v_y − g θ,   v̇_y = ΣF_y/m − r v_x − g φ,   ṙ = ΣM_z/I_z,

and measured are

    (1 + γ_x) a_x + b_x − ψ a_y,   (1 + γ_y) a_y + b_y + ψ a_x,   (1 + γ_r) r + b_r,
    v_x θ' + b_q and v_x φ' + b_p by the gyroscopes of pitch and roll,
    √(v_x² + v_y²) and v_x θ by the receiver,
    R F_x + c_r R F_z − γ_d T_d − b_d + γ_b T_b = T_d − T_b − I ω̇ at each wheel,

with a_x = (ΣF_x − D)/m and a_y = ΣF_y/m. The last is no equation of motion: a wheel finds its slip within a
sample, so it is the torques that tell F_x. Grade and bank change with distance as
:class:`roadstate.estimators.road.GradePrior` says, ln μ drifts with it, and biases walk with time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from benchmarks.accuracy.friction_truth import SLOWEST, Truth

from roadstate.core import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.estimators.road import GradePrior
from roadstate.estimators.sideways import BANK_LENGTH
from roadstate.tires.base import as_leaf
from roadstate.tires.magic_formula import MagicFormula
from roadstate.vehicles import Vehicle

STATES = (
    "velocity_x", "velocity_y", "yaw_rate",
    "accel_x_bias", "accel_y_bias", "yaw_rate_bias", "accel_x_gain", "accel_y_gain", "yaw_rate_gain",
    "pitch_rate_bias", "roll_rate_bias", "mounting_yaw", "steer_bias", "steer_gain",
    "grade", "grade_slope", "bank", "bank_slope",
    "mass", "yaw_inertia", "cg_height", "radius", "rolling_resistance", "drag",
    "slip_stiffness", "cornering_front", "cornering_rear", "shape_x", "shape_y",
    *(f"{what}_{w}" for what in ("drive_gain", "drive_bias", "brake_gain") for w in WHEELS),
    "friction_slippery", "friction_grippy",
)  # fmt: skip
SENSORS = (
    "accel_x", "accel_y", "yaw_rate", "pitch_rate", "roll_rate", "speed", "vertical_speed",
    *(f"torque_{w}" for w in WHEELS),
)  # fmt: skip
NOISES = (*(f"slip_{w}" for w in WHEELS), "steer")
"""Errors of what the forces are computed from, new at each sample."""
AXLE_FORCES = ("force_x_front", "force_x_rear", "force_y_front", "force_y_rear")
MOTION = 3
"""So many states at the beginning are the motion of the car."""
_FRONT = np.array([1.0, 1.0, 0.0, 0.0])
_LIGHTEST = 50.0  # N


class World(eqx.Module):
    """What the ideal filter knows of the car.

    Attributes:
        tire: of each wheel.
        place_x, place_y: (4,) of the wheels seen from the centre of gravity, m.
        mass, yaw_inertia, radius: kg, kg·m², m.
        load_x, load_y: (4,) change of each load per force on the car along and across, -.
        drag: over the square of the speed, N/(m/s)².
        grade, bank: how they change along the road.
    """

    tire: MagicFormula
    place_x: Any
    place_y: Any
    mass: Any
    yaw_inertia: Any
    radius: Any
    load_x: Any
    load_y: Any
    drag: Any
    grade: GradePrior
    bank: GradePrior


def world_of(vehicle: Vehicle, tire: MagicFormula) -> World:
    """Of a vehicle whose axles share the roll moment as they share the weight.

    Args:
        vehicle: that is driven.
        tire: the plant's.
    """
    g = vehicle.geometry
    side, axle = np.array([1.0, -1.0, 1.0, -1.0]), np.where(_FRONT > 0, 1.0, -1.0)
    track = np.where(_FRONT > 0, g.track_front, g.track_rear)
    share = np.where(_FRONT > 0, g.cg_to_rear_axle, g.cg_to_front_axle) / vehicle.wheelbase
    numbers = {
        "place_x": np.where(_FRONT > 0, g.cg_to_front_axle, -g.cg_to_rear_axle),
        "place_y": 0.5 * side * track,
        "mass": vehicle.mass,
        "yaw_inertia": vehicle.yaw_inertia,
        "radius": vehicle.wheels.radius,
        "load_x": -axle * g.cg_height / (2 * vehicle.wheelbase),
        "load_y": -side * share * g.cg_height / track,
        "drag": vehicle.drag_factor,
    }
    prior = vehicle.prior
    grade, bank = (
        GradePrior(as_leaf(std), as_leaf(length))
        for std, length in (
            (prior.grade_std, prior.grade_correlation_length),
            (prior.bank_std, BANK_LENGTH),
        )
    )
    leaves = {name: as_leaf(value) for name, value in numbers.items()}
    return World(tire=tire, grade=grade, bank=bank, **leaves)


class Slopes(NamedTuple):
    """Derivatives at the truth by states and by :data:`NOISES`, (…, n + 5) each.

    Attributes:
        motion: (3, n + 5) of the rates of change of the motion.
        sensors: (11, n + 5) of :data:`SENSORS`.
        axles: (4, n + 5) of :data:`AXLE_FORCES`, N.
    """

    motion: Any
    sensors: Any
    axles: Any


def slopes(world: World, truth: Truth) -> Slopes:
    """Of one sample.

    Args:
        world: the car.
        truth: scalars, and (4,) of the wheels.
    """
    at = jnp.zeros(len(STATES) + len(NOISES))
    return Slopes(*jax.jacfwd(lambda y: equations(world, truth, y))(at))


def equations(world: World, truth: Truth, errors: Any) -> tuple[Any, Any, Any]:
    """Rates of the motion (3,), what sensors read (11,) and axle forces (4,), see the module.

    Args:
        world: the car.
        truth: of one sample.
        errors: (n + 5,) of states and noises.
    """
    x = dict(zip((*STATES, *NOISES), errors, strict=True))
    v_x = jnp.maximum(truth.velocity_x, SLOWEST) + x["velocity_x"]
    v_y, r = truth.velocity_y + x["velocity_y"], truth.yaw_rate + x["yaw_rate"]
    steer = truth.steer + _FRONT * (x["steer_bias"] + x["steer"] + x["steer_gain"] * truth.steer)
    force = _forces(world, truth, x, (v_x, v_y, r), steer)
    cos, sin = jnp.cos(steer), jnp.sin(steer)
    along, across = force[0] * cos - force[1] * sin, force[0] * sin + force[1] * cos
    mass = world.mass * jnp.exp(x["mass"])
    drag = world.drag * truth.velocity_x**2 * (1 + x["drag"])
    a_x, a_y = (jnp.sum(along) - drag) / mass, jnp.sum(across) / mass
    yaw = jnp.sum(world.place_x * across - world.place_y * along)
    motion = jnp.stack(
        [
            a_x + r * v_y - GRAVITY * x["grade"],
            a_y - r * v_x - GRAVITY * x["bank"],
            yaw / (world.yaw_inertia * jnp.exp(x["yaw_inertia"])),
        ]
    )
    radius = world.radius * jnp.exp(x["radius"])
    per_wheel = {
        name: jnp.stack([x[f"{name}_{w}"] for w in WHEELS])
        for name in ("drive_gain", "drive_bias", "brake_gain")
    }
    torques = (
        radius * (force[0] + x["rolling_resistance"] * truth.load)
        - per_wheel["drive_gain"] * truth.drive_torque
        - per_wheel["drive_bias"]
        + per_wheel["brake_gain"] * truth.brake_torque
    )
    sensors = [
        (1 + x["accel_x_gain"]) * a_x + x["accel_x_bias"] - x["mounting_yaw"] * a_y,
        (1 + x["accel_y_gain"]) * a_y + x["accel_y_bias"] + x["mounting_yaw"] * a_x,
        (1 + x["yaw_rate_gain"]) * r + x["yaw_rate_bias"],
        v_x * x["grade_slope"] + x["pitch_rate_bias"],
        v_x * x["bank_slope"] + x["roll_rate_bias"],
        jnp.hypot(v_x, v_y),
        v_x * x["grade"],
        *torques,
    ]
    axles = jnp.concatenate([f.reshape(2, 2).sum(axis=1) for f in force])
    return motion, jnp.stack(sensors), axles


def _forces(world: World, truth: Truth, x: dict[str, Any], velocity: Any, steer: Any) -> tuple[Any, Any]:
    """(4,) along and across each wheel, N: slips move from those of the truth by what the errors change."""
    true = jnp.maximum(truth.velocity_x, SLOWEST), truth.velocity_y, truth.yaw_rate
    (ahead, angle), (true_ahead, true_angle) = (
        _rolling(world, velocity, steer),
        _rolling(world, true, truth.steer),
    )
    noise = jnp.stack([x[f"slip_{w}"] for w in WHEELS])
    rolling = (1 + truth.kappa) * true_ahead * jnp.exp(x["radius"])
    kappa = rolling / ahead - 1 + noise
    moved = x["cg_height"] * (world.load_x * jnp.sum(truth.force_x) + world.load_y * jnp.sum(truth.force_y))
    load = jnp.maximum(truth.load, _LIGHTEST) * jnp.exp(x["mass"]) + moved
    friction = truth.friction * jnp.exp(
        (1 - truth.grippy) * x["friction_slippery"] + truth.grippy * x["friction_grippy"]
    )
    scaled = {
        "LKX": x["slip_stiffness"],
        "LKY": _FRONT * x["cornering_front"] + (1 - _FRONT) * x["cornering_rear"],
        "LCX": x["shape_x"],
        "LCY": x["shape_y"],
    }
    given = world.tire.coefficients
    coefficients = given | {name: given[name] * jnp.exp(error) for name, error in scaled.items()}
    tire = eqx.tree_at(lambda t: t.coefficients, world.tire, coefficients)
    return tire.forces(kappa, truth.alpha + angle - true_angle, load, friction, ahead)


def _rolling(world: World, velocity: tuple[Any, Any, Any], steer: Any) -> tuple[Any, Any]:
    """(4,) speeds along the wheels, m/s, and slip angles, rad."""
    v_x, v_y, r = velocity
    along, across = v_x - world.place_y * r, v_y + world.place_x * r
    cos, sin = jnp.cos(steer), jnp.sin(steer)
    ahead = along * cos + across * sin
    return ahead, -jnp.arctan2(across * cos - along * sin, ahead)
