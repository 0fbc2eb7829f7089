"""Motion along the road: speed, slope, and what accelerometer, wheels, torques and satellites disagree by."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import jax.scipy.linalg as jsl
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.core.gaussian import Gaussian
from roadstate.estimators.base import leaf
from roadstate.estimators.road import GradePrior
from roadstate.estimators.tire_forces import BRAKE_RELATIVE
from roadstate.linalg import root
from roadstate.statespace import StateSpaceModel

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

SPEED, SLOPE, SLOPE_RATE, BIAS, SCALE = range(5)
_ACCEL_SCALE = 0.01  # 1σ of the accelerometer's scale
_LASTING = 3600.0  # s over which what belongs to the car or its sensors keeps its value
_BRAKE_LASTING = 600.0  # s: pads warm up
_CAUGHT = 2.0  # m/s: 1σ of what a sensor's lies do to the speed until they are found
_WHEEL_SPREAD = 0.003  # 1σ of one wheel's radius against the others'


class AlongInput(NamedTuple):
    """What is known at one instant.

    Attributes:
        accel: specific force along x, freed of pitch, plus v_y r, m/s².
        smooth_accel: its low-passed specific force, which the scale multiplies, m/s².
        drive, brake: specific forces of drive and brakes as torques tell them, low-passed, m/s².
        rolling: g with the sign of the speed: what the coefficient of rolling resistance multiplies, m/s².
        speed: so far, m/s.
        intensity: of the acceleration's white error, m/s²/√Hz.
        sensor_std: (m,) 1σ of a sample.
    """

    accel: Float[Array, ""]
    smooth_accel: Float[Array, ""]
    drive: Float[Array, ""]
    brake: Float[Array, ""]
    rolling: Float[Array, ""]
    speed: Float[Array, ""]
    intensity: Float[Array, ""]
    sensor_std: Float[Array, " m"]


class AlongModel(StateSpaceModel):
    """x = [v_x, g sin θ, its rate of distance, b, κ | ε_m, γ_d, γ_b, δf | ε_R | z, z_wander], affine in x.

    v̇_x = a_x − b − κ ā_x − g sin θ + v_y r. The groups behind the bars are there when the channels are that
    tell of them: relative errors of mass, drive torque and brake torque and the error of rolling resistance
    with torques; of the rolling radius with a speed that is not the wheels'; height with an altitude.

    Sensors: the wheels' speeds (freed of slip and yaw), the speed signal, ``traction``: how much more the
    accelerometer reads than the torques explain, b + κ ā_x + (γ_d − ε_m) a_d − (γ_b − ε_m) a_b − δf g;
    altitude; rate of climb.

    Attributes:
        road: how g sin θ changes along the road.
        slow_std: 1σ of the states from b to ε_R.
        slow_time: s, how long they last.
        wander: 1σ (m) and duration (s) of the altitude's slow error.
    """

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    road: GradePrior
    slow_std: Float[Array, " k"]
    slow_time: Float[Array, " k"]
    wander: Float[Array, " 2"]

    def __init__(self, vehicle: Vehicle, available: Collection[str], *, has_torque: bool) -> None:
        prior, sensors = vehicle.prior, vehicle.sensors
        wheels = tuple(f"wheel_speed_{w}" for w in WHEELS if f"wheel_speed_{w}" in available)
        slow = {
            "accel_x_bias": (sensors.accel.bias, _LASTING),
            "accel_x_scale": (float(np.hypot(GRAVITY * prior.pitch_gradient_std, _ACCEL_SCALE)), _LASTING),
        }
        if has_torque:
            at_wheels = any(c.startswith("drive_torque") for c in available)
            torque = sensors.wheel_torque if at_wheels else sensors.engine_torque
            measured = any(c.startswith("brake_torque") for c in available)
            slow["mass"] = (prior.mass_relative, _LASTING)
            slow["drive_gain"] = (torque.relative, _LASTING)
            slow["brake_gain"] = (torque.relative if measured else BRAKE_RELATIVE, _BRAKE_LASTING)
            slow["rolling_resistance"] = (prior.rolling_resistance_std, _LASTING)
        if wheels and "speed" in available:
            slow["wheel_radius"] = (sensors.wheel_speed.scale, _LASTING)
        aids = [c for c in ("speed", "altitude", "vertical_speed") if c in available]
        height = ("altitude", "altitude_error") if "altitude" in available else ()
        self.states = ("speed", "slope", "slope_rate", *slow, *height)
        self.sensors = (*wheels, *aids, *(["traction"] if has_torque else []))
        self.road = GradePrior(leaf(GRAVITY * prior.grade_std), leaf(prior.grade_correlation_length))
        self.slow_std = jnp.asarray(np.array([std for std, _ in slow.values()]))
        self.slow_time = jnp.asarray(np.array([time for _, time in slow.values()]))
        self.wander = jnp.asarray([sensors.altitude.wander, sensors.altitude.wander_time])

    def place(self, state: str) -> int:
        """Row of a state."""
        return self.states.index(state)

    def f(self, x: Float[Array, " n"], u: AlongInput, dt: Float[Array, ""]) -> Float[Array, " n"]:
        """Explicit Euler in the speed, exact in the rest."""
        count = len(self.slow_std)
        along = u.accel - x[SLOPE] - x[BIAS] - x[SCALE] * u.smooth_accel
        road = self.road.transition(jnp.abs(u.speed) * dt) @ x[1:3]
        slow = x[3 : 3 + count] * jnp.exp(-dt / self.slow_time)
        parts = [x[:1] + dt * along, road, slow]
        if len(self.states) > 3 + count:
            climb = x[-2] + dt * u.speed * x[SLOPE] / GRAVITY
            parts.append(jnp.stack([climb, x[-1] * jnp.exp(-dt / self.wander[1])]))
        return jnp.concatenate(parts)

    def h(self, x: Float[Array, " n"], u: AlongInput) -> Float[Array, " m"]:
        """In the order of the sensors."""
        rows = []
        for sensor in self.sensors:
            if sensor == "altitude":
                rows.append(x[-2] + x[-1])
            elif sensor == "vertical_speed":
                rows.append(u.speed * x[SLOPE] / GRAVITY)
            elif sensor == "traction":
                mass, drive, brake, rolling = (x[self.place("mass") + i] for i in range(4))
                gains = (drive - mass) * u.drive - (brake - mass) * u.brake - rolling * u.rolling
                rows.append(x[BIAS] + x[SCALE] * u.smooth_accel + gains)
            elif sensor != "speed" and "wheel_radius" in self.states:
                rows.append(x[SPEED] - u.speed * x[self.place("wheel_radius")])
            else:
                rows.append(x[SPEED])
        return jnp.stack(rows)

    def sqrt_Q(self, u: AlongInput, dt: Float[Array, ""]) -> Float[Array, "n n"]:
        """White acceleration, the road, and what slowly forgets."""
        slow = self.slow_std * root(-jnp.expm1(-2 * dt / self.slow_time))
        blocks = [u.intensity[None, None] * root(dt), self.road.sqrt_Q(jnp.abs(u.speed) * dt), jnp.diag(slow)]
        if len(self.states) > 3 + len(self.slow_std):
            # roads' unevenness and a slope that is not the car's path keep the height from being frozen
            height = 0.02 * root(jnp.abs(u.speed) * dt)
            wander = self.wander[0] * root(-jnp.expm1(-2 * dt / self.wander[1]))
            blocks.append(jnp.diag(jnp.stack([height, wander])))
        return jnp.asarray(jsl.block_diag(*blocks))

    def sqrt_R(self, u: AlongInput) -> Float[Array, "m m"]:
        """Independent sensors."""
        return jnp.diag(u.sensor_std)

    def doubt(self, gaussian: Gaussian, caught: Bool[Array, ""]) -> Gaussian:
        """The prior but for speed and height, where a sensor has just been caught lying; else the same.

        What has been learnt of the slope, biases and the car may all come from that sensor.
        """
        prior = self.prior()
        count = 3 + len(self.slow_std)
        kept = (np.arange(len(self.states)) == SPEED) | (np.arange(len(self.states)) >= count)
        factor = prior.factor.at[SPEED, SPEED].set(_CAUGHT)
        mean = jnp.where(caught & (~kept), prior.mean, gaussian.mean)
        return Gaussian(mean, jnp.where(caught, factor, gaussian.factor))

    def prior(self) -> Gaussian:
        """Any speed a road car has, the road's own slope, any height on land."""
        std = [jnp.asarray([30.0]), self.road.stationary_std, self.slow_std]
        if len(self.states) > 3 + len(self.slow_std):
            std.append(jnp.stack([jnp.asarray(2000.0), self.wander[0]]))
        whole = jnp.concatenate(std)
        return Gaussian(jnp.zeros_like(whole), jnp.diag(whole))
