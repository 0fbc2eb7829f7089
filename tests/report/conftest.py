"""Made-up logs and estimates whose numbers do not depend on any random generator."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import WHEELS, Estimates, Log, Validity

Array = NDArray[np.float64]

RADIUS = 0.32  # m, of the made-up car's wheels


def noise(count: int, key: int) -> Array:
    """(count,) values that look normal with unit variance: Box-Muller on two Weyl sequences."""
    i = np.arange(1, count + 1, dtype=np.float64)
    u = (i * 0.6180339887498949 + 0.137 * key) % 1.0
    v = (i * i * 0.7548776662466927 + 0.731 * key) % 1.0
    return np.sqrt(-2.0 * np.log(np.maximum(u, 1e-12))) * np.cos(2.0 * np.pi * v)


def drive(duration: float = 120.0, rate: float = 50.0) -> Log:
    """A drive over hills with a stop, a lost stretch of time, gaps, GNSS at 1 Hz and references."""
    time = np.arange(0.0, duration, 1.0 / rate)
    speed = 14.0 + 6.0 * np.sin(2 * np.pi * time / 70.0)
    stop = (time > 0.45 * duration) & (time < 0.55 * duration)
    speed[stop] = 0.0
    keep = ~((time > 0.70 * duration) & (time < 0.76 * duration))
    time, speed = time[keep], speed[keep]
    n = len(time)
    grade = np.arctan(0.045 * np.sin(2 * np.pi * time / 48.0) + 0.015 * np.sin(2 * np.pi * time / 13.0))
    heading = 0.9 * np.sin(2 * np.pi * time / 90.0) + time / 60.0
    step = np.gradient(time)
    east, north = np.cumsum(speed * np.cos(heading) * step), np.cumsum(speed * np.sin(heading) * step)
    altitude = 52.0 + np.cumsum(speed * np.sin(grade) * step)
    accel = 9.81 * np.sin(grade) + 0.15 * noise(n, 1)
    accel[(time > 0.2 * duration) & (time < 0.24 * duration)] = np.nan
    accel[n // 3] = 6.0
    fix = np.arange(n) % int(rate) == 0

    def slow(values: Array) -> Array:
        return np.where(fix, values, np.nan)

    channels = {
        "speed": speed + 0.02 * noise(n, 2),
        "accel_x": accel,
        "accel_y": 0.4 * np.sin(time / 6.0) + 0.1 * noise(n, 3),
        "yaw_rate": np.gradient(heading, time) + 0.004 * noise(n, 4),
        "engine_torque": np.where(speed > 0, 60.0 + 40.0 * np.sin(time / 5.0), 8.0),
        "brake": np.where((time > 0.42 * duration) & (time < 0.45 * duration), 1.0, 0.0),
        "latitude": slow(48.0 + np.degrees(north / 6_371_008.8)),
        "longitude": slow(11.0 + np.degrees(east / 6_371_008.8 / np.cos(np.radians(48.0)))),
        "altitude": slow(altitude + 0.8 * noise(n, 5)),
        "ref_grade": grade,
        "ref_velocity_x": speed,
    }
    for k, wheel in enumerate(WHEELS):
        channels[f"wheel_speed_{wheel}"] = speed / RADIUS * (1 + 0.004 * k) + 0.05 * noise(n, 6 + k)
    return Log(time, channels, {"files": ["drive.csv"], "rate": rate})


def estimates(log: Log, name: str, key: int, sigma: float = 0.005) -> Estimates:
    """An estimator's result that starts wrong, settles, and is honest about it; ``sigma`` in rad."""
    time = log.time
    n = len(time)
    truth = log["ref_grade"] if "ref_grade" in log else np.zeros(n)
    start = np.exp(-(time - time[0]) / 3.0)
    std = sigma * (1.0 + 8.0 * start)
    wander = np.convolve(noise(n + 30, key), np.full(31, 31**-0.5), "valid")
    grade = truth + std * 0.9 * wander + 0.12 * sigma
    speed = log["speed"] + 0.01 * noise(n, key + 50)
    ahead = np.nan_to_num(log["accel_x"]) * 0 + 0.3
    sensors = ("speed", "accel_x")
    spread = np.stack([np.full(n, 0.05), ahead], axis=1)
    innovation = spread * np.stack([noise(n, key + 70), 1.3 * noise(n, key + 90)], axis=1)
    innovation[np.isnan(log["accel_x"]), 1] = np.nan
    nis = np.nansum((innovation / spread) ** 2, axis=1)
    validity = np.full(n, Validity.EXCITED, np.int8)
    validity[log["speed"] < 0.5] = Validity.STANDSTILL
    validity[log["brake"] > 0] = Validity.BRAKING
    validity[np.isnan(log["accel_x"])] = Validity.SENSOR_MISSING
    validity[time - time[0] < 4.0] = Validity.LOW_EXCITATION
    values = {"grade": grade, "speed": speed}
    deviations = {"grade": std, "speed": np.full(n, 0.02)}
    metadata: dict[str, Any] = {"estimator": name, "options": {"gate": 19.51}}
    return Estimates(time, values, deviations, validity, sensors, innovation, spread, nis, metadata)


@pytest.fixture(scope="session")
def log() -> Log:
    """The made-up drive."""
    return drive()


@pytest.fixture(scope="session")
def results(log: Log) -> dict[str, Estimates]:
    """Two estimators on the made-up drive."""
    return {"kmbe": estimates(log, "kmbe", 3), "debe": estimates(log, "debe", 11, 0.008)}
