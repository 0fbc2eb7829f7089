"""From samples to a model's inputs: signals held between samples, and the speed that wheels tell."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core.channels import WHEELS
from roadstate.core.errors import InputError
from roadstate.estimators.base import Sample
from roadstate.linalg import rss

if TYPE_CHECKING:
    from collections.abc import Collection

    from roadstate.vehicles import Vehicle

STANDSTILL_SPEED = 0.3
"""Below this speed (m/s) the car is taken to stand."""
_DEAD_BAND = 0.7
"""Below this speed (m/s) a wheel's tooth sensor may read anything down to zero."""
_DEAD_BAND_STD = 0.25
_DRIVEN_NOISE = 2.0  # how much less a driven axle is trusted than one that rolls freely
_LEAST_STEP = 1e-3  # s
_WHEELS = tuple(f"_{w}" for w in WHEELS)
NEVER = 1e6
"""s: age of what has not come yet."""


LARGEST = {
    "accel_x": 50.0,
    "accel_y": 50.0,
    "yaw_rate": 4.0,
    "yaw_accel": 100.0,
    "steer": 1.5,
    "steering_wheel": 30.0,
    "wheel_speed": 500.0,
    "speed": 150.0,
    "velocity_y": 50.0,
    "vertical_speed": 50.0,
    "altitude": 1e4,
    "drive_torque": 3e4,
    "brake_torque": 3e4,
    "brake_pressure": 5e7,
    "engine_torque": 1e4,
    "engine_speed": 2500.0,
    "gear_ratio": 100.0,
}
"""More than that no road vehicle makes, in SI units, however often it is told."""


def largest_of(channel: str) -> float | None:
    """Of :data:`LARGEST`, in which a wheel's channels share an entry; ``None`` where any value may be."""
    return LARGEST.get(channel[:-3] if channel.endswith(_WHEELS) else channel)


def believable(sample: Sample) -> Sample:
    """Without what no road vehicle makes, as error codes and what a logger writes for nothing: NaN instead.

    A gate refuses a wild measurement; of a wild input, which moves the state, a filter cannot know.
    """

    def limited(value: Float[Array, ""], largest: float | None) -> Float[Array, ""]:
        return value if largest is None else jnp.where(jnp.abs(value) <= largest, value, jnp.nan)

    return {channel: limited(value, largest_of(channel)) for channel, value in sample.items()}


class Held(NamedTuple):
    """A channel's latest sample and how old it is (s); a huge age before the first one."""

    value: Float[Array, ""]
    age: Float[Array, ""]

    @classmethod
    def empty(cls) -> Held:
        """Nothing has come yet."""
        return cls(jnp.zeros(()), jnp.full((), NEVER))

    def take(self, sample: Float[Array, ""], dt: Float[Array, ""]) -> Held:
        """A sample ``dt`` later, NaN where none came (an infinite one is none)."""
        here = jnp.isfinite(sample)
        return Held(jnp.where(here, sample, self.value), jnp.where(here, 0.0, self.age + dt))


def random_walk_growth(age: Float[Array, ""], dt: Float[Array, ""]) -> Float[Array, ""]:
    """Growth over Δt of ∫∫ of a unit random walk that began ``age`` ago: ((age+Δt)³ − age³)/3.

    So the variance that a held input adds to its integral comes out right however the time is cut up.
    """
    return dt * (age * (age + dt) + dt * dt / 3)


def span(age: Float[Array, ...], dt: Float[Array, ""], longest: float) -> Float[Array, ...]:
    """What time, s, samples count for that come ``dt`` after others of their channels, ``age`` old.

    Errors that last are averaged by how many samples of theirs fit in, whatever other channels come between.

    Args:
        age: s, of any shape.
        dt: s.
        longest: s, the most that one sample counts for.
    """
    return jnp.clip(age + dt, _LEAST_STEP, longest)


def signed_direction(gear_ratio: Float[Array, ""]) -> Float[Array, ""]:
    """−1 in a reverse gear, else 1 (also where the ratio is unknown): the sign of an unsigned speed."""
    return jnp.where(gear_ratio < 0, -1.0, 1.0)


def signed(speed: Float[Array, ...], direction: Float[Array, ""]) -> Float[Array, ...]:
    """A speed with the sign of the motion: that of ``direction`` where it has none of its own."""
    return jnp.where(speed < 0, speed, direction * speed)


def way(speed: Float[Array, ""]) -> Float[Array, ""]:
    """−1 where the car backs up, m/s, else 1 (also where it stands): whither brakes do not push it."""
    return jnp.where(speed < -STANDSTILL_SPEED, -1.0, 1.0)


def _split(sample: Float[Array, ""]) -> tuple[Bool[Array, ""], Float[Array, ""]]:
    """Whether a sample is there, and its value or 0: a NaN would spoil the derivative by any factor of it."""
    seen = jnp.isfinite(sample)
    return seen, jnp.where(seen, sample, 0.0)


class SpeedMeter(eqx.Module):
    """Velocity of the centre of gravity along x, from each axle's wheel speeds, or from a speed signal.

    A wheel of rolling radius R gives R ω cos δ = v_x ∓ r T/2 (left minus; exact but for the slip angle), so
    an axle's mean, each wheel freed of its yaw part, is v_x. A driven axle slips in proportion to its
    force, hence its extra noise where the other rolls freely. Both axles are sensors of their own, so that a
    spinning one can be gated.

    Attributes:
        channels: canonical channels read.
        sensors: rows given by :meth:`read`.
    """

    channels: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    _axles: tuple[int, ...] = eqx.field(static=True)
    _steering: str | None = eqx.field(static=True)
    _radius: Float[Array, ""]
    _half_track: Float[Array, " 2"]
    _noise: Float[Array, " s"]
    _steering_ratio: Float[Array, ""]

    def __init__(self, vehicle: Vehicle, available: Collection[str]) -> None:
        noise: list[float] = []
        axles: list[int] = []
        radius = vehicle.wheels.radius
        for axle, label in enumerate(("front", "rear")):
            if any(f"wheel_speed_{w}" in available for w in WHEELS[2 * axle : 2 * axle + 2]):
                slips = vehicle.driveline.driven == label
                axles.append(axle)
                noise.append(radius * vehicle.sensors.wheel_speed.noise * (_DRIVEN_NOISE if slips else 1.0))
        wheels = tuple(f"wheel_speed_{w}" for a in axles for w in WHEELS[2 * a : 2 * a + 2])
        if axles:
            self.sensors = tuple(f"wheel_speed_{('front', 'rear')[a]}" for a in axles)
            used = tuple(w for w in wheels if w in available)
        elif "speed" in available:
            self.sensors, used, noise = ("speed",), ("speed",), [vehicle.sensors.speed.noise]
        else:
            raise InputError("no speed", mend="map 'speed' or 'wheel_speed_*'")
        self._steering = None
        if axles and "steer" in available:
            self._steering = "steer"
        elif axles and "steering_wheel" in available and vehicle.steering is not None:
            self._steering = "steering_wheel"
        extra = tuple(c for c in (self._steering, "gear_ratio") if c is not None and c in available)
        self.channels = used + extra
        self._axles = tuple(axles)
        self._radius = jnp.asarray(radius)
        geometry = vehicle.geometry
        self._half_track = jnp.asarray(np.array([geometry.track_front / 2, geometry.track_rear / 2]))
        self._noise = jnp.asarray(np.array(noise))
        self._steering_ratio = jnp.asarray(
            1.0 if self._steering != "steering_wheel" or vehicle.steering is None else vehicle.steering.ratio
        )

    @property
    def sensor_units(self) -> dict[str, str]:
        """All are speeds."""
        return dict.fromkeys(self.sensors, "m/s")

    def read(
        self, sample: Sample, yaw_rate: Float[Array, ""], steer: Float[Array, ""], direction: Float[Array, ""]
    ) -> tuple[Float[Array, " s"], Float[Array, " s"]]:
        """Speeds (s,) in m/s, NaN where missing, and their standard deviations (s,).

        Args:
            sample: the channels at this instant.
            yaw_rate: rad/s.
            steer: mean front road-wheel angle in rad.
            direction: −1 where an unsigned speed means backward.
        """
        if not self._axles:
            seen, speed = _split(sample["speed"])
            speeds = jnp.where(seen, signed(speed, direction), jnp.nan)[None]
        else:
            rows = []
            for axle in self._axles:
                along = jnp.cos(steer) if axle == 0 else jnp.ones_like(steer)
                here, sides = [], []
                for wheel, side in zip(WHEELS[2 * axle : 2 * axle + 2], (1.0, -1.0), strict=True):
                    if f"wheel_speed_{wheel}" in self.channels:
                        seen, turning = _split(sample[f"wheel_speed_{wheel}"])
                        rolling = self._radius * turning * along
                        beside = side * self._half_track[axle] * along**2
                        moves = signed(rolling, direction) + beside * yaw_rate
                        here.append(seen)
                        sides.append(jnp.where(seen, moves, 0))
                count = sum(here, jnp.zeros((), jnp.int32))
                mean = sum(sides, jnp.zeros(())) / jnp.maximum(count, 1)
                rows.append(jnp.where(count > 0, mean, jnp.nan))
            speeds = jnp.stack(rows)
        slow = jnp.where(jnp.abs(speeds) < _DEAD_BAND, _DEAD_BAND_STD, 0.0)
        return speeds, rss(self._noise, slow)

    def steer(self, sample: Sample) -> Float[Array, ""]:
        """Mean front road-wheel angle (rad) at this sample, NaN where missing or not measured."""
        if self._steering is None:
            return jnp.full((), jnp.nan)
        seen, angle = _split(sample[self._steering])
        return jnp.where(seen, angle / self._steering_ratio, jnp.nan)
