"""Logs with samples that no car could make, and with holes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import Log
from roadstate.estimators import Estimator, build
from roadstate.run import scan
from roadstate.vehicles import Vehicle

pytestmark = pytest.mark.usefixtures("optimised")

Array = NDArray[np.float64]
SPEED = 12 + 3 * np.sin(np.arange(0, 50, 0.01) / 4)
GRADE = 0.04 * np.sin(np.arange(0, 50, 0.01) / 9)


@pytest.fixture(scope="module")
def log(drive: Callable[..., Log]) -> Log:
    """All sensors, noisy, over hills."""
    made, rng = drive(SPEED, GRADE), np.random.default_rng(5)
    count = len(SPEED)
    channels = {name: values.copy() for name, values in made.channels.items()}
    channels["accel_x"] += rng.normal(0, 0.2, count)
    for name in [name for name in channels if name.startswith("wheel_speed")]:
        channels[name] += rng.normal(0, 0.03, count)
    channels["accel_y"] = rng.normal(0, 0.2, count)
    channels["yaw_rate"] = rng.normal(0, 0.003, count)
    channels["pitch_rate"] = -np.gradient(GRADE, 0.01) + rng.normal(0, 0.003, count)
    channels["steering_wheel"] = rng.normal(0, 0.01, count)
    climb = np.where(np.arange(count) % 10 == 0, SPEED * np.sin(GRADE), np.nan)
    channels["vertical_speed"] = climb + rng.normal(0, 0.1, count)
    return Log(made.time, channels)


@pytest.fixture(scope="module")
def joint(vehicle: Vehicle, log: Log) -> Estimator:
    return build("joint", vehicle, log.available)


SIGNALS = ("accel_x", "accel_y", "yaw_rate", "pitch_rate", "steering_wheel", "wheel_speed_fl")


@pytest.mark.parametrize("value", [-999.0, 65535.0, 1e6])
@pytest.mark.parametrize("name", SIGNALS)
def test_samples_that_no_car_makes_are_missing_ones(
    joint: Estimator, log: Log, name: str, value: float
) -> None:
    """However many there are: what a bus or a logger puts where it knows nothing."""
    bad = (log.time >= 20) & (log.time < 20.1)
    said, without = (
        scan(joint, Log(log.time, {**log.channels, name: np.where(bad, put, log[name])}))
        for put in (value, np.nan)
    )
    for quantity, tolerance in {"grade": 2e-4, "speed": 0.01, "friction_peak": 0.02}.items():
        np.testing.assert_allclose(said.values[quantity], without.values[quantity], atol=tolerance)


@pytest.mark.parametrize("gap", [0.6, 3.0, 10.0, 18.0])
def test_after_a_hole_in_the_log_nothing_is_faulty_and_nothing_overconfident(
    joint: Estimator, log: Log, gap: float
) -> None:
    kept = (log.time < 12) | (log.time >= 12 + gap)
    holed = Log(log.time[kept], {name: values[kept] for name, values in log.channels.items()})
    said = scan(joint, holed)
    error = np.abs(said.values["grade"] - np.sin(holed["ref_grade"])) / said.std["grade"]
    assert np.max(error[holed.time > 11]) < 3.5
    assert np.max(np.abs(said.values["speed"] - holed["ref_velocity_x"])[holed.time > 12.5 + gap]) < 0.3
    named = [fault for fault in said.metadata["faults"] if fault["share"] > 0.02]
    assert not named
