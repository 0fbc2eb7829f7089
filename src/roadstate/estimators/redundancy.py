"""What a car's sensors tell of one another: each quantity by every way that leads to it."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core.constants import GRAVITY
from roadstate.estimators.axle_forces import AxleForces, gains_aside, steered_cosines
from roadstate.estimators.base import leaf
from roadstate.estimators.intake import ACCEL_X, ACCEL_Y, SPIN, STALE, STEER, YAW_RATE, Signals
from roadstate.estimators.signals import Held
from roadstate.linalg import rss

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

TELLINGS = (
    *("accel_x", "wheels_accel", "torque"),
    *("yaw_rate", "front_pair", "rear_pair", "accel_y", "steer"),
    *("wheel_fl", "wheel_fr", "wheel_rl", "wheel_rr", "speed"),
)
"""The ways, in three groups: longitudinal specific force, yaw rate, speed."""
GROUP = np.array([0, 0, 0, 1, 1, 1, 1, 1, 2, 2, 2, 2, 2])
YAW = 1
DELAY = np.array([0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.2, 0.2, 0.1, 0.1, 0.1, 0.1, 0.2])
"""s by which a telling may be late against the others of its group: signals come up to 0.1 s late, a car
answers its steering, and v̇_y takes its part of a_y, later by as much again."""
_LARGEST = np.array([3.0, 0.5, 0.0])  # 1σ (the speed's share of itself below) from which on one says nothing
_SLOWEST = (2.0, 5.0)  # m/s from which on directions are known: with a gear, and without
_ACCEL_X = (0.2, 0.03)  # 1σ: floor in m/s², and share
_WHEELS_ACCEL = (0.3, 0.1, 0.1)  # m/s²; share; sideslip, for v_y r
_TORQUE = (0.3, 0.15, 2.0)  # and while gears change, m/s²
_GYRO = (0.01, 0.03)  # rad/s, and share
_PAIR = (0.015, 0.005, 0.7)  # rad/s; share of the speed: radii, loads; share of the slip that forces make
_ACCEL_Y = (0.7, 0.15)  # m/s²: banked roads, v̇_y; and share
_STEER = (0.25, 0.006, 1.5, 0.5)  # share; rad; m/s² that any road but ice holds; share of what is beyond
_GRIPS = 0.6  # share of the friction that holds a car as it is steered
# m/s² by which gyroscope and wheels' differences alike exceed what steering and lateral acceleration lead to
# where the car slides sideways, s for which it may go on, and s after which it would have turned round
_SLIDES = (2.0, 2.0, 4.0)
# rad of slip at the rear axle from which on a car may be steered against its turn; rad/s, and share of the
# yaw rate, within which wheels' differences confirm it meanwhile
_DRIFTS = (0.1, 0.05, 0.2)
# share of that slip by which the car must have moved aside first, as accelerometer and gyroscope have it; and
# s for which that is remembered
_SWEPT = (0.5, 2.0)
_WHEEL = (0.15, 0.01)  # m/s; share of the speed
_HELD = 0.08  # torque over load that any road holds: a wheel under more may spin or lock
_ROLLS = (2.0, 0.15)  # m/s, and share of the speed, by which a wheel that rolls may differ from it
_HOLDS = (0.5, 0.03)  # m/s, and share of the speed, by which one under torque may, to be a witness
_RETURNS = 8.0  # s that a wheel which torque has made spin or lock may take, on ice, to roll again
_SUSTAINS = 0.04  # torque over load that keeps a wheel in such a spin: one that slides is held by less
_SPEED = (0.4, 0.02)  # m/s, and share


class Slide(NamedTuple):
    """Of a car that goes aside.

    Attributes:
        lasts: s for which it may still slide so far that steering and lateral acceleration say nothing.
        slid: s for which it has seemed to slide so far, less those for which it has not since.
        swept: m/s, of late moved aside, by lateral acceleration and yaw rate.
        drifts: whether its rear axle slides, and it may be steered against its turn.
    """

    lasts: Float[Array, ""]
    slid: Float[Array, ""]
    swept: Float[Array, ""]
    drifts: Bool[Array, ""]

    @classmethod
    def none(cls) -> Slide:
        """It goes where it is steered."""
        zero = jnp.zeros(())
        return cls(zero, zero, zero, jnp.zeros((), bool))


class Tellings(NamedTuple):
    """What each of :data:`TELLINGS` says.

    Attributes:
        value: (13,) specific force in m/s², yaw rate in rad/s, speed in m/s.
        std: (13,) 1σ, infinite where it says nothing.
        answers: (13,) whether it must say so if its sensors are sound.
        slide: how far the car goes aside.
    """

    value: Float[Array, " 13"]
    std: Float[Array, " 13"]
    answers: Bool[Array, " 13"]
    slide: Slide


def inner_mean(values: Float[Array, "... k"], present: Bool[Array, "... k"]) -> tuple[Array, Array, Array]:
    """Mean of those present but for the least and the largest (of three or more), variance, and their number.

    One that lies is either among the two left out or between the others.
    """
    shown = jnp.where(present, values, 0.0)
    count = jnp.sum(present, axis=-1).astype(values.dtype)
    most = jnp.max(jnp.where(present, values, -jnp.inf), axis=-1)
    least = jnp.min(jnp.where(present, values, jnp.inf), axis=-1)
    many = count > 2.5
    left = jnp.maximum(jnp.where(many, count - 2, count), 1.0)
    mean = (jnp.sum(shown, axis=-1) - jnp.where(many, most + least, 0.0)) / left
    square = (jnp.sum(shown**2, axis=-1) - jnp.where(many, most**2 + least**2, 0.0)) / left
    return mean, jnp.maximum(square - mean**2, 0.0), count


class Redundancy(eqx.Module):
    """Tells longitudinal specific force, yaw rate and speed in every way the channels allow.

    Longitudinal specific force a_x = v̇_x + g sin θ − v_y r:

    - the accelerometer;
    - the wheels' R ω̇ (or the rate of a speed signal), but for the slope;
    - torques and air resistance, Σ F_x/m − F_air/m, which no slope enters.

    Yaw rate r:

    - the gyroscope;
    - the wheels of an axle: their centres move at v_x ∓ r T/2, so r = R (ω_right − ω_left)/(T cos δ), but
      for their slips' difference Δκ, an error of v Δκ/T;
    - lateral specific force a_y = v̇_y + v r + g sin φ: r ≈ a_y/v, which a banked road and a changing
      sideslip put off;
    - steering, by the single-track model in steady state: r = v δ/(L + v²/g (1/C_f − 1/C_r)), C the
      cornering stiffnesses over load (Mitschke & Wallentowitz, *Dynamik der Kraftfahrzeuge*, part C). What it
      demands beyond the acceleration that the road holds need not come about.

    A car that spins turns otherwise than it is steered, and than its tires push it aside: v̇_y is several
    m/s². Where the gyroscope and the wheels' differences contradict both of the others, one of which alone
    may lie, these two say nothing of the yaw rate for a while, nor wheels of the acceleration: v_y r is not
    small.

    Nor does steering where the rear axle slides already, by what the tires tell: a driver steers against it.
    But tires tell of a slide as well where it is the steering that lies; then the car has never begun to move
    aside, v̇_y = a_y − v r.

    Speed, each wheel R ω cos δ ± r T/2 against the others and a speed signal. A wheel under a torque that
    some road would not hold may spin or lock, which is no fault of its sensor, and then has not to answer for
    it, nor is it a witness against wheels that roll, until it rolls again: on ice less torque holds it in its
    spin than it took to begin.

    Attributes:
        radius: rolling radius, m.
        track: (2,) m.
        wheelbase: m.
        rear: from the centre of gravity to the rear axle, m.
        understeer: g⁻¹ (1/C_f − 1/C_r), s²/m.
        slip_stiffness: C_κ/F_z.
        accel_std: 1σ of the longitudinal accelerometer at rest, m/s²: more where the file knows of a bias.
        driven: (4,) which wheels the engine turns.
        has_wheels: whether any wheel's speed is measured.
        slowest: m/s below which directions are not known.
    """

    radius: Float[Array, ""]
    track: Float[Array, " 2"]
    wheelbase: Float[Array, ""]
    rear: Float[Array, ""]
    understeer: Float[Array, ""]
    slip_stiffness: Float[Array, ""]
    accel_std: Float[Array, ""]
    driven: Bool[Array, " 4"]
    has_wheels: bool = eqx.field(static=True)
    slowest: float = eqx.field(static=True)

    def __init__(self, vehicle: Vehicle, available: Collection[str]) -> None:
        geometry, tires = vehicle.geometry, vehicle.tires
        self.radius = leaf(vehicle.wheels.radius)
        self.track = jnp.asarray([geometry.track_front, geometry.track_rear])
        self.wheelbase = leaf(vehicle.wheelbase)
        self.rear = leaf(geometry.cg_to_rear_axle)
        self.understeer = leaf(
            (1 / tires.cornering_stiffness_front - 1 / tires.cornering_stiffness_rear) / GRAVITY
        )
        self.slip_stiffness = leaf(tires.slip_stiffness)
        self.accel_std = leaf(max(_ACCEL_X[0], vehicle.sensors.accel.bias))
        self.driven = jnp.asarray(vehicle.driveline.drives)
        self.has_wheels = any(c.startswith("wheel_speed") for c in available)
        self.slowest = _SLOWEST[0 if "gear_ratio" in available else 1]

    def effort(self, seen: Signals, forces: AxleForces) -> Float[Array, " 4"]:
        """(4,) How hard drive and brakes act on the wheels, as m/s² of the car: by as much they may slip."""
        felt = jnp.where(seen.age[ACCEL_X] < STALE, seen.smooth[ACCEL_X], 0.0)
        braking = jnp.maximum(jnp.abs(forces.brake), -felt)
        return jnp.where(self.driven, jnp.maximum(jnp.abs(forces.drive), felt), 0.0) + braking

    def _ahead(self, seen: Signals, speed: Array) -> tuple[Array, Array]:
        """(4,) what each wheel exceeds the car's speed by, m/s; and what it may, to be a witness."""
        return self.radius * seen.smooth[SPIN] - speed, _HOLDS[0] + _HOLDS[1] * jnp.abs(speed)

    def _used(self, forces: AxleForces, effort: Array) -> Array:
        """(4,) what drive and brakes ask of each wheel, over its load."""
        return jnp.maximum(jnp.abs(forces.over_load), effort / GRAVITY)

    def excused(
        self,
        before: Float[Array, " 4"],
        seen: Signals,
        forces: AxleForces,
        effort: Float[Array, " 4"],
        speed: Float[Array, ""],
        dt: Float[Array, ""],
    ) -> Float[Array, " 4"]:
        """(4,) s for which each wheel may still go on spinning, or locked, as torque has left it.

        Args:
            before: of the sample before, 0 at the first.
            seen, forces, effort, speed: as in :meth:`tell`.
            dt: s.
        """
        ahead, most = self._ahead(seen, speed)
        driven = (forces.over_load * jnp.sign(ahead) > _SUSTAINS) | (self._used(forces, effort) > _HELD)
        left = jnp.where(driven, _RETURNS, jnp.maximum(before - dt, 0.0))
        return jnp.where(jnp.abs(ahead) < 0.5 * most, 0.0, left)

    def tell(
        self,
        seen: Signals,
        forces: AxleForces,
        signal: Held,
        signal_rate: Float[Array, ""],
        effort: Float[Array, " 4"],
        excused: Float[Array, " 4"],
        slide: Slide,
        speed: Float[Array, ""],
        velocity_y: Float[Array, ""],
        friction: Float[Array, ""],
        dt: Float[Array, ""],
    ) -> Tellings:
        """What each way leads to.

        Args:
            seen: as the sensors say, whatever has been found about them.
            forces: the latest.
            signal: speed signal, m/s.
            signal_rate: its rate, m/s².
            effort: (4,) m/s², of late the most of :meth:`effort`.
            excused: (4,) s, of :meth:`excused`.
            slide: of the sample before.
            speed: the estimate so far, m/s.
            velocity_y: likewise.
            friction: of the road, the likeliest.
            dt: s.
        """
        smooth, known = seen.smooth, seen.age < STALE
        spin, has_spin = smooth[SPIN], known[SPIN]
        moves = jnp.abs(speed) > self.slowest
        angle = jnp.where(known[STEER], jnp.clip(smooth[STEER], -0.9, 0.9), 0.0)
        cosine = jnp.cos(angle)
        used = self._used(forces, effort)
        slip = jnp.minimum(used / self.slip_stiffness, 1.0)
        ahead, most = self._ahead(seen, speed)
        away = jnp.abs(ahead)
        rolls = has_spin & (away < _ROLLS[0] + _ROLLS[1] * jnp.abs(speed))
        if self.has_wheels:
            wheels, apart, count = inner_mean(self.radius * seen.rate[SPIN], rolls)
            has_accel = count > 0
        else:
            wheels, apart, has_accel = signal_rate, jnp.zeros_like(speed), signal.age < STALE
        explained = forces.explained
        along = [smooth[ACCEL_X], wheels, explained]
        along_std = [
            rss(self.accel_std, _ACCEL_X[1] * smooth[ACCEL_X]),
            jnp.sqrt(
                _WHEELS_ACCEL[0] ** 2
                + (_WHEELS_ACCEL[1] * wheels) ** 2
                + (_WHEELS_ACCEL[2] * speed * smooth[YAW_RATE]) ** 2
                + apart
            ),
            rss(_TORQUE[0], _TORQUE[1] * explained) + jnp.where(forces.is_shifting, _TORQUE[2], 0.0),
        ]
        # the yaw rate
        safe = jnp.where(jnp.abs(speed) < 1.0, jnp.where(speed < 0, -1.0, 1.0), speed)
        track = self.track * jnp.stack([cosine, jnp.ones_like(cosine)])
        pair = self.radius * (spin[1::2] - spin[0::2]) / track
        worst = jnp.maximum(slip[0::2], slip[1::2])
        rolling = jnp.abs(speed) / track * (_PAIR[1] + _PAIR[2] * worst)
        by_side = smooth[ACCEL_Y] / safe
        demand = speed**2 / (self.wheelbase + self.understeer * speed**2)
        by_steer = demand / safe * angle
        holds = jnp.minimum(_STEER[2], _GRIPS * GRAVITY * friction)
        beyond = jnp.maximum(jnp.abs(demand * angle) - holds, 0.0)
        steer_std = jnp.sqrt(
            (_STEER[0] * by_steer) ** 2 + (demand / safe * _STEER[1]) ** 2 + (_STEER[3] * beyond / safe) ** 2
        )
        turning = [smooth[YAW_RATE][None], pair, jnp.stack([by_side, by_steer])]
        turning_std = [
            rss(_GYRO[0], _GYRO[1] * smooth[YAW_RATE])[None],
            rss(_PAIR[0], rolling),
            jnp.stack([rss(_ACCEL_Y[0], _ACCEL_Y[1] * smooth[ACCEL_Y]) / jnp.abs(safe), steer_std]),
        ]
        paired = rolls[0::2] & rolls[1::2]
        both = known[ACCEL_Y] & known[STEER]
        turns = jnp.concatenate([smooth[YAW_RATE][None], pair])
        apart = jnp.abs(turns - turning[2][:, None])
        # by steering on a road that leans, where the lateral acceleration is not v r
        leans = demand / safe * (angle - self.understeer * smooth[ACCEL_Y])
        leaning = jnp.abs(turns * self.wheelbase * demand / safe**2 - leans)
        apart = apart.at[1].min(leaning)
        apart = jnp.min(jnp.where(jnp.append(True, paired), apart, jnp.inf)) * jnp.abs(safe)
        spins = both & known[YAW_RATE] & jnp.any(paired) & (apart > _SLIDES[0]) & moves
        # an acceleration that does not turn the car moves it aside, and it cannot for long
        slid = jnp.clip(slide.slid + jnp.where(spins, dt, -dt), 0.0, 2 * _SLIDES[2])
        spins = spins & (slid < _SLIDES[2])
        lasts = jnp.where(spins, _SLIDES[1], jnp.maximum(slide.lasts - dt, 0.0))
        rear = jnp.stack([velocity_y, velocity_y - self.rear * smooth[YAW_RATE]])
        drifts = jnp.all(jnp.abs(rear) > _DRIFTS[0] * jnp.abs(speed))
        aside = jnp.where(known[ACCEL_Y] & known[YAW_RATE], smooth[ACCEL_Y] - speed * smooth[YAW_RATE], 0.0)
        swept = slide.swept * jnp.exp(-dt / _SWEPT[1]) + aside * dt
        begins = swept * jnp.sign(velocity_y) > _SWEPT[0] * _DRIFTS[0] * jnp.abs(speed)
        # not as a gyroscope alone has it that lies
        alike = jnp.abs(pair - smooth[YAW_RATE]) < _DRIFTS[1] + _DRIFTS[2] * jnp.abs(smooth[YAW_RATE])
        drifts = drifts & (begins | slide.drifts) & jnp.any(alike & paired)
        held = jnp.stack([known[ACCEL_Y], known[STEER] & ~drifts]) & (lasts <= 0)
        turning_known = [known[YAW_RATE][None], paired, held]
        along_known = [
            known[ACCEL_X] & moves,
            has_accel & moves & (lasts <= 0),  # it moves aside, which turns forward
            (forces.age < STALE) & (~forces.is_brake_unknown) & moves,
        ]
        # the speed
        half = 0.5 * jnp.stack([self.track[0], -self.track[0], self.track[1], -self.track[1]])
        rate = jnp.where(known[YAW_RATE], smooth[YAW_RATE], 0.0)
        turn = steered_cosines(cosine)
        rims = self.radius * spin * turn + gains_aside(half, turn) * rate
        rims_std = _WHEEL[0] + jnp.abs(speed) * (_WHEEL[1] + 2 * slip)
        free = (used < _HELD) & (excused <= 0)
        value = jnp.concatenate([jnp.stack(along), *turning, rims, signal.value[None]])
        signal_std = rss(_SPEED[0], _SPEED[1] * speed)
        std = jnp.concatenate([jnp.stack(along_std), *turning_std, rims_std, signal_std[None]])
        is_known = jnp.concatenate(
            [
                jnp.stack(along_known),
                jnp.concatenate(turning_known) & moves,
                has_spin & moves & (free | (away < most)),
                ((signal.age < STALE) & moves)[None],
            ]
        )
        largest = jnp.asarray(_LARGEST[GROUP]) + (GROUP == 2) * (0.3 * jnp.abs(speed) + 0.5)
        std = jnp.where(is_known & (std < largest), std, jnp.inf)
        others = jnp.ones(len(TELLINGS), bool)
        wheels_at = slice(TELLINGS.index("wheel_fl"), TELLINGS.index("wheel_rr") + 1)
        # wheels that spin or lock follow no steering
        steers = jnp.all(excused[:2] <= 0)
        answers = others.at[wheels_at].set(free).at[TELLINGS.index("steer")].set(steers)
        # only wheels that slip sideways contradict it then
        answers = answers.at[TELLINGS.index("yaw_rate")].set(lasts <= 0)
        return Tellings(value, std, answers, Slide(lasts, slid, swept, drifts))
