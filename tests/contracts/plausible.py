"""A drive in which every canonical channel agrees with every other, for estimators yet unknown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadstate.core import CHANNELS, WHEELS, Estimates, Log
from roadstate.core.constants import GRAVITY
from roadstate.core.quantities import BOUNDS
from roadstate.vehicles import Vehicle

GRADE = np.arctan(0.04)
GEAR = 2  # third


def plausible_log(vehicle: Vehicle, samples: int, *, tick: float = 1 / 128, seed: int = 0) -> Log:
    """A car that speeds up and slows down gently, weaving a little, up a slope of 4 %, always under power.

    Args:
        vehicle: its geometry and driveline; driven as in third gear.
        samples: how many.
        tick: s between samples; a power of two, so that times are exact.
        seed: of the sensors' noise.
    """
    random = np.random.default_rng(seed)
    time = np.arange(samples) * tick
    speed, slope = 15 + 0.5 * np.sin(0.3 * time), 0.15 * np.cos(0.3 * time)
    yaw_rate = 0.05 * np.sin(0.4 * time)
    R, total = vehicle.wheels.radius, vehicle.driveline.gear_ratios[GEAR] * vehicle.driveline.final_drive
    pitch = 1 + GRAVITY * vehicle.body.pitch_gradient
    friction = (
        vehicle.rolling_resistance.coefficient + vehicle.rolling_resistance.speed_coefficient * speed**2
    )
    drag = 0.5 * vehicle.aerodynamics.air_density * vehicle.drag_area * speed**2
    resistance = drag + vehicle.mass * GRAVITY * (friction * np.cos(GRADE) + np.sin(GRADE))
    at_wheels = (resistance + vehicle.effective_mass(total) * slope) * R
    efficiency = np.where(at_wheels > 0, vehicle.driveline.efficiency, 1 / vehicle.driveline.efficiency)

    values = {
        name: np.zeros(samples) for name, c in CHANNELS.items() if name != "time" and not c.is_reference
    }
    values |= {
        "speed": speed,
        "steer": yaw_rate * vehicle.wheelbase / speed,
        "accel_x": pitch * (slope + GRAVITY * np.sin(GRADE)),
        "accel_y": speed * yaw_rate,
        "accel_z": np.full(samples, GRAVITY * np.cos(GRADE)),
        "kinematic_accel_x": slope,
        "kinematic_accel_y": speed * yaw_rate,
        "yaw_rate": yaw_rate,
        "yaw_accel": 0.02 * np.cos(0.4 * time),
        "engine_torque": at_wheels / (total * efficiency),
        "engine_speed": speed / R * total,
        "gear_ratio": np.full(samples, vehicle.driveline.gear_ratios[GEAR]),
        "latitude": np.full(samples, 48.0),
        "longitude": np.full(samples, 11.0),
        "altitude": 500 + np.sin(GRADE) * np.cumsum(speed) * tick,
        "vertical_speed": speed * np.sin(GRADE),
    }
    values["steering_wheel"] = values["steer"] * vehicle.steering.ratio  # type: ignore[union-attr]
    driven = {"front": WHEELS[:2], "rear": WHEELS[2:], "all": WHEELS}[vehicle.driveline.driven]
    for wheel in WHEELS:
        track = vehicle.geometry.track_front if wheel[0] == "f" else vehicle.geometry.track_rear
        side = -1 if wheel[1] == "l" else 1
        values[f"wheel_speed_{wheel}"] = (speed + side * yaw_rate * track / 2) / R
        if wheel in driven:
            values[f"drive_torque_{wheel}"] = at_wheels / len(driven)
    noise = {"speed": 0.05, "accel_x": 0.1, "yaw_rate": 0.003, "altitude": 0.5, "vertical_speed": 0.03}
    for name, std in noise.items():
        values[name] = values[name] + std * random.normal(size=samples)
    references = {"ref_grade": np.full(samples, GRADE), "ref_velocity_x": speed}
    return Log(time, {**values, **references})


_MIRRORED_SIGN = {
    "bank",
    "steer",
    "steering_wheel",
    "accel_y",
    "kinematic_accel_y",
    "yaw_rate",
    "yaw_accel",
    "velocity_y",
    "roll_rate",
    "ref_bank",
    "ref_velocity_y",
    *(f"{kind}_y_{w}" for kind in ("ref_force", "force") for w in (*WHEELS, "front", "rear")),
}
_OTHER_SIDE = {"left": "right", "right": "left", "fl": "fr", "fr": "fl", "rl": "rr", "rr": "rl"}


def other_side(name: str) -> str:
    """What a channel, a quantity or a bound of one is called in the mirror."""
    bound = next((b for b in BOUNDS if name.endswith(b)), "")
    stem, _, place = name.removesuffix(bound).rpartition("_")
    return f"{stem}_{_OTHER_SIDE[place]}{bound}" if place in _OTHER_SIDE else name


def sign_in_mirror(name: str) -> int:
    """−1 for what points to a side."""
    return -1 if name in _MIRRORED_SIGN else 1


def mirrored(log: Log) -> Log:
    """The same drive seen in a mirror: left is right."""
    channels = {other_side(n): sign_in_mirror(n) * v for n, v in log.channels.items()}
    return Log(log.time, channels, log.metadata)


def reflected(e: Estimates) -> Estimates:
    """What the same estimator should say of the mirrored drive, in the order of its own sensors."""
    values = {other_side(n): sign_in_mirror(n) * v for n, v in e.values.items()}
    std = {other_side(n): v for n, v in e.std.items()}
    column = [e.sensors.index(other_side(s)) for s in e.sensors]
    sign = np.array([sign_in_mirror(s) for s in e.sensors])
    ordered = {n: values[n] for n in e.values}, {n: std[n] for n in e.std}
    innovation, spread = sign * e.innovation[:, column], e.innovation_std[:, column]
    return replace(e, values=ordered[0], std=ordered[1], innovation=innovation, innovation_std=spread)
