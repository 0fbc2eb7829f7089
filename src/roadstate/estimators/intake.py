"""What a car's raw signals become before a filter sees them: held, freed of spikes, smoothed."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.core.errors import InputError
from roadstate.estimators.base import Sample, leaf
from roadstate.estimators.blur import Blur
from roadstate.estimators.quadratic import Quadratic
from roadstate.estimators.shaking import Shaking
from roadstate.estimators.signals import NEVER, largest_of, signed_direction

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

WHEEL_SPEEDS = tuple(f"wheel_speed_{w}" for w in WHEELS)
ROWS = ("accel_x", "accel_y", "yaw_rate", "steer", *WHEEL_SPEEDS)
"""Order of what :class:`Signals` carries in vectors of eight."""
ACCEL_X, ACCEL_Y, YAW_RATE, STEER, SPIN = 0, 1, 2, 3, slice(4, 8)
INERTIAL = slice(ACCEL_X, YAW_RATE)
SMOOTHING = 0.05
"""s: time constant of the low pass that all signals go through alike, so that they stay comparable."""
# s over which each signal is fitted where it is wanted without that lag, and for which noises of
# accelerometer and gyroscope; more noise asks for more, by the third root
_MEMORY = (0.035, 0.07, 0.035, 0.05, 0.04, 0.04, 0.04, 0.04)
_USUAL = (0.03, 0.005)  # m/s²/√Hz, and rad/s of a sample
_LEAST_MEMORY = 0.5  # share of that, at the least
# s: age of inertial signals, with the body's roll; wheels' speeds shall be no less late than torques
_LATE = (0.008, 0.008, 0.008, 0.0, -0.01, -0.01, -0.01, -0.01)
STALE = 0.3
"""s without a sample after which a signal is no longer held."""
_LARGEST = tuple(map(largest_of, ROWS))
_LARGEST_JUMP = (8.0, 8.0, 0.6, 0.2, 25.0, 25.0, 25.0, 25.0)  # in _JUMP_TIME; more is a spike
_JUMP_TIME = 0.1  # s
_SPIN_UP = (6.0, 1000.0)  # rad/s, and rad/s²: what noise, and brakes or drive, change a wheel's speed by
_PATIENCE = 4  # samples in a row that a jump must last to be believed
REPEATS = 40  # equal samples in a row after which a signal may be stuck
# change meanwhile of what tells the same, m/s², m/s², rad/s, never, rad/s: then it is stuck
_ACTIVE = (0.5, 0.8, 0.06, np.inf, 3.0, 3.0, 3.0, 3.0)
_PER_ACCEL = 2.0  # rad/s per m/s²: that the acceleration changes tells as much of a wheel as that others do
# of a speed that wheels do not tell: share that a sample has, m/s it changes it by at most, what it counts
_OTHER = (0.4, 1.0, 0.7)
# s between samples of an inertial signal that is sparse: in between what a bend does is taken to go on as it
# has changed from one to the next; and s after the last one for which it does
_SPARSE, _GOES_ON = (0.03, 0.15), 0.1
_SWERVES = np.isin(np.arange(8), (ACCEL_Y, YAW_RATE))
_LEAST_STEP = 1e-3  # s
_SLOWEST = 1.0  # m/s below which a car's signals may well stand still
FASTEST_BACKWARD = 8.0
"""m/s from which on a car that nobody saw go backward by its gear does not back up."""
_TURNED = (3.0, 0.2)  # m/s from which on no wheel turns round at once; share of it by which it may differ


def sensor_fault_names(named: Sequence[str | None], sensors: Sequence[str]) -> tuple[str, ...]:
    """Sentences: each signal of :data:`ROWS` that is faulty, each wheel whose sign is wrong, each sensor of a
    filter that is refused."""
    return (
        *(f"{name or row}: stuck, or jumps as no car does" for row, name in zip(ROWS, named, strict=True)),
        *(f"{wheel}: wrong sign (put right here); flip it in the mapping" for wheel in WHEEL_SPEEDS),
        *(f"{s}: refused, contradicts the motion" for s in sensors),
    )


class SignalState(NamedTuple):
    """State of an :class:`Intake`.

    Attributes:
        value: (8,) latest samples believed, in the order of :data:`ROWS`.
        age: (8,) s since they came.
        steep: (8,) how fast an inertial signal that comes sparsely changes, per s; 0 of any other.
        refused: (8,) samples refused in a row as spikes.
        repeats: (8,) equal samples in a row.
        low, high: (8,) range, since the last change of a signal, of what tells the same.
        smooth: (8,) low-passed values.
        blur: what that makes of them.
        fit: and what they are now.
        shaking: of the accelerometers.
        gear: latest gear ratio.
        other: speed that wheels do not tell, smoothed, m/s; huge before any came.
        sense: (4,) 1 of a wheel whose sign is right, -1 where it is swapped, 0 before that is known.
    """

    value: Float[Array, " 8"]
    age: Float[Array, " 8"]
    steep: Float[Array, " 8"]
    refused: Float[Array, " 8"]
    repeats: Float[Array, " 8"]
    low: Float[Array, " 8"]
    high: Float[Array, " 8"]
    smooth: Float[Array, " 8"]
    blur: Blur
    fit: Quadratic
    shaking: Shaking
    gear: Float[Array, ""]
    other: Float[Array, ""]
    sense: Float[Array, " 4"]


class Signals(NamedTuple):
    """The car's signals at one instant, in the order of :data:`ROWS`.

    Attributes:
        value: (8,) held, or going on as they changed; specific forces freed of the body's pitch and roll;
            steer at the road wheels; wheel speeds signed. m/s², rad/s, rad.
        age: (8,) s since a sample came; of a stuck one :data:`STALE` and more.
        is_fresh: (8,) whether a believed sample came just now.
        smooth: (8,) low-passed.
        rate: (8,) derivative of ``smooth``.
        lag: (8,) s by which ``smooth`` is late.
        noise: (8,) variance that it has of a sample's independent error of variance 1.
        now, now_rate: (8,) the same two without the low pass's lag, noisier.
        shaken: (2,) root mean square of what the road shakes the accelerometers by, m/s².
        is_faulty: (8,) a sensor that is stuck, or whose samples are refused.
    """

    value: Float[Array, " 8"]
    age: Float[Array, " 8"]
    is_fresh: Bool[Array, " 8"]
    smooth: Float[Array, " 8"]
    rate: Float[Array, " 8"]
    lag: Float[Array, " 8"]
    noise: Float[Array, " 8"]
    now: Float[Array, " 8"]
    now_rate: Float[Array, " 8"]
    shaken: Float[Array, " 2"]
    is_faulty: Bool[Array, " 8"]

    def scaled(self, factor: Float[Array, " 8"]) -> Signals:
        """As if each were so many times as large."""
        value, smooth, rate = factor * self.value, factor * self.smooth, factor * self.rate
        now, now_rate = factor * self.now, factor * self.now_rate
        return self._replace(value=value, smooth=smooth, rate=rate, now=now, now_rate=now_rate)


class Intake(eqx.Module):
    """Takes samples of whatever inertial, steering and wheel signals there are.

    A sample that lies too far from the last one to be true is refused, until several in a row say the same;
    one that no car could make, always.
    Wheels that tell forward for backward are put right: no wheel turns round at speed from one sample to the
    next, nor otherwise than the others do, nor does a car begin with driving backward fast. A
    signal that repeats itself to the last bit while its kin change (an accelerometer while the wheels'
    acceleration changes, a gyroscope while the rear wheels' difference does, a wheel while the others, the
    acceleration or a speed that is not the wheels' do) is stuck, and counts as missing.

    Attributes:
        channels: canonical channels read.
        named: channel of each row of :data:`ROWS`, ``None`` where there is none.
        has: whether a row is measured at all.
        memory: (8,) s over which each row is fitted.
        ahead: of the centre of gravity sits the accelerometer, m.
    """

    channels: tuple[str, ...] = eqx.field(static=True)
    named: tuple[str | None, ...] = eqx.field(static=True)
    has: tuple[bool, ...] = eqx.field(static=True)
    memory: Float[Array, " 8"]
    ahead: Float[Array, ""]
    _scale: Float[Array, " 8"]
    _geometry: Float[Array, " 2"]

    def __init__(self, vehicle: Vehicle, available: Collection[str]) -> None:
        steering = "steer" if "steer" in available else "steering_wheel"
        if steering not in available or (steering == "steering_wheel" and vehicle.steering is None):
            if steering in available:
                raise InputError(
                    "a steering-wheel angle without a steering ratio",
                    where=f"vehicle '{vehicle.name}'",
                    mend="set steering.ratio, or map 'steer'",
                )
            steering = ""
        named = ("accel_x", "accel_y", "yaw_rate", steering, *WHEEL_SPEEDS)
        self.named = tuple(name if name in available else None for name in named)
        self.has = tuple(name is not None for name in self.named)
        used = [name for name in self.named if name is not None]
        self.channels = (*used, *(c for c in ("gear_ratio", "speed") if c in available))
        ratio = vehicle.steering.ratio if steering == "steering_wheel" and vehicle.steering else 1.0
        sensors, body = vehicle.sensors, vehicle.body
        noise = np.array([sensors.accel.noise_density, sensors.yaw_rate.noise]) / _USUAL
        more = np.maximum(np.cbrt(noise), _LEAST_MEMORY)
        self.memory = jnp.asarray(_MEMORY * np.array([more[0], more[0], more[1], 1, 1, 1, 1, 1]))
        self.ahead = leaf(sensors.accel.ahead)
        lean = [1 + GRAVITY * body.pitch_gradient, 1 + GRAVITY * body.roll_gradient]
        self._scale = jnp.asarray(1 / np.array([*lean, 1.0, ratio, 1.0, 1.0, 1.0, 1.0]))
        self._geometry = jnp.asarray(np.array([vehicle.wheels.radius, vehicle.geometry.track_rear]))

    def init(self) -> SignalState:
        """Nothing has come yet."""
        none = jnp.zeros(8)
        return SignalState(
            none,
            none + NEVER,
            none,
            none,
            none,
            none,
            none,
            none,
            Blur.start(8),
            Quadratic.start(8),
            Shaking.still(2),
            none[0],
            none[0] + NEVER,
            none[SPIN],
        )

    def read(
        self, state: SignalState, sample: Sample, speed: Float[Array, ""], dt: Float[Array, ""]
    ) -> tuple[SignalState, Signals]:
        """Take a sample ``dt`` after the last.

        Args:
            state: from :meth:`init` or the last call.
            sample: the channels at this instant.
            speed: m/s, the estimate so far.
            dt: s.
        """
        nothing = jnp.full((), jnp.nan)
        raw = jnp.stack([nothing if n is None else sample[n] for n in self.named])
        gear = sample["gear_ratio"] if "gear_ratio" in self.channels else nothing
        gear = jnp.where(jnp.isfinite(gear), gear, state.gear)
        speed_signal = sample["speed"] if "speed" in self.channels else nothing
        heard, silent = jnp.isfinite(speed_signal), state.other >= NEVER
        change = jnp.clip(speed_signal - state.other, -_OTHER[1], _OTHER[1])
        other = jnp.where(
            heard, jnp.where(silent, speed_signal, state.other + _OTHER[0] * change), state.other
        )
        told = jnp.isfinite(raw)
        seen = told & (jnp.abs(raw * self._scale) <= jnp.asarray(_LARGEST))
        raw = jnp.where(seen, raw, jnp.nan)
        sense = self._sense(state, raw[SPIN], speed, gear)
        direction = signed_direction(gear)
        turned = jnp.where(sense < 0, -1.0, jnp.where(raw[SPIN] < 0, 1.0, direction))
        turned = jnp.concatenate([jnp.ones(SPIN.start), turned])
        fresh = jnp.where(seen, raw, 0.0) * self._scale * turned
        since = state.age + dt
        most = jnp.asarray(_LARGEST_JUMP) * jnp.maximum(1.0, since / _JUMP_TIME)
        most = most.at[SPIN].min(_SPIN_UP[0] + _SPIN_UP[1] * since[SPIN])
        far = seen & (jnp.abs(fresh - state.value) > most) & (state.age < 10 * STALE)
        refuse = far & (state.refused < _PATIENCE)
        taken = seen & (~refuse)
        same = taken & (fresh == state.value)
        repeats = jnp.where(taken, jnp.where(same, state.repeats + 1, 0.0), state.repeats)
        value = jnp.where(taken, fresh, state.value)
        kin = self._kin(state, value, speed, other)
        goes_on = (repeats > 0) & ~(heard & silent)
        low = jnp.where(goes_on, jnp.minimum(state.low, kin), kin)
        high = jnp.where(goes_on, jnp.maximum(state.high, kin), kin)
        active = (high - low > jnp.asarray(_ACTIVE)) & (jnp.abs(speed) > _SLOWEST)
        # a wheel that is locked stands still for good reason
        stuck = (repeats >= REPEATS) & active & ((np.arange(8) < SPIN.start) | (value != 0))
        age = jnp.where(taken, 0.0, since)
        first = state.age > STALE  # what was before a silence says nothing of how it changes now
        lag = jnp.where(first, 1.0, -jnp.expm1(-dt / SMOOTHING))
        sparse = (since >= _SPARSE[0]) & (since <= _SPARSE[1]) & (np.arange(8) < STEER)
        slope = (value - state.value) / jnp.maximum(since, _LEAST_STEP)
        steep = jnp.where(taken, jnp.where(sparse, slope, 0.0), state.steep)
        swerves = jnp.where(_SWERVES, steep, 0.0)
        current = value + swerves * jnp.minimum(age, _GOES_ON)
        smooth = state.smooth + lag * (current - state.smooth)
        blur = state.blur.take(lag, jnp.where(swerves == 0, age, 0.0), STALE, dt)
        fit = state.fit.take(current, first, self.memory, dt)
        now, now_rate = fit.ahead(jnp.asarray(_LATE))
        shaking = state.shaking.take(
            value[INERTIAL], taken[INERTIAL], since[INERTIAL] > STALE, since[INERTIAL]
        )
        refused = jnp.where(refuse, state.refused + 1, jnp.where(taken, 0.0, state.refused))
        signals = Signals(
            value=current,
            age=jnp.where(stuck, jnp.maximum(age, 2 * STALE), age),
            is_fresh=taken & (~stuck),
            smooth=smooth,
            rate=jnp.where(first, 0.0, (smooth - state.smooth) / jnp.maximum(dt, _LEAST_STEP)),
            lag=blur.lag,
            noise=blur.noise,
            now=now,
            now_rate=now_rate,
            shaken=shaking.size,
            is_faulty=stuck | (refused > 0) | (told & ~seen),
        )
        return SignalState(
            value, age, steep, refused, repeats, low, high, smooth, blur, fit, shaking, gear, other, sense
        ), signals

    def centred(self, signals: Signals) -> Signals:
        """As an accelerometer in the centre of gravity would read: one x ahead of it is pulled by −x r² along
        the car and by x ṙ across."""
        turns = signals.age[YAW_RATE] < STALE

        def freed(values: Float[Array, " 8"], rates: Float[Array, " 8"]) -> Float[Array, " 8"]:
            pulled = self.ahead * jnp.stack([-(values[YAW_RATE] ** 2), rates[YAW_RATE]])
            return values.at[INERTIAL].add(jnp.where(turns, -pulled, 0.0))

        value, smooth = freed(signals.value, signals.now_rate), freed(signals.smooth, signals.rate)
        return signals._replace(value=value, smooth=smooth, now=freed(signals.now, signals.now_rate))

    def _sense(
        self, state: SignalState, raw: Float[Array, " 4"], speed: Float[Array, ""], gear: Float[Array, ""]
    ) -> Float[Array, " 4"]:
        """What is known of the wheels' signs after samples (4,) in rad/s."""
        fast, share = _TURNED
        sense, radius = state.sense, self._geometry[0]
        rims = radius * raw
        told = rims * jnp.where(sense < 0, -1.0, 1.0)
        forward = (gear >= 0) & (speed > fast)
        rolled = jnp.abs(radius * state.value[SPIN] - speed) < share * speed
        alone = (sense == 0) & jnp.any(sense > 0)
        turns = forward & (rolled | alone) & (jnp.abs(told + speed) < share * speed)
        begins = (
            (gear >= 0) & (sense == 0) & (rims < -fast) & jnp.any((sense == 0) & (rims < -FASTEST_BACKWARD))
        )
        known = jnp.where((sense == 0) & (rims > fast), 1.0, sense)
        return jnp.where(begins, -1.0, jnp.where(turns, jnp.where(sense < 0, 1.0, -1.0), known))

    def _kin(
        self, state: SignalState, value: Float[Array, " 8"], speed: Float[Array, ""], other: Float[Array, ""]
    ) -> Float[Array, " 8"]:
        """What else tells of the longitudinal and lateral acceleration, yaw rate and wheels, roughly."""
        radius, track = self._geometry
        rim = (value[SPIN] - state.smooth[SPIN]) / SMOOTHING * radius
        along = jnp.mean(rim)
        differ = state.smooth[SPIN][3] - state.smooth[SPIN][2] if self.has[6] and self.has[7] else 0.0
        turning = radius * differ / track
        across = speed * jnp.where(state.age[YAW_RATE] < STALE, state.smooth[YAW_RATE], turning)
        others = (jnp.sum(value[SPIN]) - value[SPIN]) / 3 + _PER_ACCEL * state.smooth[ACCEL_X]
        others = others + _OTHER[2] * other / radius
        return jnp.concatenate([jnp.stack([0.5 * along, across, turning, jnp.zeros_like(along)]), others])
