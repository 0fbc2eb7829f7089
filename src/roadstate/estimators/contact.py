"""How each tire meets the road, from what the car measures: slip, slip angle, load, and how sure of them."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.core.errors import InputError
from roadstate.estimators.base import Need, Sample, leaf
from roadstate.estimators.signals import Held
from roadstate.estimators.velocity import STALE, Motion, VelocityObserver, VelocityState
from roadstate.linalg import rss
from roadstate.vehicles.kinematics import Planar, wheel_positions, wheel_steer, wheel_velocities

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_WHEELS = tuple(f"wheel_speed_{w}" for w in WHEELS)
_INERTIAL = ("accel_x", "accel_y", "yaw_rate")
NEEDS = (
    Need("the speed of each wheel, or the car's", (_WHEELS, ("speed",))),
    Need("the steering", (("steer",), ("steering_wheel",))),
    Need("both accelerometers", (("accel_x", "accel_y"),)),
    Need("the yaw rate", (("yaw_rate",),)),
)
"""What a :class:`ContactMeter` needs."""
OPTIONAL = ("speed", "velocity_y", "gear_ratio")
"""What it uses where it is there."""
_UNSEEN_SLIP = 0.05  # 1σ of a longitudinal slip that is not measured
_FRICTION_SHARE = 0.3  # 1σ of the vehicle file's friction, as a share of it
STEER_STD = 0.003
"""1σ of the mean road-wheel angle (offset, compliance), rad, where nothing else is told."""


class Contact(NamedTuple):
    """Where the four tires are, and how sure that is.

    Attributes:
        velocity: (3,) v_x, v_y (m/s) and r (rad/s) of the car.
        steer: mean front road-wheel angle, rad.
        wheel_speed: (4,) ω, rad/s.
        accel: (2,) specific force along x and y, freed of pitch and roll, m/s².
        std: (7,) 1σ of v_x, v_y (m/s), steer (rad) and each ω (rad/s).
        age: s since the oldest of what it is made of was measured.
    """

    velocity: Float[Array, " 3"]
    steer: Float[Array, ""]
    wheel_speed: Float[Array, " 4"]
    accel: Float[Array, " 2"]
    std: Float[Array, " 7"]
    age: Float[Array, ""]


class ContactState(NamedTuple):
    """State of a :class:`ContactMeter`: held channels, and the velocity observer's."""

    held: dict[str, Held]
    velocity: VelocityState | None


class ContactMeter(eqx.Module):
    """Holds what wheels, steering and inertial sensors say, and finds how the car moves.

    Without wheel speeds the wheels are taken to roll freely, give or take a slip of 5 %: what is left to be
    learned is in the lateral forces.

    Attributes:
        channels: canonical channels read.
        direct: v_x and v_y are read as they are measured, instead of through a
            :class:`~roadstate.estimators.velocity.VelocityObserver`, and nothing is freed of pitch and roll.
        speed_scale: 1σ of the speed's relative error, of rolling radii that are not known exactly.
    """

    channels: tuple[str, ...] = eqx.field(static=True)
    direct: bool = eqx.field(static=True)
    speed_scale: Float[Array, ""]
    _has_wheels: bool = eqx.field(static=True)
    _steering: str = eqx.field(static=True)
    _steering_ratio: Float[Array, ""]
    _observer: VelocityObserver | None
    _gain: Float[Array, " 2"]
    _wheel_noise: Float[Array, ""]
    _scale: Float[Array, ""]
    _radius: Float[Array, ""]
    _places: Planar
    _friction: Float[Array, " 2"]
    _noise: Float[Array, " 2"]
    _steer_std: Float[Array, ""]

    def __init__(
        self,
        vehicle: Vehicle,
        available: Collection[str],
        *,
        direct: bool = False,
        steer_std: float = STEER_STD,
    ) -> None:
        self.direct = direct and {"speed", "velocity_y"} <= set(available)
        self._has_wheels = all(w in available for w in _WHEELS)
        self._steering = "steer" if "steer" in available else "steering_wheel"
        if self._steering == "steering_wheel" and vehicle.steering is None:
            raise InputError(
                "a steering-wheel angle without a steering ratio",
                where=f"vehicle '{vehicle.name}'",
                mend="set steering.ratio, or map 'steer'",
            )
        ratio = 1.0 if self._steering == "steer" or vehicle.steering is None else vehicle.steering.ratio
        self._steering_ratio = leaf(ratio)
        self._observer = None if self.direct else VelocityObserver(vehicle, available)
        seen = ("speed", "velocity_y") if self._observer is None else self._observer.channels
        self.channels = tuple(dict.fromkeys((*self._wheels, *_INERTIAL, self._steering, *seen)))
        body = vehicle.body
        leaning = jnp.asarray([0.0 if self.direct else g for g in (body.pitch_gradient, body.roll_gradient)])
        self._gain = 1 + GRAVITY * leaning
        self._wheel_noise = leaf(vehicle.sensors.wheel_speed.noise)
        self._scale = leaf(vehicle.sensors.wheel_speed.scale if self._has_wheels else _UNSEEN_SLIP)
        self.speed_scale = leaf(0.0 if "speed" in available else vehicle.sensors.wheel_speed.scale)
        self._radius = leaf(vehicle.wheels.radius)
        self._friction = jnp.asarray([vehicle.tires.friction, _FRICTION_SHARE * vehicle.tires.friction])
        geometry = vehicle.geometry
        self._places = wheel_positions(
            geometry.cg_to_front_axle, geometry.cg_to_rear_axle, geometry.track_front, geometry.track_rear
        )
        self._noise = jnp.asarray([vehicle.sensors.speed.noise, vehicle.sensors.velocity_y.noise])
        self._steer_std = leaf(steer_std)

    @property
    def _wheels(self) -> tuple[str, ...]:
        return _WHEELS if self._has_wheels else ()

    def init(self) -> ContactState:
        """Nothing has come yet."""
        observer = None if self._observer is None else self._observer.init()
        held = (*self._wheels, *_INERTIAL, self._steering, *(("speed", "velocity_y") if self.direct else ()))
        return ContactState({c: Held.empty() for c in held}, observer)

    def read(
        self,
        state: ContactState,
        sample: Sample,
        dt: Float[Array, ""],
        friction: Float[Array, " 2"] | None = None,
    ) -> tuple[ContactState, Contact]:
        """Take a sample.

        Args:
            state: from :meth:`init` or the last call.
            sample: the channels at this instant.
            dt: s since the last sample.
            friction: peak friction and its 1σ, as far as known; default the vehicle file's, which may be
                far off. It tells slip angles near the limit where no lateral velocity is measured.
        """
        held = {c: state.held[c].take(sample[c], dt) for c in state.held}
        steer = held[self._steering].value / self._steering_ratio
        accel = jnp.stack([held["accel_x"].value, held["accel_y"].value]) / self._gain
        yaw_rate = held["yaw_rate"].value
        ages = jnp.stack([h.age for h in held.values()])
        inertial = jnp.stack([held[c].age for c in (*_INERTIAL, self._steering)])
        if self._observer is None or state.velocity is None:
            velocity = None
            v = jnp.stack([held["speed"].value, held["velocity_y"].value])
            std, age = self._noise, jnp.max(ages)
        else:
            motion = Motion(accel[0], accel[1], yaw_rate, steer, jnp.max(inertial))
            known = self._friction if friction is None else friction
            velocity, gaussian = self._observer.step(state.velocity, sample, motion, known, dt)
            v, std = gaussian.mean[:2], gaussian.std[:2]
            age = jnp.maximum(jnp.max(ages), velocity.age - STALE)
        if self._has_wheels:
            wheel_speed = jnp.stack([held[w].value for w in _WHEELS])
        else:
            moving = wheel_velocities(v[0], v[1], yaw_rate, self._places, wheel_steer(steer))
            wheel_speed = moving.x / self._radius
        rolling = rss(self._wheel_noise, self._scale * wheel_speed)
        spread = jnp.concatenate([std, self._steer_std[None], rolling])
        contact = Contact(jnp.append(v, yaw_rate), steer, wheel_speed, accel, spread, age)
        return ContactState(held, velocity), contact
