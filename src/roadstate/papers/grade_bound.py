"""How well any filter could know the grade from a drive of paper 002, with white noise on the signals.

The car rolls along x under the specific force s of its tires (the air's is known): v̇ = s − g sin θ. Wheel
speeds tell v, slip known; the accelerometer tells s + b; the drive's torques, over mass and radius, tell
(1 + λ + γ) s − λ g sin θ + δf₀ g with λ = ΣI_w/(m R²), less well while the brakes' torques count, too.
Nothing is known beforehand of s, and of the road σ and ℓ of
:class:`~roadstate.estimators.road.GradePrior`. Drag, slip and how the body pitches are known exactly.
Altitude and pitch gyroscope are not used.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from roadstate.core import WHEELS, InputError, Log
from roadstate.core.constants import GRAVITY
from roadstate.core.gaussian import Gaussian
from roadstate.cramer_rao import cramer_rao_bound
from roadstate.estimators.road import GradePrior
from roadstate.sim.sensors import Probe, SensorSuite, sensor_preset
from roadstate.statespace import StateSpaceModel
from roadstate.vehicles import Vehicle

SIGNALS = ("speed", "accel", "torque")
"""The four wheels' speeds, the longitudinal accelerometer, the wheels' torques."""
_STATES = ("speed", "force", "grade", "grade_slope", "accel_bias", "rolling_resistance", "gain")
_ANY = 20.0  # m/s²: 1σ of a force of which nothing is known beforehand


class Along(NamedTuple):
    """(T,) each: true specific force of the tires along the car, m/s²; its speed, m/s; whether it brakes."""

    force: Any
    speed: Any
    brakes: Any


class RollingCar(StateSpaceModel):
    """See the module. Forces are over the mass, in m/s².

    Attributes:
        road: how grade changes.
        spin: λ, the wheels' inertia over the car's mass at their rims.
        noise: (3,) 1σ of a sample of :data:`SIGNALS`, m/s and m/s².
        brake_noise: of the torques on top, while the car brakes.
        unknown: (3,) 1σ of b (m/s²), δf₀ and γ; 0 for what is known.
    """

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    road: GradePrior
    spin: Any
    noise: Any
    brake_noise: Any
    unknown: Any

    def f(self, x: Any, u: Along, dt: Any) -> Any:
        """Explicit Euler in v, exact in the road."""
        speed = x[0] + (x[1] - GRAVITY * jnp.sin(x[2])) * dt
        force = jnp.where(dt > 0, u.force, x[1])
        road = self.road.transition(u.speed * dt) @ x[2:4]
        return jnp.concatenate([jnp.stack([speed, force]), road, x[4:]])

    def h(self, x: Any, u: Along) -> Any:
        """What :data:`SIGNALS` read."""
        drive = (1 + self.spin + x[6]) * x[1] - self.spin * GRAVITY * jnp.sin(x[2]) + GRAVITY * x[5]
        return jnp.stack([x[0], x[1] + x[4], drive])

    def sqrt_Q(self, u: Along, dt: Any) -> Any:
        """A force that may become anything, and the road."""
        q = jnp.zeros((len(_STATES), 3)).at[1, 0].set(jnp.where(dt > 0, _ANY, 0.0))
        return q.at[2:4, 1:].set(self.road.sqrt_Q(u.speed * dt))

    def sqrt_R(self, u: Along) -> Any:
        """Independent sensors."""
        return jnp.diag(self.noise.at[2].set(jnp.hypot(self.noise[2], u.brakes * self.brake_noise)))

    def prior(self) -> Gaussian:
        """Any speed and force, the road's own grade, what is not known of the car."""
        motion = jnp.asarray([5.0, _ANY])
        std = jnp.concatenate([motion, self.road.stationary_std, self.unknown])
        return Gaussian(jnp.zeros(len(_STATES)), jnp.diag(std))


def own_road(log: Log) -> GradePrior:
    """The Gauss–Markov road whose mean squares of grade and of its slope along the way are a drive's own."""
    speed, grade = log["ref_velocity_x"], log["ref_grade"]
    gone = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(log.time))])
    rolls = np.diff(gone, prepend=-1.0) > 1e-9
    place = np.arange(0.0, gone[-1])
    along = np.interp(place, gone[rolls], grade[rolls])
    std = float(np.sqrt(np.mean(along**2)))
    slope = float(np.sqrt(np.mean(np.gradient(along, place) ** 2)))
    return GradePrior(jnp.asarray(std), jnp.asarray(np.sqrt(3) * std / max(slope, 1e-12)))


def rolling_car(
    vehicle: Vehicle, road: GradePrior, suite: SensorSuite, *, knows_car: bool = True
) -> RollingCar:
    """The world of the ideal filter.

    Args:
        vehicle: that is driven; its file says how well bias, rolling resistance, mass and gains are known.
        road: how its grade changes.
        suite: of which only white noise counts.
        knows_car: whether those figures are known exactly.
    """
    driven = {"all": 4}.get(vehicle.driveline.driven, 2)
    radius, wheel, drive, brake = (
        vehicle.wheels.radius,
        suite.wheel_speed,
        suite.drive_torque,
        suite.brake_torque,
    )
    if suite.imu is None or drive is None or brake is None or not isinstance(wheel, Probe):
        raise InputError("the bound wants white noise on wheel speeds, accelerometer and torques")
    lever = 1 / (radius * vehicle.mass)
    noise = [wheel.noise * radius / 2, suite.imu.accel.noise, drive.noise * np.sqrt(driven) * lever]
    gain = np.hypot(vehicle.prior.mass_relative, vehicle.sensors.wheel_torque.relative)
    unknown = [vehicle.sensors.accel.bias, vehicle.prior.rolling_resistance_std, gain]
    return RollingCar(
        _STATES,
        SIGNALS,
        road,
        jnp.asarray(4 * vehicle.wheels.inertia / (vehicle.mass * radius**2)),
        jnp.asarray(np.array(noise, float)),
        jnp.asarray(brake.noise * 2 * lever),
        jnp.asarray(np.array(unknown, float) * (not knows_car)),
    )


def least_rmse(
    log: Log,
    vehicle: Vehicle,
    *,
    settle: float,
    signals: Collection[str] = SIGNALS,
    road: GradePrior | None = None,
    knows_car: bool = True,
) -> float:
    """RMSE of the slope, per cent, that the bound allows.

    Args:
        log: of a drive recorded with the preset ``paper``; only its truth is used.
        vehicle: that was driven.
        settle: s of the log's start that do not count.
        signals: of :data:`SIGNALS`, those there are.
        road: how the grade changes; default :func:`own_road`.
        knows_car: see :func:`rolling_car`.

    Raises:
        InputError: recorded with other sensors.
    """
    if "kinematic_accel_x" not in log:
        raise InputError("this bound is of white noise alone; production sensors' is in the accuracy tables")
    along = np.sum([log[f"ref_force_x_{w}"] for w in WHEELS], axis=0) / vehicle.mass
    grade, speed = log["ref_grade"], log["ref_velocity_x"]
    states = np.zeros((len(log), len(_STATES)))
    states[:, 0], states[:, 1], states[:, 2] = speed, along, grade
    present = np.broadcast_to([name in signals for name in SIGNALS], (len(log), len(SIGNALS)))
    world = rolling_car(
        vehicle,
        own_road(log) if road is None else road,
        sensor_preset("paper"),
        knows_car=knows_car,
    )
    dt = np.diff(log.time, prepend=log.time[0])
    brakes = log["brake"] > 0 if "brake" in log else np.zeros(len(log), bool)
    u = Along(jnp.asarray(along), jnp.asarray(speed), jnp.asarray(brakes))
    bound = cramer_rao_bound(world, jnp.asarray(states), u, jnp.asarray(dt), present=jnp.asarray(present))
    used = log.time - log.time[0] >= settle
    slope = np.asarray(bound.std[:, 2]) / np.cos(grade) ** 2
    return float(100 * np.sqrt(np.mean(slope[used] ** 2)))
