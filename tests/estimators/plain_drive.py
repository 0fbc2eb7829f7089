"""A drive by the kinematics of a rigid car whose wheels roll: what every sensor would say, in closed form."""

from __future__ import annotations

import numpy as np

from roadstate.core import Log
from roadstate.core.constants import GRAVITY
from roadstate.vehicles import Vehicle

Array = np.ndarray
_NOISE = {"accel": 0.05, "yaw_rate": 0.003, "wheel": 0.05, "steer": 0.01, "torque": 10.0, "speed": 0.05}


def plain_drive(
    vehicle: Vehicle, time: Array, speed: Array, yaw_rate: Array, *, grade: float = 0.0, seed: int = 0
) -> Log:
    """Signals of a front-driven car without sideslip's rate, on a road of constant grade (rad).

    Args:
        vehicle: of whose figures all is made.
        time: (T,) s.
        speed: (T,) m/s along x, negative in reverse.
        yaw_rate: (T,) rad/s.
        grade: of the road, rad.
        seed: of the noise.
    """
    rng = np.random.default_rng(seed)
    geometry, tires, radius = vehicle.geometry, vehicle.tires, vehicle.wheels.radius

    def noisy(values: Array, kind: str) -> Array:
        return values + _NOISE[kind] * rng.standard_normal(len(time))

    rate = np.gradient(speed, time)
    along, across = rate + GRAVITY * np.sin(grade), speed * yaw_rate
    base = geometry.cg_to_front_axle + geometry.cg_to_rear_axle
    understeer = (1 / tires.cornering_stiffness_front - 1 / tires.cornering_stiffness_rear) / GRAVITY
    moving = np.where(np.abs(speed) < 0.5, np.inf, speed)
    steer = (base + understeer * speed**2) * yaw_rate / moving
    half = 0.5 * np.array([geometry.track_front, -geometry.track_front, geometry.track_rear, -geometry.track_rear])
    turn = np.array([1.0, 1.0, 0.0, 0.0])[:, None] * steer
    rims = (speed - half[:, None] * yaw_rate) / np.cos(turn)
    body = vehicle.body
    channels = {
        "accel_x": noisy(along * (1 + GRAVITY * body.pitch_gradient), "accel"),
        "accel_y": noisy(across * (1 + GRAVITY * body.roll_gradient), "accel"),
        "yaw_rate": noisy(yaw_rate, "yaw_rate"),
        "steering_wheel": noisy(steer * vehicle.steering.ratio, "steer"),
        "gear_ratio": np.where(speed < 0, -3.5, 3.5),
    }
    for i, wheel in enumerate(("fl", "fr", "rl", "rr")):
        channels[f"wheel_speed_{wheel}"] = np.abs(noisy(rims[i] / radius, "wheel") * (np.abs(speed) > 0.1))
    inertia = vehicle.wheels.inertia
    drag = 0.5 * 1.2 * vehicle.aero.drag_area * speed * np.abs(speed)
    rolling = vehicle.tires.rolling_resistance * vehicle.mass * GRAVITY * np.tanh(speed)
    torque = radius * (vehicle.mass * along + drag + rolling) + 4 * inertia * rate / radius
    pulling = np.where(torque * np.where(speed < 0, -1, 1) > 0, torque, 0.0)
    braking = np.abs(torque - pulling)
    for wheel, share in (("fl", 0.3), ("fr", 0.3), ("rl", 0.2), ("rr", 0.2)):
        front = wheel[0] == "f"
        channels[f"drive_torque_{wheel}"] = noisy(0.5 * pulling, "torque") if front else np.zeros(len(time))
        channels[f"brake_torque_{wheel}"] = np.maximum(noisy(share * braking, "torque"), 0.0)
    channels["speed"] = np.where(np.arange(len(time)) % 10 == 0, noisy(np.abs(speed), "speed"), np.nan)
    return Log(time, channels)
