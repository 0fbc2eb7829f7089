"""The balance of forces at one instant: what each wheel and axle bears, given accelerations and torques."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core.constants import GRAVITY
from roadstate.estimators.axle_forces import damped, steered_cosines
from roadstate.estimators.base import leaf
from roadstate.estimators.intake import SMOOTHING, SPIN, YAW_RATE
from roadstate.estimators.unseen_brakes import UnseenBrakes
from roadstate.vehicles import SevenDofForces

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_TRAIL = 0.03  # m: pneumatic trail of a car's tire that slips little
_PARALLEL = 0.5  # share in which steered wheels stand parallel, and not as Ackermann would have it
_SPUN = 3.0  # σ of the noise of a wheel's acceleration from which on it counts
_FRONT_MORE = 0.03  # by which the front axle's share of the roll moment exceeds that of the weight
LARGEST = 0.7
"""Of the weight: no wheel's torque makes more."""
SWAY_ARM = 0.85
"""Of the centre of gravity over the axis that the body rolls about, over its height."""


class Scene(NamedTuple):
    """What a balance of forces needs beside accelerations and torques.

    Attributes:
        load: (4,) of the wheels, N.
        engine: inertia that differentials turn with the driven wheels, kg·m² at them.
        rolling: (4,) resistance of the wheels, N.
        drag: specific force of the air, m/s².
        slope: what gravity takes of the acceleration, m/s².
        cosine, sine: of the mean front road-wheel angle.
        forward: 1, or -1 in reverse.
        known, felt: whether the torques are, and the accelerometer.
        unseen: brakes that no channel tells of.
        is_held: whether brakes hold a car that stands.
        held: (4,) F_x of the wheels when brakes last let the car move, N.
    """

    load: Float[Array, " 4"]
    engine: Float[Array, ""]
    rolling: Float[Array, " 4"]
    drag: Float[Array, ""]
    slope: Float[Array, ""]
    cosine: Float[Array, ""]
    sine: Float[Array, ""]
    forward: Float[Array, ""]
    known: Bool[Array, ""]
    felt: Bool[Array, ""]
    unseen: UnseenBrakes
    is_held: Bool[Array, ""]
    held: Float[Array, " 4"]


class Balance(NamedTuple):
    """Forces of wheels and axles.

    Attributes:
        told: (4,) F_x of the wheels as torques tell it, N.
        along: (4,) the same with the accelerometer.
        across: (2,) F_y of the axles in their wheels' frames, N.
        rest: what torques leave unexplained, N.
        explained: what they explain, m/s².
        steady: (4,) ``along`` without what the wheels turn up beyond the car, N.
        blind: whether nothing but the load says how forces are shared.
        spun: by how much a wheel's rim gains on the car, at most, m/s².
    """

    told: Float[Array, " 4"]
    along: Float[Array, " 4"]
    across: Float[Array, " 2"]
    rest: Float[Array, ""]
    explained: Float[Array, ""]
    steady: Float[Array, " 4"]
    blind: Bool[Array, ""]
    spun: Float[Array, ""]


class ForceBalance(eqx.Module):
    """Balances forces: torques tell each wheel's F_x, accelerometers the sums, ṙ the axles' F_y.

    I_w ω̇_i = T_i − R F_x,i − M_rolling per wheel; what the accelerometer says beyond the sum is distributed
    as the torques are (under brakes that no channel tells of as the file shares them, or else as the load),
    so that force over load does not depend on the mass in the file: L Y_f = l_r m a_y + I_z ṙ − M_x and
    L Y_r = l_f m a_y − I_z ṙ + M_x, with M_x the moment of the longitudinal forces.

    Attributes:
        car: planar dynamics under given forces; its front axle bears more of the roll moment than of the
            weight, as bars and springs have it, without which a car would oversteer.
        driven: (4,) share of the drive that each wheel gets.
        half_track: (4,) where each wheel is, m to the left.
        splayed: F_y over load by which front tires push against each other, over sin² of the steering angle.
    """

    car: SevenDofForces
    driven: Float[Array, " 4"]
    half_track: Float[Array, " 4"]
    splayed: Float[Array, ""]
    _tips: Float[Array, ""]
    _braked: Float[Array, " 4"] | None
    _spin_noise: Float[Array, ""]

    def __init__(self, vehicle: Vehicle) -> None:
        car = SevenDofForces.from_vehicle(vehicle)
        share = jnp.clip(car.front_roll_share + _FRONT_MORE, 0.0, 1.0)
        self.car = eqx.tree_at(lambda c: c.front_roll_share, car, share)
        self._tips = leaf(1 + GRAVITY * SWAY_ARM * vehicle.body.roll_gradient)
        driven = np.array(vehicle.driveline.drives)
        self.driven = jnp.asarray(driven / driven.sum())
        self.half_track = jnp.asarray(np.array(vehicle.geometry.half_tracks))
        brakes = vehicle.brakes
        ackermann = vehicle.geometry.track_front / vehicle.wheelbase
        self.splayed = leaf(_PARALLEL * ackermann * vehicle.tires.cornering_stiffness_rear)
        self._braked = None
        if brakes is not None:
            gains = np.repeat([brakes.torque_per_pressure_front, brakes.torque_per_pressure_rear], 2)
            self._braked = jnp.asarray(gains / gains.sum())
        self._spin_noise = leaf(_SPUN * vehicle.sensors.wheel_speed.noise / SMOOTHING)

    def loads(self, along: Float[Array, ""], across: Float[Array, ""]) -> Float[Array, " 4"]:
        """Of the wheels of a car of the file's mass, N, under specific forces in m/s².

        In a bend the body rolls outward, and its centre of gravity with it: g times the roll gradient times
        the height over the roll axis comes to 7 % of what the centrifugal force shifts. (How a roll moment is
        shared: Gillespie, *Fundamentals of Vehicle Dynamics*, ch. 6.)
        """
        return self.car.wheel_loads(along, self._tips * across)

    def of(
        self, accel: Float[Array, " 2"], rate: Float[Array, " 8"], torque: Float[Array, " 8"], at: Scene
    ) -> Balance:
        """What goes with accelerations (m/s²), rates of all signals and drive and brake torques (N·m), all
        equally late."""
        mass, radius = self.car.mass, self.car.wheel_radius[0]
        moves = (accel[0] - at.slope - self.half_track * rate[YAW_RATE]) / radius
        spun = rate[SPIN] - moves
        # a wheel turns up as the car does, or a good deal more: the rest is noise of its speed
        spun = jnp.where(at.felt, damped(spun, self._spin_noise), spun)
        gains = radius * jnp.max(jnp.abs(spun))
        told = (torque[:4] - torque[4:] - self._turns_up(moves + spun, at.engine)) / radius - at.rolling
        # wheels that nothing drives need no torque to be told, unless it is a brake's
        told = jnp.where(at.known | ((self.driven == 0) & at.felt), told, 0.0)
        turn = steered_cosines(at.cosine)
        across = self._across(told, accel[1], rate[YAW_RATE], at)
        pull = jnp.sum(told * turn) - across[0] * at.sine
        rest = mass * (accel[0] + at.drag) - pull
        most = LARGEST * mass * GRAVITY * radius
        share = jnp.abs(torque[:4]) + jnp.abs(torque[4:]) + 0.02 * most * self.driven
        blind = at.unseen.act | ((at.unseen.may_act | ~at.known) & (at.forward * rest < 0))
        share = jnp.where(at.known, share / jnp.sum(share), self.driven)
        braked = at.load / jnp.sum(at.load) if self._braked is None else self._braked
        share = jnp.where(blind, braked, share)
        along = told + jnp.where(at.felt, share * rest, 0.0) / turn
        # wheels that brakes lock keep each tire distorted as it stopped, and what the car then swings back by
        # distorts all alike
        along = jnp.where(at.is_held, at.held + jnp.mean(along - at.held), along)
        # without what the wheels turn up beyond the car; the sum stays what the accelerometer tells
        spun = self._turns_up(spun, at.engine) / radius
        steady = along + jnp.where(at.known, spun - share * jnp.sum(spun), 0.0)
        across = self._across(along, accel[1], rate[YAW_RATE], at)
        return Balance(told, along, across, rest, pull / mass - at.drag, steady, blind, gains)

    def _turns_up(self, spin: Array, engine: Array) -> Float[Array, " 4"]:
        """(4,) torques for angular accelerations of the wheels; differentials turn an ``engine`` of so much
        inertia, kg·m² at the wheels, with their mean."""
        return self.car.wheel_inertia * spin + engine * self.driven * jnp.sum(self.driven * spin)

    def splay(self, at: Scene) -> Float[Array, ""]:
        """By how much F_y of the right front wheel exceeds the left one's by the steering's geometry, N.

        To roll without slip they would stand at δ(1 ± b δ/2L) for a track b (Ackermann); cars steer between
        that and parallel wheels (Gillespie, *Fundamentals of Vehicle Dynamics*, ch. 8), which push against
        each other, whichever way they are steered, and the other way as the car backs up.
        """
        return at.forward * 0.5 * self.splayed * (at.load[0] + at.load[1]) * at.sine**2

    def _across(self, along: Array, accel_y: Array, yaw_accel: Array, at: Scene) -> Float[Array, " 2"]:
        """(2,) lateral forces of the axles in their wheels' frames, N."""
        car = self.car
        turn = steered_cosines(at.cosine)
        moment = -jnp.sum(self.half_track * along * turn)  # the left side pushes to the right
        turning = car.yaw_inertia * yaw_accel - moment
        # the outer one of the steered wheels bears more, and so holds back more
        front = (car.cg_to_rear_axle * car.mass * accel_y + turning) / car.wheelbase
        more = front * (at.load[1] - at.load[0]) / (at.load[0] + at.load[1]) + self.splay(at)
        turning = turning + self.half_track[0] * at.sine * more
        # aligning moments: a lateral force acts a trail behind its axle, which shrinks as it grows
        trail = _TRAIL * at.forward * jnp.maximum(1 - jnp.abs(accel_y) / GRAVITY, 0.0)
        front = ((car.cg_to_rear_axle + trail) * car.mass * accel_y + turning) / car.wheelbase
        rear = ((car.cg_to_front_axle - trail) * car.mass * accel_y - turning) / car.wheelbase
        return jnp.stack([(front - (along[0] + along[1]) * at.sine) / at.cosine, rear])
