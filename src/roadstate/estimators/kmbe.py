"""KMBE: road grade from the kinematics of the longitudinal accelerometer, by a Kalman filter."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
import jax.scipy.linalg as jsl
import numpy as np
from jaxtyping import Array, Float, Int

from roadstate.core.constants import GRAVITY
from roadstate.core.estimates import Validity
from roadstate.core.gaussian import Gaussian, Info
from roadstate.estimators.astray import is_astray, led_back
from roadstate.estimators.base import Estimate, Estimator, Need, Sample, Smoothable, known_only, leaf
from roadstate.estimators.road import GradePrior
from roadstate.estimators.signals import (
    STANDSTILL_SPEED,
    Held,
    SpeedMeter,
    believable,
    random_walk_growth,
    signed_direction,
)
from roadstate.filters import KF, FilterState, GateRule
from roadstate.linalg import root, rss
from roadstate.statespace import StateSpaceModel

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_STALE = 0.5  # s without an acceleration after which it counts as unknown
_SILENT = 3.0  # s without acceleration or speed after which the estimate is called a prediction
_JERK = 1.0  # m/s²/√s: how an acceleration that is not seen wanders
_UNKNOWN_ACCEL = 1.5  # m/s²/√Hz: intensity of an acceleration that is not measured at all
_BIAS_TIME = 600.0  # s: correlation time of an accelerometer's bias
_ALTITUDE_WANDER = 0.02  # m/√m: what the height gains beyond the grade (lanes, crown, GNSS constellation)


class _Input(NamedTuple):
    accel: Float[Array, ""]
    age: Float[Array, ""]
    speed: Float[Array, ""]
    sensor_std: Float[Array, " m"]


class KinematicModel(StateSpaceModel):
    """x = [v_x, s = g sin θ, ds/d(distance) (, accelerometer bias b (, altitude h))].

    v̇_x = a + v_y r − s − b, where a is the accelerometer freed of body pitch; s follows
    :class:`~roadstate.estimators.road.GradePrior`; ḃ = −b/τ + w; ḣ = v s/g, with the speed taken as known
    there. (Paper 002 eq. 38, with the terms it leaves out.)
    """

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    road: GradePrior
    accel_noise: Float[Array, ""]
    bias_std: Float[Array, ""]

    def f(self, x: Float[Array, " n"], u: _Input, dt: Float[Array, ""]) -> Float[Array, " n"]:
        """One step of Δt; exact for inputs constant over it."""
        has_bias = "bias" in self.states
        accel = u.accel - x[1] - (x[3] if has_bias else 0.0)
        speed = x[0] + jnp.where(u.age < _STALE, accel * dt, 0.0)
        road = self.road.transition(u.speed * dt) @ x[1:3]
        rows = [speed, road[0], road[1]]
        if has_bias:
            rows.append(x[3] * jnp.exp(-dt / _BIAS_TIME))
        if "altitude" in self.states:
            rows.append(x[4] + u.speed * dt * x[1] / GRAVITY)
        return jnp.stack(rows)

    def h(self, x: Float[Array, " n"], u: _Input) -> Float[Array, " m"]:
        """Each axle's (or the one) speed; rate of climb v sin θ; altitude."""
        readings = {"vertical_speed": u.speed * x[1] / GRAVITY, "altitude": x[-1]}
        return jnp.stack([readings.get(sensor, x[0]) for sensor in self.sensors])

    def sqrt_Q(self, u: _Input, dt: Float[Array, ""]) -> Float[Array, "n n"]:
        """White accelerometer noise, the wander of an acceleration last seen ``age`` ago, and the road."""
        seen = self.accel_noise**2 * dt + _JERK**2 * random_walk_growth(u.age, dt)
        unseen = _UNKNOWN_ACCEL**2 * dt
        blocks = [
            root(jnp.where(u.age < _STALE, seen, unseen))[None, None],
            self.road.sqrt_Q(u.speed * dt),
        ]
        if "bias" in self.states:
            blocks.append((self.bias_std * root(-jnp.expm1(-2 * dt / _BIAS_TIME)))[None, None])
        if "altitude" in self.states:
            blocks.append((_ALTITUDE_WANDER * root(jnp.abs(u.speed) * dt))[None, None])
        return jnp.asarray(jsl.block_diag(*blocks))

    def sqrt_R(self, u: _Input) -> Float[Array, "m m"]:
        """Independent sensors."""
        return jnp.diag(u.sensor_std)

    def prior(self) -> Gaussian:
        """Any speed a road car has, the road's own grade, the sensor's bias, any altitude on Earth."""
        std = [jnp.asarray(30.0), *self.road.stationary_std]
        if "bias" in self.states:
            std.append(self.bias_std)
        if "altitude" in self.states:
            std.append(jnp.asarray(3000.0))
        return Gaussian(jnp.zeros(len(std)), jnp.diag(jnp.stack(std)))


class KMBEState(NamedTuple):
    """Filter state, held inputs, the time since the last speed (s), and the latest validity."""

    filter: FilterState
    accel: Held
    yaw_rate: Held
    steer: Held
    gear_ratio: Held
    speed_age: Float[Array, ""]
    validity: Int[Array, ""]


class KMBE(Estimator[KMBEState]):
    """Kinematic-model-based estimator of road grade (paper 002's first rival, eq. 38).

    The accelerometer reads a = v̇_x − v_y r + g sin θ (+ bias); the wheels tell v̇_x; what is left is the
    grade. Beyond the paper: the turning term v_y r (v_y from the yaw rate by the rear axle's geometry and
    slip, v_y = l_r r − v |v| r/(g c_r), c_r the rear cornering stiffness per load); the pitch of the body on
    its springs under force (the sensor reads (1 + g k)(v̇_x − v_y r + g sin θ), k the vehicle file's pitch
    gradient); a road whose grade is smooth along its length; and, only where GNSS vertical speed or altitude
    observes it, the accelerometer's bias.

    Needs speed and ``accel_x``. Assumes an IMU near the centre of gravity. Where nothing observes it, a bias
    of b m/s² is a grade error of 100 b/g %: the vehicle file's 1σ of the bias is then part of every standard
    deviation given, as is that of the pitch gradient.

    Attributes:
        model: the state-space model.
        filter: the Kalman filter.
        meter: how speed is read.
    """

    name: ClassVar[str] = "kmbe"
    summary: ClassVar[str] = "grade from speed and longitudinal accelerometer (KF, kinematic)"
    needs: ClassVar[tuple[Need, ...]] = (
        Need("a speed", (("speed",), *((f"wheel_speed_{w}",) for w in ("fl", "fr", "rl", "rr")))),
        Need("the longitudinal accelerometer", (("accel_x",),)),
    )
    optional: ClassVar[tuple[str, ...]] = (
        "yaw_rate",
        "steer",
        "steering_wheel",
        "gear_ratio",
        "vertical_speed",
        "altitude",
    )
    smoothable: ClassVar[Smoothable | None] = Smoothable(
        "filter", "filter", ("grade", "speed", "altitude", "accel_x_bias")
    )

    channels: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    model: KinematicModel
    filter: KF
    meter: SpeedMeter
    pitch_gain: Float[Array, ""]
    pitch_std: Float[Array, ""]
    speed_scale: Float[Array, ""]
    rear_arm: Float[Array, ""]
    rear_stiffness: Float[Array, ""]
    aiding_std: Float[Array, " k"]
    unseen_bias: Float[Array, ""]

    @property
    def sensor_units(self) -> Mapping[str, str]:
        """As :attr:`Estimator.sensor_units`."""
        return {**super().sensor_units, **self.meter.sensor_units}

    @classmethod
    def build(cls, vehicle: Vehicle, available: Collection[str], **options: Any) -> Self:
        """Compose for a vehicle and the channels there.

        Args:
            vehicle: geometry, pitch gradient and sensors' noise are used.
            available: canonical channels with samples.
            options: there are none.

        Raises:
            InputError: there is no speed, or an option is given.
        """
        known_only(options, ())
        meter = SpeedMeter(vehicle, available)
        aiding = [c for c in ("vertical_speed", "altitude") if c in available]
        states = ["speed", "specific_grade", "specific_grade_rate"]
        if aiding:
            states.append("bias")
        if "altitude" in aiding:
            states.append("altitude")
        sensors = (*meter.sensors, *aiding)
        used = tuple(c for c in ("accel_x", "yaw_rate") if c in available)
        accel = vehicle.sensors.accel
        model = KinematicModel(
            states=tuple(states),
            sensors=sensors,
            road=GradePrior(
                leaf(GRAVITY * vehicle.prior.grade_std), leaf(vehicle.prior.grade_correlation_length)
            ),
            accel_noise=leaf(accel.noise_density),
            bias_std=leaf(accel.bias),
        )
        return cls(
            channels=tuple(dict.fromkeys((*meter.channels, *used, *aiding))),
            sensors=sensors,
            model=model,
            filter=KF(gate=GateRule()),
            meter=meter,
            pitch_gain=leaf(1 + GRAVITY * vehicle.body.pitch_gradient),
            pitch_std=leaf(vehicle.prior.pitch_gradient_std),
            speed_scale=leaf(vehicle.sensors.wheel_speed.scale),
            rear_arm=leaf(vehicle.geometry.cg_to_rear_axle),
            rear_stiffness=leaf(vehicle.tires.cornering_stiffness_rear),
            aiding_std=jnp.asarray(np.array([getattr(vehicle.sensors, a).noise for a in aiding])),
            unseen_bias=leaf(0.0 if aiding else accel.bias),
        )

    def init(self) -> KMBEState:
        """The prior; no sample has come."""
        empty = Held.empty()
        return KMBEState(
            self.filter.init(self.model),
            empty,
            empty,
            empty,
            empty,
            empty.age,
            jnp.asarray(Validity.SENSOR_MISSING),
        )

    def step(self, state: KMBEState, sample: Sample, dt: Float[Array, ""]) -> tuple[KMBEState, Info]:
        """Predict with the acceleration, correct with speed and whatever aids."""
        nothing, sample = jnp.full((), jnp.nan), believable(sample)
        accel = state.accel.take(sample["accel_x"], dt)
        yaw_rate = state.yaw_rate.take(sample.get("yaw_rate", nothing), dt)
        steer = state.steer.take(self.meter.steer(sample), dt)
        gear = state.gear_ratio.take(sample.get("gear_ratio", nothing), dt)
        fresh = accel.age == 0
        between = jnp.where(
            fresh & (state.accel.age < _STALE), (accel.value + state.accel.value) / 2, accel.value
        )
        turning = jnp.where(yaw_rate.age < _STALE, yaw_rate.value, 0.0)
        speed = state.filter.gaussian.mean[0]
        side_slip = turning * (self.rear_arm - speed * jnp.abs(speed) / (GRAVITY * self.rear_stiffness))
        speeds, speed_std = self.meter.read(sample, turning, steer.value, signed_direction(gear.value))
        u = _Input(
            accel=between / self.pitch_gain + side_slip * turning,
            age=jnp.where(fresh, 0.0, state.accel.age),
            speed=speed,
            sensor_std=jnp.concatenate([speed_std, self.aiding_std]),
        )
        aiding = [sample[c] for c in self.sensors[len(speeds) :]]
        z = jnp.concatenate([speeds, jnp.stack(aiding)]) if aiding else speeds
        filter_state, info = self.filter.step(self.model, state.filter, u, z, dt)
        mean = filter_state.gaussian.mean
        astray = is_astray(filter_state.gaussian, mean[0], mean[1])
        filter_state = led_back(astray, self.model.prior(), filter_state)
        speed_age = jnp.where(jnp.any(jnp.isfinite(speeds)), 0.0, state.speed_age + dt)
        stands = jnp.abs(filter_state.gaussian.mean[0]) < STANDSTILL_SPEED
        silent = (speed_age > _SILENT) | (accel.age > _SILENT)
        validity = jnp.where(stands, Validity.STANDSTILL, Validity.EXCITED)
        validity = jnp.where(silent, Validity.SENSOR_MISSING, validity)
        validity = jnp.where(info.ok & ~astray, validity, Validity.DIVERGED)
        return KMBEState(filter_state, accel, yaw_rate, steer, gear, speed_age, validity), info

    def estimate(self, state: KMBEState) -> Estimate:
        """Grade and speed, and where they are observed bias and altitude."""
        gaussian = self.filter.posterior(state.filter)
        mean, std = gaussian.mean, gaussian.std
        sine = jnp.clip(mean[1] / GRAVITY, -0.99, 0.99)
        grade = jnp.arcsin(sine)
        force_pitch = self.pitch_std * state.accel.value
        spread = jnp.sqrt(std[1] ** 2 + self.unseen_bias**2 + (GRAVITY * force_pitch) ** 2)
        values = {"grade": grade, "speed": mean[0]}
        stds = {
            "grade": spread / (GRAVITY * jnp.cos(grade)),
            "speed": rss(std[0], self.speed_scale * mean[0]),
        }
        for i, name in ((3, "accel_x_bias"), (4, "altitude")):
            if len(self.model.states) > i:
                values[name], stds[name] = mean[i], std[i]
        return Estimate(values, stds, state.validity)
