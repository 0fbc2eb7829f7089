"""How the car really moves over ground: v_x and v_y, from whatever tells of them."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from roadstate.core.constants import GRAVITY
from roadstate.core.gaussian import Gaussian
from roadstate.estimators.base import Sample, leaf
from roadstate.estimators.signals import Held, SpeedMeter, signed, signed_direction, span
from roadstate.filters import KF, FilterState, GateRule
from roadstate.linalg import root, rss
from roadstate.statespace import StateSpaceModel

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

STALE = 0.3
"""Seconds without a sample after which a signal is no longer held."""
_SLOPE_TIME = 5.0  # s: how long slope, bank and accelerometer bias keep their value
_UNSEEN = 2.0  # m/s²/√Hz: intensity of an acceleration that is not measured
_SLIP_TIME = 0.3  # s: correlation time of what wheels slip
_MODEL_TIME = 0.5  # s: of the single-track model's error
_MODEL_ANGLE = 0.003  # rad: that error on a straight
_MODEL_SHARE = 0.2  # of the slip angle: that error from a stiffness that is not known exactly
_FULLEST = 0.97  # share of the friction beyond which a slip angle could be anything
_LEAST_FRICTION = 0.1
_LEAST_STEP = 1e-3  # s: under it a correlated error counts as one of such a step
_LEAD_FREE = 0.5  # m/s by which a wheel may differ from the integrated acceleration, and twice the 1σ of that
_LEAD_GROWTH = 3.0  # 1σ of a wheel that spins or locks, over what it is away beyond that
_PATIENCE = 300  # samples for which a spinning or locked axle may be refused


class _Input(NamedTuple):
    accel_x: Float[Array, ""]
    accel_y: Float[Array, ""]
    yaw_rate: Float[Array, ""]
    intensity: Float[Array, " 2"]
    sensor_std: Float[Array, " m"]


class PlanarVelocity(StateSpaceModel):
    """x = [v_x, v_y, s]: v̇_x = a_x − s + v_y r, v̇_y = a_y − v_x r, ṡ = −s/τ + w.

    a_x and a_y are specific forces freed of the body's pitch and roll, s what a slope (and a bias) adds to
    the first; what a bank adds to the second counts as noise. Linear, for r is measured.
    """

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    slope_std: Float[Array, ""]

    def f(self, x: Float[Array, " 3"], u: _Input, dt: Float[Array, ""]) -> Float[Array, " 3"]:
        """Explicit Euler; inputs are held."""
        along = u.accel_x - x[2] + x[1] * u.yaw_rate
        across = u.accel_y - x[0] * u.yaw_rate
        return jnp.stack([x[0] + along * dt, x[1] + across * dt, x[2] * jnp.exp(-dt / _SLOPE_TIME)])

    def h(self, x: Float[Array, " 3"], u: _Input) -> Float[Array, " m"]:
        """v_y for the lateral sensors, v_x for the others."""
        return jnp.stack([x[1] if sensor.startswith("velocity_y") else x[0] for sensor in self.sensors])

    def sqrt_Q(self, u: _Input, dt: Float[Array, ""]) -> Float[Array, "3 3"]:
        """White acceleration noise, and the slope's."""
        wander = self.slope_std * root(-jnp.expm1(-2 * dt / _SLOPE_TIME))
        return jnp.diag(jnp.append(u.intensity * root(dt), wander))

    def sqrt_R(self, u: _Input) -> Float[Array, "m m"]:
        """Independent sensors."""
        return jnp.diag(u.sensor_std)

    def prior(self) -> Gaussian:
        """Any speed a road car has."""
        return Gaussian(
            jnp.zeros(3), jnp.diag(jnp.stack([jnp.asarray(30.0), jnp.asarray(1.0), self.slope_std]))
        )


class VelocityState(NamedTuple):
    """State of a :class:`VelocityObserver`.

    Attributes:
        filter: the filter's.
        gear_ratio: held.
        age: s for which nothing has told the speed.
    """

    filter: FilterState
    gear_ratio: Held
    age: Float[Array, ""]


class Motion(NamedTuple):
    """Planar motion at one instant.

    Attributes:
        accel_x, accel_y: specific force freed of pitch and roll, m/s².
        yaw_rate: rad/s.
        steer: mean front road-wheel angle, rad.
        age: s since the oldest of them was measured.
    """

    accel_x: Float[Array, ""]
    accel_y: Float[Array, ""]
    yaw_rate: Float[Array, ""]
    steer: Float[Array, ""]
    age: Float[Array, ""]


class VelocityObserver(eqx.Module):
    """Estimates v_x and v_y by a Kalman filter on the kinematics of the plane.

    v_x is read from the speed signal and from each axle's wheels, of which a driven one is believed less the
    more the car accelerates, one that runs away from what the accelerometer tells hardly at all (it spins, or
    locks), and none that contradicts the rest. v_y is read where it is measured, else from
    a single-track model of the rear axle, v_y = l_r r − v_x α_r, with a brush tire's slip angle for the
    lateral force that a_y tells of, α_r = (3μ/c_r)(1 − (1 − s)^⅓), s = a_y/(μ g). Its error is that of c_r
    and of μ: near the limit the integrated accelerations decide, for some seconds, and σ says how well.

    Attributes:
        channels: canonical channels read.
    """

    channels: tuple[str, ...] = eqx.field(static=True)
    _given: tuple[str, ...] = eqx.field(static=True)
    _model: PlanarVelocity
    _filter: KF
    _meter: SpeedMeter | None
    _noise: Float[Array, " g"]
    _slip: Float[Array, "2 s"]
    _intensity: Float[Array, " 2"]
    _rear_arm: Float[Array, ""]
    _rear_stiffness: Float[Array, ""]

    def __init__(self, vehicle: Vehicle, available: Collection[str]) -> None:
        given = tuple(c for c in ("speed", "velocity_y") if c in available)
        has_wheels = any(c.startswith("wheel_speed") for c in available)
        # a speed signal is read here, beside the wheels
        meter = SpeedMeter(vehicle, [c for c in available if c != "speed"]) if has_wheels else None
        axles = meter.sensors if meter is not None else ()
        lateral = () if "velocity_y" in given else ("velocity_y_model",)
        accel, tires = vehicle.sensors.accel, vehicle.tires
        self._given, self._meter = given, meter
        self._noise = jnp.asarray(np.array([getattr(vehicle.sensors, c).noise for c in given]))
        front, _, rear, _ = vehicle.driveline.drives
        share = 2.0 / (front + rear) / tires.slip_stiffness
        drives = [front if a.endswith("front") else rear for a in axles]
        slip = np.where(np.array(drives, bool), share, 0.2 * share)
        # brakes make all wheels slip
        self._slip = jnp.asarray(np.stack([slip, np.maximum(slip, 1.0 / tires.slip_stiffness)]))
        self.channels = tuple(dict.fromkeys((*given, *(meter.channels if meter is not None else ()))))
        slope = np.hypot(GRAVITY * vehicle.prior.grade_std, accel.bias)
        lasting = np.array([0.0, np.hypot(accel.bias, 0.01 * GRAVITY)]) * np.sqrt(2 * _SLIP_TIME)
        self._intensity = jnp.asarray(np.hypot(accel.noise_density, lasting))
        self._model = PlanarVelocity(
            states=("speed", "velocity_y", "slope"),
            sensors=(*given, *axles, *lateral),
            slope_std=leaf(float(slope)),
        )
        self._filter = KF(gate=GateRule(patience=_PATIENCE))
        self._rear_arm = leaf(vehicle.geometry.cg_to_rear_axle)
        self._rear_stiffness = leaf(tires.cornering_stiffness_rear)

    def init(self) -> VelocityState:
        """Nothing has come yet."""
        empty = Held.empty()
        return VelocityState(self._filter.init(self._model), empty, empty.age)

    def step(
        self,
        state: VelocityState,
        sample: Sample,
        motion: Motion,
        friction: Float[Array, " 2"],
        dt: Float[Array, ""],
    ) -> tuple[VelocityState, Gaussian]:
        """Advance; the Gaussian is of (v_x, v_y, s).

        Args:
            state: from :meth:`init` or the last call.
            sample: the channels at this instant.
            motion: what inertial sensors and steering say, held between their samples.
            friction: peak friction of the rear tires and its 1σ, as far as known.
            dt: s.
        """
        gear = state.gear_ratio.take(sample.get("gear_ratio", jnp.full((), jnp.nan)), dt)
        before = state.filter.gaussian.mean
        direction = signed_direction(gear.value)
        told = [signed(sample[c], direction) if c == "speed" else sample[c] for c in self._given]
        stds = list(self._noise)
        step = jnp.maximum(dt, _LEAST_STEP)
        if self._meter is not None:
            speeds, spread = self._meter.read(sample, motion.yaw_rate, motion.steer, direction)
            pull = before[0] * motion.accel_x / GRAVITY
            slip = jnp.abs(pull) * jnp.where(pull < 0, self._slip[1], self._slip[0])
            away = jnp.abs(jnp.where(jnp.isfinite(speeds), speeds - before[0] - motion.accel_x * dt, 0.0))
            slip = slip + _LEAD_GROWTH * jnp.maximum(
                away - _LEAD_FREE - 2 * state.filter.gaussian.std[0], 0.0
            )
            told += list(speeds)
            since = span(state.age, dt, STALE)
            stds += list(rss(spread, slip * jnp.sqrt(_SLIP_TIME / since)))
        told = [jnp.where(jnp.isfinite(value), value, jnp.nan) for value in told]
        along = [v for v, sensor in zip(told, self._model.sensors, strict=False) if sensor != "velocity_y"]
        heard = jnp.any(jnp.isfinite(jnp.stack(along)))
        if "velocity_y" not in self._given:
            angle, spread = self._slip_angle(motion.accel_y / GRAVITY, friction)
            by_model = self._rear_arm * motion.yaw_rate - jnp.abs(before[0]) * angle
            told.append(jnp.where(motion.age < STALE, by_model, jnp.nan))
            error = rss(_MODEL_ANGLE, spread)
            stds.append((jnp.abs(before[0]) + 1.0) * error * jnp.sqrt(_MODEL_TIME / step))
        u = _Input(
            motion.accel_x,
            motion.accel_y,
            motion.yaw_rate,
            jnp.where(motion.age < STALE, self._intensity, _UNSEEN),
            jnp.stack(stds),
        )
        new, _ = self._filter.step(self._model, state.filter, u, jnp.stack(told), dt)
        age = jnp.where(heard, 0.0, state.age + dt)
        return VelocityState(new, gear, age), new.gaussian

    def _slip_angle(
        self, used: Float[Array, ""], friction: Float[Array, " 2"]
    ) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Slip angle of the rear axle, and what c_r and μ make of its 1σ, rad.

        Args:
            used: lateral force over load.
            friction: μ and its 1σ.
        """

        def angle(mu: Float[Array, ""]) -> Float[Array, ""]:
            left = jnp.maximum(1 - jnp.abs(used) / mu, 1 - _FULLEST)
            return 3 * mu / self._rear_stiffness * (1 - jnp.cbrt(left)) * jnp.sign(used)

        mu = jnp.maximum(friction[0], _LEAST_FRICTION)
        slope = angle(mu) - angle(jnp.maximum(mu - friction[1], 0.5 * mu))
        return angle(mu), rss(_MODEL_SHARE * angle(mu), slope)
