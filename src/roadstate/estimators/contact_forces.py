"""What the road does to the tires, from accelerations and torques alone: no tire model has a say in it."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.core.errors import InputError
from roadstate.estimators.axle_forces import AxleForces, Current, by_axle, damped, held_back
from roadstate.estimators.base import Sample, leaf
from roadstate.estimators.force_balance import LARGEST, ForceBalance, Scene
from roadstate.estimators.intake import (
    ACCEL_X,
    ACCEL_Y,
    SMOOTHING,
    SPIN,
    STALE,
    STEER,
    YAW_RATE,
    Signals,
)
from roadstate.estimators.load_transfer import Lean
from roadstate.estimators.signals import NEVER, STANDSTILL_SPEED, Held, way
from roadstate.estimators.traction import LEAST_BRAKING, UNKNOWN, Traction, TractionMeter, TractionState
from roadstate.estimators.unseen_brakes import BrakeWatch
from roadstate.linalg import root, rss

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_TORQUE_TIME = 0.1  # s: correlation time of the torque signals' noise
_TORQUE_DELAY = 0.03  # s by which a torque signal may be late
_CRAWL = 1.0  # m/s under which a brake's torque may be anything up to what it could be
_UNEVEN = 0.02  # m/s²/√Hz: what the road's unevenness does to the force that torques tell
_GUST = 3.0  # m/s/√Hz: a wind that varies by 1 m/s over 5 s
_TURNING = 0.05  # 1σ of the share of the front axle's lateral force that steering turns backward
_SPLIT_ERROR = 0.3  # 1σ of what each wheel brakes where nothing tells, as a share of what one does at most
_INERTIA_ERROR = 0.1  # 1σ of the yaw inertia, as a share of it
_UNTIL_NEXT = 0.5  # 1σ of how a_y changes until its next sample, as a share of how it has
_PLACE_ERROR = 0.05  # m: 1σ of where the IMU is along the car, once that has been learned
# 1σ of what leans on an axle across, over its load, where a bend climbs or falls and so is twisted: as a
# share of what its slope turns by from axle to axle
_TWISTED = 0.5
CALM = 0.1
"""m/s²/√Hz: error of the torques' force beyond which it is not the usual one."""
_LATELY = 1.0  # s
_APART = 1.0  # m/s² by which an accelerometer that is not shaken differs from torques that lie
NOISY = 0.012
"""Share of an axle's load by which sensors' noise makes its force lead a low pass."""
_STIRRED = 0.15  # s for which what stirs up wheels and brakes goes on
# an axle's F_y over its load up to which it is low-passed, as a share of what a rough road shakes the car by
# both ways, and at the least; and s over which
_BOUNCES, _STEADY, _BOUNCE_TIME = 10.0, 1e-3, 0.2
_ROUGH_TIME = 5.0  # s for which a road shakes a car that is not swiftly steered and braked instead
_LOCKED = 3.0  # s for which it is remembered that brakes locked wheels
_DIFFERENTIAL = 0.1  # 1σ of what a wheel gets of an engine's torque, as a share of it
_HEARD = 0.1  # share of the drive that wheels get, at the least, whose speeds tell the engine's


class ForceMeterState(NamedTuple):
    """State of a :class:`ForceMeter`.

    Attributes:
        traction, brakes: the parts'.
        torque: (8,) drive and brake torques, low-passed, N·m.
        age: s since a drive torque came.
        explained: specific force that torques and air resistance made at the last sample, m/s²; the
            intensity of its error, m/s²/√Hz; and by how much the accelerometer has told more of late, m/s².
        calm: (3, 2) F_x of the axles without their wheels' noise, as accelerometer and torques and as torques
            alone tell it, and F_y without what a rough road shakes, N: the current ones low-passed.
        stir, jolt: (2, 2), (4,) as :class:`~roadstate.estimators.axle_forces.AxleForces`.
        held: (4,) F_x of the wheels when brakes last let the car move, N.
        locking: as :class:`~roadstate.estimators.axle_forces.AxleForces`.
        lean: of the body, that shifts load from axle to axle.
        rough: what the road shakes the accelerometers by both ways, and has for a while, m/s².
    """

    traction: TractionState | None
    brakes: BrakeWatch
    torque: Float[Array, " 8"]
    age: Float[Array, ""]
    explained: Float[Array, " 3"]
    calm: Float[Array, "3 2"]
    stir: Float[Array, "2 2"]
    jolt: Float[Array, " 4"]
    held: Float[Array, " 4"]
    locking: Float[Array, ""]
    lean: Lean
    rough: Float[Array, ""]


class ForceMeter(eqx.Module):
    """Follows forces from sample to sample, each as the balance at its instant has it.

    Attributes:
        channels: canonical channels read.
        torque_of: what drive torque is measured that tells the force at the wheels.
        knows_brakes: whether any channel tells of brakes.
        balance: of forces, at one instant.
    """

    channels: tuple[str, ...] = eqx.field(static=True)
    torque_of: Literal["wheels", "engine"] | None = eqx.field(static=True)
    knows_brakes: bool = eqx.field(static=True)
    _tells_all: bool = eqx.field(static=True)
    balance: ForceBalance
    _traction: TractionMeter | None
    _pitching: Float[Array, ""]

    def __init__(self, vehicle: Vehicle, available: Collection[str]) -> None:
        try:
            self._traction = TractionMeter(vehicle, available)
        except InputError:  # no torque that tells the force at the wheels
            self._traction = None
        self.torque_of, self.knows_brakes, self.channels = None, False, ()
        if self._traction is not None:
            self.torque_of = "wheels" if self._traction.source == "wheels" else "engine"
            self.knows_brakes, self.channels = self._traction.knows_brakes, self._traction.channels
        self._tells_all = self.torque_of is not None and all(f"brake_torque_{w}" in available for w in WHEELS)
        self.balance = ForceBalance(vehicle)
        self._pitching = leaf(GRAVITY * vehicle.body.pitch_gradient)

    def init(self) -> ForceMeterState:
        """Nothing has come yet."""
        traction = None if self._traction is None else self._traction.init()
        age = jnp.full((), NEVER)
        return ForceMeterState(
            traction,
            BrakeWatch.none(),
            jnp.zeros(8),
            age,
            jnp.zeros(3),
            jnp.zeros((3, 2)),
            jnp.zeros((2, 2)),
            jnp.zeros(4),
            jnp.zeros(4),
            jnp.zeros(()),
            Lean.upright(),
            jnp.zeros(()),
        )

    def nothing(self) -> AxleForces:
        """What is known before the first sample."""
        zero, two, four = jnp.zeros(()), jnp.zeros(2), jnp.zeros(4)
        load = self.balance.loads(zero, zero)
        now, still, no = Current(two, two, two, load, zero), jnp.zeros((2, 2)), jnp.zeros((), bool)
        return AxleForces(
            four, two, load, four, four, now, still, four, zero, two, four + jnp.inf, two + jnp.inf, two,
            Lean.upright(), zero, zero, zero, zero, zero, zero, zero, zero + 1.0, zero, zero, zero + NEVER,
            no, no, no,
        )  # fmt: skip

    def read(
        self,
        state: ForceMeterState,
        sample: Sample,
        signals: Signals,
        speed: Float[Array, ""],
        accel_error: Float[Array, " 2"],
        slope: Float[Array, ""],
        lightness: Float[Array, ""],
        dt: Float[Array, ""],
    ) -> tuple[ForceMeterState, AxleForces]:
        """Take a sample ``dt`` after the last.

        Args:
            state: from :meth:`init` or the last call.
            sample: the channels at this instant.
            signals: of the same instant.
            speed: m/s, the estimate so far.
            accel_error: (2,) by how much the accelerometers are thought to read too high, m/s².
            slope: what gravity takes of the acceleration, as thought so far, m/s².
            lightness: the file's mass over what the car is thought to have so far.
            dt: s.
        """
        car, radius, mass = self.balance.car, self.balance.car.wheel_radius[0], self.balance.car.mass
        accel = self._freed(signals.smooth, state.lean) - accel_error
        traction, drive = self._torques(state.traction, sample, signals, speed, dt)
        # what rough roads shake the accelerometer by does not make the body lean
        cause, intensity, apart = state.explained
        apart = apart - jnp.expm1(-dt / _LATELY) * (accel[0] - cause - apart)
        sure = self._tells_all & (state.age < STALE) & (intensity < CALM) & (jnp.abs(apart) < _APART)
        lean = state.lean.after(jnp.where(sure, cause, accel[0]), dt)
        load = self.balance.loads(lean.transferred(), accel[1])
        drag = car.drag(speed) / mass
        direction = jnp.tanh(speed / STANDSTILL_SPEED)
        most = LARGEST * mass * GRAVITY * radius
        pulling = jnp.clip(drive.drive_torque, -most, most)
        fresh = jnp.concatenate([pulling, jnp.minimum(drive.brake_torque, most) * direction])
        new = jnp.where(state.age < STALE, -jnp.expm1(-dt / SMOOTHING), 1.0)
        torque = state.torque + new * (fresh - state.torque)
        leans = lean.ahead(SMOOTHING)
        sharp = self._freed(signals.now, leans) - accel_error
        held = Held(sharp[0], signals.age[ACCEL_X])
        push = jnp.sum(pulling) / (radius * mass)
        angle, forward = jnp.clip(signals.smooth[STEER], -0.9, 0.9), way(speed)
        bend = held_back(accel[1], angle, car.cg_to_rear_axle / car.wheelbase)
        coefficient = car.rolling_coefficient(speed)
        drives, slows = jnp.sum(torque[:4]) / (radius * mass), jnp.sum(torque[4:]) / (radius * mass)
        felt = held.age < STALE
        lost = lightness * drag + bend + GRAVITY * coefficient * direction
        rotating = drive.inertia / mass - 1
        pushes = lightness * (push - rotating * (accel[0] - slope)) - lost
        # as torques tell it: what the accelerometer's noise moves would seem to be a load
        gains = (lightness * (drives - slows) - lost - slope) / (1 + lightness * rotating)
        brakes = state.brakes.take(held, pushes, drives, forward, dt)
        unseen = brakes.unseen(drive, self.knows_brakes, felt)
        brakes_hold = jnp.sum(drive.brake_torque) > LEAST_BRAKING * mass * radius
        brakes_hold = brakes_hold | unseen.act | (drive.age >= STALE)
        scene = Scene(
            load=load,
            engine=drive.engine,
            rolling=coefficient * load * direction,
            drag=drag,
            slope=slope,
            cosine=jnp.cos(angle),
            sine=jnp.sin(angle),
            forward=forward,
            known=drive.age < STALE,
            felt=felt,
            unseen=unseen,
            is_held=brakes_hold & (jnp.abs(speed) < STANDSTILL_SPEED),
            held=state.held,
        )
        slow = self.balance.of(accel, signals.rate, torque, scene)
        fast = self.balance.of(sharp, signals.now_rate, fresh, scene)
        kept = jnp.where(scene.is_held, state.held, slow.along)
        locking = jnp.maximum(jnp.minimum(slow.spun / GRAVITY, 1.0), state.locking * jnp.exp(-dt / _LOCKED))
        locking = jnp.where(scene.is_held, state.locking, locking)
        axles = by_axle(load)
        current = jnp.stack([by_axle(fast.along), by_axle(fast.told), fast.across])
        # anti-lock brakes shake a car along, swift steering across, but only a rough road both ways for long
        shakes = jnp.min(signals.shaken)
        rough = state.rough - jnp.expm1(-dt / _ROUGH_TIME) * (shakes - state.rough)
        rough = jnp.minimum(rough, shakes)
        bounces = _STEADY + _BOUNCES * rough / GRAVITY
        noise = jnp.stack([jnp.full_like(bounces, NOISY), jnp.full_like(bounces, NOISY), bounces])
        share = jnp.stack([new, new, -jnp.expm1(-dt / _BOUNCE_TIME)])
        calm = state.calm + share[:, None] * (current - state.calm)
        swift = calm + damped(current - calm, noise[:, None] * axles)
        bears = self.balance.loads(leans.transferred(), sharp[1])
        now = Current(swift[0], swift[1], swift[2], bears, signals.now_rate[YAW_RATE])
        ahead = jnp.abs(jnp.stack([current[0] - by_axle(slow.along), fast.across - slow.across]))
        calms = jnp.exp(-dt / _STIRRED)
        stir = jnp.maximum(ahead, state.stir * calms)
        jolt = jnp.maximum(jnp.abs(fast.along - slow.along), state.jolt * calms)
        split = jnp.where(slow.blind, _SPLIT_ERROR * jnp.max(jnp.abs(slow.along)), 0.02 * jnp.abs(slow.rest))
        if self.torque_of == "engine":
            split = rss(split, _DIFFERENTIAL * jnp.abs(torque[:4]) / radius)
        unsure = jnp.where(scene.felt | (scene.known & ~unseen.act), 0.0, jnp.inf)
        rotation = jnp.abs(signals.rate[YAW_RATE])
        # what one side brakes more than the other turns the car, too
        pulled = root(jnp.sum((self.balance.half_track * split) ** 2))
        moment = rss(_INERTIA_ERROR * car.yaw_inertia * rotation, pulled) / (axles * car.wheelbase)
        age = jnp.maximum(signals.age[ACCEL_Y], signals.age[YAW_RATE])
        missing = jnp.where(age < STALE, 0.0, jnp.inf)
        goes_on = _UNTIL_NEXT * jnp.abs(signals.rate[ACCEL_Y]) * jnp.minimum(age, STALE) / GRAVITY
        twisted = _TWISTED * slope / GRAVITY * jnp.tan(angle)
        gust = 2 * drag / jnp.maximum(jnp.abs(speed), 1.0) * _GUST
        forces = AxleForces(
            along=slow.along,
            across=slow.across,
            load=load,
            steady=slow.steady,
            told=slow.told,
            now=now,
            stir=stir,
            jolt=jolt,
            locking=locking,
            shaken=signals.shaken,
            along_std=split / jnp.maximum(load, 0.1 * jnp.mean(load)) + unsure,
            across_std=rss(moment, _PLACE_ERROR * rotation / GRAVITY, goes_on, twisted) + missing,
            accel=accel,
            lean=lean,
            yaw_accel=signals.rate[YAW_RATE],
            explained=slow.explained,
            drive=drives,
            brake=slows,
            rolling=GRAVITY * direction,
            lever=drive.lever / mass,
            turned=rotating * gains,
            intensity=self._intensity(drive, scene, fresh - torque, speed, gust, accel),
            gust=gust,
            held=drive.held_std / mass,
            age=drive.age,
            is_shifting=drive.is_shifting,
            is_brake_unknown=unseen.act,
            may_brake=unseen.may_act,
        )
        told = jnp.stack([forces.explained, forces.intensity, apart])
        return ForceMeterState(
            traction, brakes, torque, drive.age, told, calm, stir, jolt, kept, locking, lean, rough
        ), forces

    def _freed(self, signals: Float[Array, " 8"], lean: Lean) -> Float[Array, " 2"]:
        """Specific forces alone: signals are freed of the pitch that would last, not of this one."""
        return jnp.stack([lean.freed(signals[ACCEL_X], self._pitching), signals[ACCEL_Y]])

    def _torques(
        self, state: TractionState | None, sample: Sample, signals: Signals, speed: Array, dt: Array
    ) -> tuple[TractionState | None, Traction]:
        if self._traction is not None and state is not None:
            heard = jnp.where(signals.age[SPIN] < STALE, self.balance.driven, 0.0)
            share, radius = jnp.sum(heard), self.balance.car.wheel_radius[0]
            rim = radius * jnp.sum(heard * signals.value[SPIN]) / jnp.maximum(share, _HEARD)
            return self._traction.read(state, sample, speed, dt, jnp.where(share < _HEARD, speed, rim))
        turning = jnp.sum(self.balance.car.wheel_inertia) / self.balance.car.wheel_radius[0] ** 2
        return None, Traction.unknown(self.balance.car.mass + turning)

    def _intensity(
        self, drive: Traction, at: Scene, jump: Array, speed: Array, gust: Array, accel: Array
    ) -> Array:
        """White error of the specific force that torques tell, m/s²/√Hz."""
        mass, radius = self.balance.car.mass, self.balance.car.wheel_radius[0]
        white = rss(drive.torque_std * _TORQUE_TIME**0.5, drive.held_noise) / mass
        late = jnp.sum(jnp.abs(jump)) / (radius * mass) * (_TORQUE_DELAY / SMOOTHING * _TORQUE_TIME**0.5)
        turning = _TURNING * accel[1] * at.sine
        lost = jnp.where(drive.is_shifting, UNKNOWN["shift"], 0.0)
        lost = jnp.where(drive.age < STALE, lost, UNKNOWN["drive"])
        brake = jnp.where(at.unseen.may_act | (jnp.abs(speed) < _CRAWL), UNKNOWN["brake"], 0.0)
        return jnp.sqrt(_UNEVEN**2 + gust**2 + white**2 + late**2 + turning**2 + lost**2 + brake**2)
