"""Drives made by hand, whose grade is known exactly."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import WHEELS, Log
from roadstate.core.constants import GRAVITY
from roadstate.vehicles import Vehicle, load_vehicle

Array = NDArray[np.float64]
RATE = 100.0


@pytest.fixture(scope="session")
def vehicle() -> Vehicle:
    return load_vehicle("family-car")


@pytest.fixture(scope="session")
def drive(vehicle: Vehicle) -> Callable[..., Log]:
    """A noiseless point-mass drive: speed (m/s) and grade (rad) as arrays over time at 100 Hz."""

    def make(speed: Array, grade: Array, *, accel_bias: float = 0.0) -> Log:
        time = np.arange(len(speed)) / RATE
        slope = np.gradient(speed, 1 / RATE)
        pitch = 1 + GRAVITY * vehicle.body.pitch_gradient
        channels = {f"wheel_speed_{w}": speed / vehicle.wheels.radius for w in WHEELS}
        channels["accel_x"] = pitch * (slope + GRAVITY * np.sin(grade)) + accel_bias
        drag = 0.5 * vehicle.aerodynamics.air_density * vehicle.drag_area * speed * np.abs(speed)
        rolling = vehicle.rolling_resistance
        resistance = vehicle.mass * GRAVITY * np.cos(grade) * np.sign(speed)
        resistance *= rolling.coefficient + rolling.speed_coefficient * speed**2
        force = vehicle.effective_mass() * slope + drag + resistance + vehicle.mass * GRAVITY * np.sin(grade)
        torque = force * vehicle.wheels.radius
        for wheel in ("fl", "fr"):
            channels[f"drive_torque_{wheel}"] = np.maximum(torque, 0) / 2
        for wheel in WHEELS:
            channels[f"brake_torque_{wheel}"] = np.maximum(-torque, 0) / 4
        channels["ref_grade"] = grade
        channels["ref_velocity_x"] = speed
        return Log(time, channels)

    return make
