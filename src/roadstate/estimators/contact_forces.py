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
from roadstate.estimators import force_errors
from roadstate.estimators.axle_forces import AxleForces, Current, by_axle, damped, held_back
from roadstate.estimators.base import Sample, leaf
from roadstate.estimators.force_balance import LARGEST, Balance, ForceBalance, Scene
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
from roadstate.estimators.traction import LEAST_BRAKING, Traction, TractionMeter, TractionState
from roadstate.estimators.unseen_brakes import BrakeWatch

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

CALM = 0.1
"""m/s²/√Hz: error of the torques' force beyond which it is not the usual one."""
_LATELY = 1.0  # s
_APART = 1.0  # m/s² by which an accelerometer that is not shaken differs from torques that lie
NOISY = 0.012
"""Share of an axle's load by which sensors' noise makes its force lead a low pass."""
_SWIFT = 15.4  # Hz: band in which the lateral accelerometer's noise is taken for F_y that leads a low pass
_STIRRED = 0.15  # s for which what stirs up wheels and brakes goes on
# an axle's F_y over its load up to which it is low-passed beyond sensors' noise, as a share of what a rough
# road shakes the car by both ways; and s over which
_BOUNCES, _BOUNCE_TIME = 10.0, 0.2
_ROUGH_TIME = 5.0  # s for which a road shakes a car that is not swiftly steered and braked instead
_LOCKED = 3.0  # s for which it is remembered that brakes locked wheels
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


class _Torques(NamedTuple):
    """Torques of drive and brakes, and the specific forces that they make.

    Attributes:
        now, smooth: (8,) of the wheels, as they are and low-passed, N·m.
        share: of a sample in that low pass.
        push: of the drive, as it is, m/s².
        drives, slows: of drive and brakes, low-passed, m/s².
    """

    now: Float[Array, " 8"]
    smooth: Float[Array, " 8"]
    share: Float[Array, ""]
    push: Float[Array, ""]
    drives: Float[Array, ""]
    slows: Float[Array, ""]


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
    _noise: Float[Array, "3 1"]

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
        across = vehicle.sensors.accel.noise_density * _SWIFT**0.5 / GRAVITY
        self._noise = jnp.asarray([[NOISY], [NOISY], [across]])

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
            two, Lean.upright(), zero, zero, zero, zero, zero, zero, zero, zero + 1.0, zero, zero,
            zero + NEVER, no, no, no,
        )  # fmt: skip

    def read(
        self,
        state: ForceMeterState,
        sample: Sample,
        signals: Signals,
        speed: Float[Array, ""],
        accel_error: Float[Array, " 2"],
        slope: Float[Array, ""],
        heave: Float[Array, " 3"],
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
            heave: by what share tires bear more as the road bends up or banks inward, and 1σ of either.
            lightness: the file's mass over what the car is thought to have so far.
            dt: s.
        """
        accel = self._freed(signals.smooth, state.lean) - accel_error
        traction, drive = self._torques(state.traction, sample, signals, speed, dt)
        lean, apart = self._leaning(state, accel, dt)
        leans = lean.ahead(SMOOTHING)
        sharp = self._freed(signals.now, leans) - accel_error
        load = (1 + heave[0]) * self.balance.loads(lean.transferred(), accel[1])
        torques = self._pushes(state, drive, speed, dt)
        scene, brakes, turned = self._scene(
            state, signals, drive, torques, (accel, sharp), load, speed, slope, lightness, dt
        )
        slow = self.balance.of(accel, signals.rate, torques.smooth, scene)
        fast = self.balance.of(sharp, signals.now_rate, torques.now, scene)
        locking = jnp.maximum(jnp.minimum(slow.spun / GRAVITY, 1.0), state.locking * jnp.exp(-dt / _LOCKED))
        # anti-lock brakes shake a car along, swift steering across, but only a rough road both ways for long
        shakes = jnp.min(signals.shaken)
        rough = state.rough - jnp.expm1(-dt / _ROUGH_TIME) * (shakes - state.rough)
        rough = jnp.minimum(rough, shakes)
        calm, swift = self._calmed(state.calm, fast, torques.share, rough, by_axle(load), dt)
        bears = (1 + heave[0]) * self.balance.loads(leans.transferred(), sharp[1])
        ahead = jnp.stack([by_axle(fast.along) - by_axle(slow.along), fast.across - slow.across])
        calms = jnp.exp(-dt / _STIRRED)
        gust = force_errors.gust(scene.drag, speed)
        engine = torques.smooth if self.torque_of == "engine" else None
        split = force_errors.split(self.balance, slow, engine)
        unsure = jnp.where(scene.felt | (scene.known & ~scene.unseen.act), 0.0, jnp.inf)
        forces = AxleForces(
            along=slow.along,
            across=slow.across,
            load=load,
            steady=slow.steady,
            told=slow.told,
            now=Current(swift[0], swift[1], swift[2], bears, signals.now_rate[YAW_RATE]),
            stir=jnp.maximum(jnp.abs(ahead), state.stir * calms),
            jolt=jnp.maximum(jnp.abs(fast.along - slow.along), state.jolt * calms),
            locking=jnp.where(scene.is_held, state.locking, locking),
            shaken=signals.shaken,
            along_std=split / jnp.maximum(load, 0.1 * jnp.mean(load)) + unsure,
            across_std=force_errors.across(self.balance, signals, scene, split),
            load_std=heave[1:],
            accel=accel,
            lean=lean,
            yaw_accel=signals.rate[YAW_RATE],
            explained=slow.explained,
            drive=torques.drives,
            brake=torques.slows,
            rolling=GRAVITY * jnp.tanh(speed / STANDSTILL_SPEED),
            lever=drive.lever / self.balance.car.mass,
            turned=turned,
            intensity=force_errors.along(
                self.balance, drive, scene, torques.now - torques.smooth, speed, gust, accel
            ),
            gust=gust,
            held=drive.held_std / self.balance.car.mass,
            age=drive.age,
            is_shifting=drive.is_shifting,
            is_brake_unknown=scene.unseen.act,
            may_brake=scene.unseen.may_act,
        )
        new = ForceMeterState(
            traction=traction,
            brakes=brakes,
            torque=torques.smooth,
            age=drive.age,
            explained=jnp.stack([forces.explained, forces.intensity, apart]),
            calm=calm,
            stir=forces.stir,
            jolt=forces.jolt,
            held=jnp.where(scene.is_held, state.held, slow.along),
            locking=forces.locking,
            lean=lean,
            rough=rough,
        )
        return new, forces

    def _leaning(self, state: ForceMeterState, accel: Array, dt: Array) -> tuple[Lean, Float[Array, ""]]:
        """How the body leans, and by how much the accelerometer has told more than torques of late, m/s².

        What rough roads shake the accelerometer by does not make the body lean.
        """
        cause, intensity, apart = state.explained
        apart = apart - jnp.expm1(-dt / _LATELY) * (accel[0] - cause - apart)
        sure = self._tells_all & (state.age < STALE) & (intensity < CALM) & (jnp.abs(apart) < _APART)
        return state.lean.after(jnp.where(sure, cause, accel[0]), dt), apart

    def _pushes(self, state: ForceMeterState, drive: Traction, speed: Array, dt: Array) -> _Torques:
        mass, radius = self.balance.car.mass, self.balance.car.wheel_radius[0]
        most = LARGEST * mass * GRAVITY * radius
        pulling = jnp.clip(drive.drive_torque, -most, most)
        slowing = jnp.minimum(drive.brake_torque, most) * jnp.tanh(speed / STANDSTILL_SPEED)
        now = jnp.concatenate([pulling, slowing])
        share = jnp.where(state.age < STALE, -jnp.expm1(-dt / SMOOTHING), 1.0)
        smooth = state.torque + share * (now - state.torque)
        per = radius * mass
        return _Torques(
            now, smooth, share, jnp.sum(pulling) / per, jnp.sum(smooth[:4]) / per, jnp.sum(smooth[4:]) / per
        )

    def _scene(
        self,
        state: ForceMeterState,
        signals: Signals,
        drive: Traction,
        torques: _Torques,
        accel: tuple[Array, Array],
        load: Array,
        speed: Array,
        slope: Array,
        lightness: Array,
        dt: Array,
    ) -> tuple[Scene, BrakeWatch, Float[Array, ""]]:
        """What the balances need, brakes that no channel tells of, and m/s² that the drive's inertia takes.

        ``accel`` is the specific force, low-passed and as it is; the rest is as in :meth:`read`.
        """
        car = self.balance.car
        mass, radius = car.mass, car.wheel_radius[0]
        smooth, sharp = accel
        drag, direction = car.drag(speed) / mass, jnp.tanh(speed / STANDSTILL_SPEED)
        held = Held(sharp[0], signals.age[ACCEL_X])
        angle, forward = jnp.clip(signals.smooth[STEER], -0.9, 0.9), way(speed)
        bend = held_back(smooth[1], angle, car.cg_to_rear_axle / car.wheelbase)
        coefficient = car.rolling_coefficient(speed)
        felt = held.age < STALE
        lost = lightness * drag + bend + GRAVITY * coefficient * direction
        rotating = drive.inertia / mass - 1
        pushes = lightness * (torques.push - rotating * (smooth[0] - slope)) - lost
        # as torques tell it: what the accelerometer's noise moves would seem to be a load
        gains = (lightness * (torques.drives - torques.slows) - lost - slope) / (1 + lightness * rotating)
        brakes = state.brakes.take(held, pushes, torques.drives, forward, dt)
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
        return scene, brakes, rotating * gains

    def _calmed(
        self, before: Array, fast: Balance, share: Array, rough: Array, axles: Array, dt: Array
    ) -> tuple[Float[Array, "3 2"], Float[Array, "3 2"]]:
        """The axles' F_x by accelerometer and torques, by torques, and F_y, N: low-passed, and current ones
        without noise."""
        current = jnp.stack([by_axle(fast.along), by_axle(fast.told), fast.across])
        bounces = jnp.stack([jnp.zeros(()), jnp.zeros(()), _BOUNCES * rough / GRAVITY])
        noise = self._noise + bounces[:, None]
        share = jnp.stack([share, share, -jnp.expm1(-dt / _BOUNCE_TIME)])
        calm = before + share[:, None] * (current - before)
        return calm, calm + damped(current - calm, noise * axles)

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
