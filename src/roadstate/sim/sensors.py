"""What a car's sensors would read of a drive: noise, bias, rates, and the body's pitch on its springs."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from roadstate.core import WHEELS, InputError, Log
from roadstate.core.constants import GRAVITY
from roadstate.sim.drive import SAMPLE_STEP, Truth

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

Array = NDArray[np.float64]

_EARTH_RADIUS = 6_371_000.0  # m, mean
_START = (29.54, 106.52)  # deg of latitude and longitude: about where the paper's authors drive
_HEADING = np.deg2rad(35.0)  # of the straight road, clockwise from north
_GNSS_STEP = 1.0  # s
_BRAKE_SHARES = (0.325, 0.175)  # of a front and a rear wheel
_DRIVE_SHARES = {"front": (0.5, 0.0), "rear": (0.0, 0.5), "all": (0.25, 0.25)}


@dataclass(frozen=True)
class SensorNoise:
    """How the sensors err: 1σ of independent Gaussian errors of each 100 Hz sample, unless said otherwise.

    The defaults are those of ordinary production sensors, chosen, not identified from one car.

    Attributes:
        accel: accelerometer with the vibration of the body, m/s².
        accel_bias: constant error of the accelerometer, m/s² (the value, not a σ).
        yaw_rate: rad/s.
        wheel_speed: rad/s.
        engine_torque: N·m.
        torque_scale: constant relative error of the torques the car reports (the value, not a σ).
        engine_speed: rad/s.
        wheel_torque: drive torque of a wheel, and its brake torque while the pedal is pressed, N·m.
        position: east and north, m, per 1 Hz fix; half of its variance wanders over ``gnss_time``.
        altitude: m, likewise.
        gnss_time: correlation time of the wandering part, s.
    """

    accel: float = 0.1
    accel_bias: float = 0.05
    yaw_rate: float = 0.003
    wheel_speed: float = 0.05
    engine_torque: float = 2.0
    torque_scale: float = 0.02
    engine_speed: float = 0.5
    wheel_torque: float = 10.0
    position: float = 1.5
    altitude: float = 1.5
    gnss_time: float = 30.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            is_signed = field.name in ("accel_bias", "torque_scale")
            if not np.isfinite(value) or (value < 0 and not is_signed):
                raise InputError(f"sensor noise '{field.name}' is {value}", mend="give a number of 0 or more")

    @classmethod
    def none(cls) -> Self:
        """Sensors that do not err."""
        return cls(**{f.name: 0.0 for f in fields(cls)})


def measure(truth: Truth, vehicle: Vehicle, *, seed: int = 0, noise: SensorNoise | None = None) -> Log:
    """The log that the car's sensors would write of a drive, with truth in its reference channels.

    Wheel speeds, IMU, torques and engine come at 100 Hz, GNSS at 1 Hz (NaN between). The accelerometer sits
    on the body, which pitches by the vehicle's gradient k: with f = v̇ + g sin θ and φ = k f it reads
    f cos φ + g cos θ sin φ + bias + noise. A wheel slips in proportion to its force, κ = F_x/(c_κ F_z), with
    the static load: R ω = (1 + κ) v.

    Args:
        truth: of T samples.
        vehicle: wheels, driven axle, slip stiffness and pitch gradient are used.
        seed: of the noise; the same seed gives the same bits.
        noise: default :class:`SensorNoise`.
    """
    noise = noise if noise is not None else SensorNoise()
    rng = np.random.default_rng(seed)
    count = len(truth.time)

    def white(std: float) -> Array:
        return std * rng.standard_normal(count)

    force = truth.acceleration + GRAVITY * np.sin(truth.grade)
    pitch = vehicle.body.pitch_gradient * force
    body = force * np.cos(pitch) + GRAVITY * np.cos(truth.grade) * np.sin(pitch)
    scale = 1 + noise.torque_scale
    channels: dict[str, Array] = {
        "accel_x": body + noise.accel_bias + white(noise.accel),
        "yaw_rate": white(noise.yaw_rate),
        "brake": truth.brake,
    }
    if vehicle.driveline.kind == "engine":
        channels["engine_torque"] = scale * truth.engine_torque + white(noise.engine_torque)
        channels["engine_speed"] = truth.engine_speed + white(noise.engine_speed)
        channels["gear_ratio"] = truth.gear_ratio
    # what spins up the engine does not reach the wheels
    spin_up = vehicle.driveline.engine_inertia * truth.total_ratio**2 * truth.acceleration
    drive_torque = truth.drive_torque - spin_up / vehicle.wheels.radius
    for i, wheel in enumerate(WHEELS):
        axle = i // 2
        drive = _DRIVE_SHARES[vehicle.driveline.driven][axle] * drive_torque
        brake = _BRAKE_SHARES[axle] * truth.brake_torque
        load = vehicle.static_axle_loads[axle] / 2
        slip = (drive - brake) / vehicle.wheels.radius / (vehicle.tires.slip_stiffness * load)
        speed = (1 + slip) * truth.velocity / vehicle.wheels.radius
        # a tooth sensor counts: it gives no sign, and nothing at rest
        speed = np.abs(speed + np.where(truth.velocity != 0, white(noise.wheel_speed), 0.0))
        # what comes from line pressure is zero with the pedal released
        pressed = np.maximum(scale * brake + white(noise.wheel_torque), 0.0)
        channels[f"wheel_speed_{wheel}"] = speed
        channels[f"drive_torque_{wheel}"] = scale * drive + white(noise.wheel_torque)
        channels[f"brake_torque_{wheel}"] = np.where(truth.brake > 0, pressed, 0.0)
    channels |= _gnss(truth, noise, rng)
    channels |= {"ref_grade": truth.grade, "ref_velocity_x": truth.velocity}
    return Log(truth.time, channels, _metadata(vehicle, noise, seed))


def _gnss(truth: Truth, noise: SensorNoise, rng: np.random.Generator) -> dict[str, Array]:
    fixes = slice(0, None, round(_GNSS_STEP / SAMPLE_STEP))
    count = len(truth.time[fixes])

    def error(std: float) -> Array:
        keep = np.exp(-_GNSS_STEP / noise.gnss_time) if noise.gnss_time > 0 else 0.0
        shocks = std * np.sqrt(0.5 * (1 - keep**2)) * rng.standard_normal(count)
        wander = np.empty(count)
        last = std * np.sqrt(0.5) * rng.standard_normal()
        for i, shock in enumerate(shocks):
            last = keep * last + shock
            wander[i] = last
        total: Array = wander + std * np.sqrt(0.5) * rng.standard_normal(count)
        return total

    # along the level: on these grades the road's own length differs from it by less than 0.3 %
    along = truth.distance[fixes]
    north = along * np.cos(_HEADING) + error(noise.position)
    east = along * np.sin(_HEADING) + error(noise.position)
    latitude = _START[0] + np.rad2deg(north / _EARTH_RADIUS)
    longitude = _START[1] + np.rad2deg(east / (_EARTH_RADIUS * np.cos(np.deg2rad(_START[0]))))
    altitude = truth.altitude[fixes] + error(noise.altitude)
    out: dict[str, Array] = {}
    for name, values in (("latitude", latitude), ("longitude", longitude), ("altitude", altitude)):
        out[name] = np.full(len(truth.time), np.nan)
        out[name][fixes] = values
    return out


def _metadata(vehicle: Vehicle, noise: SensorNoise, seed: int) -> dict[str, Any]:
    return {
        "source": "simulated: a longitudinal point-mass model, not the full vehicle simulator",
        "vehicle": vehicle.name,
        "frame": "ISO 8855",
        "rate": 1 / SAMPLE_STEP,
        "seed": seed,
        "noise": {f.name: getattr(noise, f.name) for f in fields(noise)},
    }
