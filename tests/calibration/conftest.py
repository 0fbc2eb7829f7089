"""Logs whose truth is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from calibration_case import SPEED_NOISE

from roadstate.core import Log
from roadstate.sim import SpeedPlan, simulate
from roadstate.vehicles import Vehicle, load_vehicle


@pytest.fixture(scope="session")
def car() -> Vehicle:
    return load_vehicle("family-car")


@pytest.fixture(scope="session")
def level() -> Log:
    """Two minutes on a level road: speed and accelerometer with white noise."""
    random = np.random.default_rng(3)
    time = np.arange(0.0, 120.0, 0.05)
    speed = 20 + 5 * np.sin(0.3 * time)
    accel = 1.5 * np.cos(0.3 * time)
    return Log(
        time,
        {
            "speed": speed + SPEED_NOISE * random.normal(size=len(time)),
            "accel_x": accel + 0.03 * 20**0.5 * random.normal(size=len(time)),
        },
    )


@pytest.fixture(scope="session")
def hilly(car: Vehicle) -> Log:
    """Half a minute of speeding up and braking, by the longitudinal plant and its sensors."""
    knots, speeds = (0.0, 6.0, 12.0, 18.0, 24.0, 31.0), (10.0, 22.0, 12.0, 24.0, 12.0, 24.0)
    return simulate(car, SpeedPlan(knots, speeds), seed=4)
