"""How well any filter could know grade and mass with a preset's sensors: the least error, computed.

The car rolls along x with the specific force s that its tires exert, less drag: v̇ = s − g sin θ. Of the
filter's world everything is known (slip, radius, how the body pitches) but what follows, and the least error
is the posterior Cramér–Rao bound of that model along the true drive:

- s itself, seen by the accelerometer, (1 + γ_a) s + b_a − ψ a_y, and by the torques, (1 + δ + γ) s + β +
  ε_d v² + ε_r, with γ the gains of the drive's sensors while s > 0, of the brakes' while s < 0: 1σ of the
  preset, over the wheels by shares;
- δ, the mass, told 5 to 10 % wrong, as ε_d, drag, and ε_r, rolling resistance; b_a with the mounting's pitch
  in it, which drifts; ψ the mounting's yaw;
- v through the place of the teeth, √n times better for n wheels, and the receiver's speed;
- θ through its rate of change as the pitch gyroscope sees it, θ' v + b_g, and the receiver's rate of climb
  and height; before the drive as the vehicle file has it (:class:`roadstate.estimators.road.GradePrior`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from roadstate.core import WHEELS, Log
from roadstate.core.constants import GRAVITY
from roadstate.core.gaussian import Gaussian
from roadstate.cramer_rao import CramerRaoBound, cramer_rao_bound
from roadstate.estimators.road import GradePrior
from roadstate.papers.plants import OFF, rms
from roadstate.sim.sensors import sensor_preset
from roadstate.sim.sensors.probe import Probe
from roadstate.sim.sensors.wheel_pulses import ToothSensor
from roadstate.statespace import StateSpaceModel
from roadstate.vehicles import Vehicle

_STATES = (
    "distance", "speed", "force", "grade", "grade_slope", "height", "height_wander", "accel_bias", "mass",
    "drive_gain", "brake_gain", "accel_gain", "torque_bias", "mounting_yaw", "gyro_bias", "drag", "rolling",
)  # fmt: skip
_SENSORS = ("distance", "accel", "torque", "pitch_rate", "speed", "vertical_speed", "altitude")
MASS_OFF = rms(OFF["mass"])
"""1σ of what a vehicle file of the benchmark tells of mass, drag and rolling resistance."""
_ANY = 20.0  # m/s²: 1σ of a force of which nothing is known beforehand
_BRAKE_SHARES = (0.325, 0.325, 0.175, 0.175)


class _Input(NamedTuple):
    """(T,) each in a drive: true specific forces along and across, m/s²; speed over ground, m/s."""

    force: Any
    across: Any
    speed: Any


class _Rolling(StateSpaceModel):
    """See the module. Forces are over the mass, in m/s².

    Attributes:
        road: how grade changes.
        first: (n,) 1σ before the drive.
        walks: 1σ after one second of the drift of distance (from rounding), accelerometer and gyroscope.
        wander: 1σ and correlation time (s) of the receiver's height.
        noise: (7,) 1σ of a sample.
        brake_noise: 1σ of the torques' sum while braking, beside the drive's.
    """

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    road: GradePrior
    first: Any
    walks: Any
    wander: Any
    noise: Any
    brake_noise: Any

    def f(self, x: Any, u: _Input, dt: Any) -> Any:
        moved = self.road.transition(u.speed * dt) @ x[3:5]
        kept = jnp.exp(-dt / self.wander[1])
        ahead = [
            x[0] + x[1] * dt,
            x[1] + (x[2] - GRAVITY * jnp.sin(x[3])) * dt,
            jnp.where(dt > 0, u.force, x[2]),
        ]
        height = [x[5] + x[1] * jnp.sin(x[3]) * dt, x[6] * kept]
        return jnp.concatenate([jnp.stack(ahead), moved, jnp.stack(height), x[7:]])

    def h(self, x: Any, u: _Input) -> Any:
        gain = jnp.where(u.force > 0, x[9], x[10])
        return jnp.stack(
            [
                x[0],
                (1 + x[11]) * x[2] + x[7] - x[13] * u.across,
                (1 + x[8] + gain) * x[2] + x[12] + x[15] * u.speed**2 + x[16],
                x[4] * x[1] + x[14],
                x[1],
                x[1] * jnp.sin(x[3]),
                x[5] + x[6],
            ]
        )

    def sqrt_Q(self, u: _Input, dt: Any) -> Any:
        q = jnp.zeros((len(_STATES), 7))
        q = q.at[2, 0].set(jnp.where(dt > 0, _ANY, 0.0)).at[3:5, 1:3].set(self.road.sqrt_Q(u.speed * dt))
        q = q.at[6, 3].set(self.wander[0] * jnp.sqrt(-jnp.expm1(-2 * dt / self.wander[1])))
        rows, columns = jnp.asarray([0, 7, 14]), jnp.asarray([4, 5, 6])
        return q.at[rows, columns].set(self.walks * jnp.sqrt(dt))

    def sqrt_R(self, u: _Input) -> Any:
        torque = jnp.hypot(self.noise[2], jnp.where(u.force < 0, self.brake_noise, 0.0))
        return jnp.diag(self.noise.at[2].set(torque))

    def prior(self) -> Gaussian:
        return Gaussian(jnp.zeros(len(_STATES)), jnp.diag(self.first))


def least_rmse(log: Log, vehicle: Vehicle, *, settle: float) -> float:
    """RMSE of the slope, per cent, that the bound allows, over samples and over drives alike.

    Args:
        log: of the drive, recorded with the preset ``automotive``; its truth is used, and which samples of
            the receiver it has, if any.
        vehicle: that was driven.
        settle: s of the log's start that do not count.
    """
    used = log.time - log.time[0] >= settle
    slope = np.asarray(_bound(log, vehicle).std[:, _STATES.index("grade")]) / np.cos(log["ref_grade"]) ** 2
    return float(100 * np.sqrt(np.mean(slope[used] ** 2)))


def least_mass_error(log: Log, vehicle: Vehicle) -> float:
    """Mean |error| of the mass at the end of a drive, per cent, that the bound allows: √(2/π) σ.

    Args:
        log, vehicle: as :func:`least_rmse`.
    """
    std = np.asarray(_bound(log, vehicle).std[-1, _STATES.index("mass")])
    return float(100 * np.sqrt(2 / np.pi) * std)


def _bound(log: Log, vehicle: Vehicle) -> CramerRaoBound:
    """The bound of all states, at each sample."""
    dt = np.diff(log.time, prepend=log.time[0])
    along, across = (
        np.sum([log[f"ref_force_{a}_{w}"] for w in WHEELS], axis=0) / vehicle.mass for a in ("x", "y")
    )
    u = _Input(*(jnp.asarray(v) for v in (along, across, log["ref_velocity_x"])))
    states = np.zeros((len(log), len(_STATES)))
    states[:, 1], states[:, 2], states[:, 3] = log["ref_velocity_x"], along, log["ref_grade"]
    present = np.ones((len(log), len(_SENSORS)), bool)
    for column, name in ((4, "speed"), (5, "vertical_speed"), (6, "altitude")):
        present[:, column] = np.isfinite(log[name]) if name in log else False
    return cramer_rao_bound(
        model(vehicle), jnp.asarray(states), u, jnp.asarray(dt), present=jnp.asarray(present)
    )


def model(vehicle: Vehicle) -> StateSpaceModel:
    """The world of the ideal filter, with the figures of the preset ``automotive``.

    Args:
        vehicle: that is driven; its prior of the road is used.
    """
    suite = sensor_preset("automotive")
    assert suite.imu is not None
    assert suite.gnss is not None
    assert isinstance(suite.wheel_speed, ToothSensor)
    assert suite.drive_torque is not None
    assert suite.brake_torque is not None
    accel, gyro, drive, brake = suite.imu.accel, suite.imu.gyro, suite.drive_torque, suite.brake_torque
    driven = {"all": 4}.get(vehicle.driveline.driven, 2)
    lever = 1 / (vehicle.wheels.radius * vehicle.mass)
    radius, height = vehicle.wheels.radius, suite.gnss.altitude
    # four wheels tell the distance; rounding of their speeds adds up to a random walk
    place = suite.wheel_speed.tooth_error * 2 * np.pi / suite.wheel_speed.teeth * radius / 2
    rounding = suite.wheel_speed.resolution / np.sqrt(12) * radius / 2 / np.sqrt(suite.wheel_speed.rate)
    road = GradePrior(
        jnp.asarray(vehicle.prior.grade_std), jnp.asarray(vehicle.prior.grade_correlation_length)
    )
    first = [
        1e-3, 5.0, _ANY, *np.asarray(road.stationary_std), 100.0, height.wander,
        np.hypot(accel.bias, GRAVITY * suite.imu.mounting_std), MASS_OFF, drive.gain_std / np.sqrt(driven),
        brake.gain_std * np.linalg.norm(_BRAKE_SHARES), accel.gain_std, drive.bias * np.sqrt(driven) * lever,
        suite.imu.mounting_std, gyro.bias,
        MASS_OFF * vehicle.drag_factor / vehicle.mass,
        MASS_OFF * GRAVITY * vehicle.rolling_resistance.coefficient,
    ]  # fmt: skip
    velocity = suite.gnss.velocity.noise
    noise = [
        place, sample_noise(accel), sample_noise(drive) * np.sqrt(driven) * lever, sample_noise(gyro),
        velocity, velocity, height.noise,
    ]  # fmt: skip
    return _Rolling(
        _STATES,
        _SENSORS,
        road,
        jnp.asarray(np.array(first, float)),
        jnp.asarray([rounding, accel.walk, gyro.walk]),
        jnp.asarray([height.wander, height.wander_time]),
        jnp.asarray(np.array(noise, float)),
        jnp.asarray(sample_noise(brake) * 2 * lever),
    )


def sample_noise(probe: Probe) -> float:
    """1σ of a sample's white noise, rounding included."""
    return float(np.sqrt(probe.noise**2 + probe.noise_density**2 * probe.rate + probe.resolution**2 / 12))
