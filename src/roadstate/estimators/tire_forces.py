"""The lower layer of TFOBE: tire forces from wheel speeds, torques, accelerations and yaw rate."""

from __future__ import annotations

from math import hypot
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.core.gaussian import Gaussian
from roadstate.linalg import root, rss
from roadstate.statespace import StateSpaceModel
from roadstate.vehicles import SevenDofForces, wheel_steer
from roadstate.vehicles.kinematics import to_body

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

SLOW = 5
"""How many states lead x that stay nearly the same over a drive."""
DRIVE_GAIN, YAW_RATE, SPIN = 3, 5, slice(6, 10)
FORCE_X, FORCE_Y = slice(10, 14), slice(14, 16)
"""Places in x: F_x of four wheels, F_y of the front and the rear axle."""
BRAKE_RELATIVE = 0.2
"""1σ of a brake's torque per pressure, and of a brake torque reckoned from it (pads, temperature)."""
_COUNT = 16
_TIMES = (3600.0, 3600.0, 3600.0, 3600.0, 600.0)  # s over which the slow states keep their values
_ACCEL_SCALE = 0.01  # 1σ of the accelerometer's scale
_LATERAL_JERK = 2.0  # m/s²/√s: how specific force across wanders
_APART = 0.5  # m/s²/√s: how a wheel's longitudinal force wanders by itself, over the car's mass
_SPIN = 0.3  # m/s²/√Hz at a wheel's rim: unevenness, brake judder, what the torques do not tell
_LEAST_INERTIA = 1e-6  # kg·m²
_YAW = 0.3  # rad/s²/√Hz: moments that the axles' lateral forces do not make


class ForceInput(NamedTuple):
    """What the lower layer knows at one instant.

    Attributes:
        gain: (3, 6) specific force along and across (1/kg) and yaw acceleration (rad/s² per N) per force.
        drag: air drag per mass, m/s².
        torque: (4,) of drive less brakes and rolling resistance at each wheel, N·m.
        drive_torque: (4,) N·m, smoothed: what the drive's gain multiplies.
        brake_torque: (4,) N·m, smoothed, with the sign of the speed: what the brakes' gain multiplies.
        accel_x: longitudinal specific force, smoothed, m/s²: what κ multiplies.
        rolling: (4,) rolling moment per coefficient, with the sign of the speed, N·m.
        engine: (4,) inertia beside the wheels' own, turned with the driven ones' mean, kg·m².
        torque_noise: (4,) intensity of what is not known of the torques, N·m/√Hz.
        force_noise: (4,) how the longitudinal forces wander as torques change, N/√s.
        jerk: how they wander together, per mass, m/s²/√s.
        sensor_std: (7,) 1σ of a sample.
    """

    gain: Float[Array, "3 6"]
    drag: Float[Array, ""]
    torque: Float[Array, " 4"]
    drive_torque: Float[Array, " 4"]
    brake_torque: Float[Array, " 4"]
    accel_x: Float[Array, ""]
    rolling: Float[Array, " 4"]
    engine: Float[Array, " 4"]
    torque_noise: Float[Array, " 4"]
    force_noise: Float[Array, " 4"]
    jerk: Float[Array, ""]
    sensor_std: Float[Array, " 7"]


class TireForceModel(StateSpaceModel):
    """x = [b, κ, δf₀, γ_d, γ_b, r, ω (4), F_x (4), F_y front, F_y rear], linear for what is known.

    I_w ω̇_i = T_i + γ_d T̄_drive,i − γ_b T̄_brake,i − R_w F_x,i − δf₀ F_z,i R_w, less what an engine takes that
    turns with the mean of the driven wheels; the yaw equation; and forces that are random walks (paper 002
    eqs. 26–31, with changes). v_x comes from the upper layer and v_y is not needed, so that a slope cannot
    make them drift. Lateral forces are those of axles, since nothing tells the two sides apart; each wheel
    carries half, which matters to the yaw moment only by its sine of the steer.

    Forces are those of a car of exactly the file's mass: what the torques are off by *in proportion to the
    mass* is the gain γ_d, and γ_b for the brakes; δf₀ is the error of the rolling resistance. b and κ are
    bias and scale of the longitudinal accelerometer, which reads a_x + b + κ ā_x (a body pitches in
    proportion to force, and sees a part of gravity). All these are what accelerometer and torques disagree
    by, and are learned from it. What gains and κ multiply is smoothed (T̄, ā_x), since a regression on
    figures that are noisy would find gains that are too low.

    Attributes:
        vehicle: whose figures count.
        slow_std: (5,) 1σ of b (m/s²), κ, δf₀, γ_d, γ_b.
    """

    states: ClassVar[tuple[str, ...]] = (  # type: ignore[misc]
        *("accel_x_bias", "accel_x_scale", "rolling_resistance", "drive_gain", "brake_gain", "yaw_rate"),
        *(f"wheel_speed_{w}" for w in WHEELS),
        *(f"force_x_{w}" for w in WHEELS),
        *("force_y_front", "force_y_rear"),
    )
    sensors: ClassVar[tuple[str, ...]] = (  # type: ignore[misc]
        *("accel_x", "accel_y", "yaw_rate"),
        *(f"wheel_speed_{w}" for w in WHEELS),
    )

    vehicle: SevenDofForces
    slow_std: Float[Array, " 5"]

    def __init__(self, vehicle: Vehicle, torque_relative: float, brake_relative: float) -> None:
        self.vehicle = SevenDofForces.from_vehicle(vehicle)
        prior = vehicle.prior
        self.slow_std = jnp.asarray(
            np.array(
                [
                    vehicle.sensors.accel.bias,
                    hypot(GRAVITY * prior.pitch_gradient_std, _ACCEL_SCALE),
                    prior.rolling_resistance_std,
                    hypot(torque_relative, prior.mass_relative),
                    hypot(brake_relative, prior.mass_relative),
                ]
            )
        )

    @property
    def nonlinear(self) -> tuple[str, ...]:
        """None: f and h are affine in x given u."""
        return ()

    def gain(self, steer: Float[Array, ""]) -> Float[Array, "3 6"]:
        """What :attr:`ForceInput.gain` is at a mean front road-wheel angle (rad)."""
        car, place = self.vehicle, self.vehicle.wheel_positions
        angles = wheel_steer(steer, jnp.zeros_like(steer))
        one, none = jnp.ones_like(angles), jnp.zeros_like(angles)
        rows = []
        for force in (to_body(one, none, angles), to_body(none, one, angles)):
            moment = (place.x * force.y - place.y * force.x) / car.yaw_inertia
            rows.append(jnp.stack([force.x / car.mass, force.y / car.mass, moment]))
        lateral = 0.5 * (rows[1][:, 0::2] + rows[1][:, 1::2])
        return jnp.concatenate([rows[0], lateral], axis=1)

    def f(self, x: Float[Array, " 16"], u: ForceInput, dt: Float[Array, ""]) -> Float[Array, " 16"]:
        """Explicit Euler (the noise allows no finer), exact in the slow states."""
        slow = x[:SLOW] * jnp.exp(-dt / jnp.asarray(_TIMES, x.dtype))
        turning = jnp.sum(u.gain[2] * x[FORCE_X.start :], keepdims=True)
        torque = u.torque + x[3] * u.drive_torque - x[4] * u.brake_torque - x[2] * u.rolling
        spin = self._spun_up(torque - self.vehicle.wheel_radius * x[FORCE_X], u.engine)
        moved = x[YAW_RATE : SPIN.stop] + dt * jnp.concatenate([turning, spin])
        return jnp.concatenate([slow, moved, x[FORCE_X.start :]])

    def _spun_up(self, torque: Float[Array, " 4"], engine: Float[Array, " 4"]) -> Float[Array, " 4"]:
        """(4,) rad/s² that torques make of wheels, some of which share an engine: (diag I + E dᵀ)⁻¹ T by
        Sherman and Morrison, d the share of each in the engine's speed."""
        own = self.vehicle.wheel_inertia
        share = engine / jnp.maximum(jnp.sum(engine), _LEAST_INERTIA)
        alone, pulled = torque / own, engine / own
        return alone - pulled * jnp.sum(share * alone) / (1 + jnp.sum(share * pulled))

    def h(self, x: Float[Array, " 16"], u: ForceInput) -> Float[Array, " 7"]:
        """Accelerometers (freed of the body's pitch and roll), gyroscope, wheel speeds."""
        along, across = self.specific_force(x, u)
        felt = jnp.stack([along + x[0] + x[1] * u.accel_x, across])
        return jnp.concatenate([felt, x[YAW_RATE : SPIN.stop]])

    def specific_force(self, x: Float[Array, " 16"], u: ForceInput) -> Float[Array, " 2"]:
        """What the road and the air do to the car along and across, per mass, m/s²."""
        by_road = jnp.sum(u.gain[:2] * x[FORCE_X.start :], axis=1)
        return by_road - jnp.stack([u.drag, jnp.zeros_like(u.drag)])

    def sqrt_Q(self, u: ForceInput, dt: Float[Array, ""]) -> Float[Array, "16 17"]:
        """Diagonal, and a column for what moves all longitudinal forces alike."""
        mass, radius = self.vehicle.mass, self.vehicle.wheel_radius
        slow = self.slow_std * root(-jnp.expm1(-2 * dt / jnp.asarray(_TIMES, self.slow_std.dtype)))
        inertia = self.vehicle.wheel_inertia + u.engine
        wheels = rss(u.torque_noise, _SPIN * inertia / radius) / inertia
        along = rss(u.force_noise, 0.5 * _APART * mass)
        across = jnp.full(2, _LATERAL_JERK / 2) * mass
        density = jnp.concatenate([jnp.full(1, _YAW), wheels, along, across])
        alike = jnp.zeros(_COUNT).at[FORCE_X].set(u.jerk / 4 * mass * root(dt))
        diagonal = jnp.concatenate([slow, density * root(dt)])
        return jnp.concatenate([jnp.diag(diagonal), alike[:, None]], axis=1)

    def sqrt_R(self, u: ForceInput) -> Float[Array, "7 7"]:
        """Independent sensors."""
        return jnp.diag(u.sensor_std)

    def prior(self) -> Gaussian:
        """A car that may be doing anything on the road."""
        fast = jnp.asarray([0.5] + [100.0] * 4)
        weights = jnp.asarray([0.1] * 4 + [0.2] * 2) * (self.vehicle.mass * GRAVITY)
        return Gaussian(jnp.zeros(_COUNT), jnp.diag(jnp.concatenate([self.slow_std, fast, weights])))
