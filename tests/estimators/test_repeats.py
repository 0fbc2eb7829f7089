"""A speed that repeats itself: in whole km/h a hundred times a second, or held until the next sample."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import WHEELS, Estimates, Log
from roadstate.estimators import build
from roadstate.run import batch
from roadstate.vehicles import Vehicle

pytestmark = pytest.mark.usefixtures("optimised")

Array = NDArray[np.float64]
FROM = 500
"""Samples in which the estimate settles."""


def rounded(speed: Array) -> Array:
    return np.round(3.6 * speed) / 3.6


def cut_off(speed: Array) -> Array:
    return np.floor(3.6 * speed) / 3.6


def held(speed: Array) -> Array:
    noise = np.random.default_rng(5).normal(0, 0.1, len(speed))
    return (speed + noise)[np.arange(len(speed)) // 10 * 10]


def stuck(speed: Array) -> Array:
    """Ten samples a second, which stand still for 8 s while the car begins to slow down, by 8 m/s."""
    noise = np.random.default_rng(6).normal(0, 0.05, len(speed))
    told = np.where(np.arange(len(speed)) % 10 == 0, speed + noise, np.nan)
    lies = slice(STUCK, STUCK + 800)
    told[lies] = np.where(np.isfinite(told[lies]), told[STUCK], np.nan)
    return told


STUCK = 4000
WAYS: dict[str, Callable[[Array], Array]] = {"rounded": rounded, "cut off": cut_off, "held": held}


@pytest.fixture(scope="module")
def logs(drive: Callable[..., Log]) -> dict[str, Log]:
    """Without wheels' speeds, up and down a hill, faster and slower."""
    time = np.arange(0, 90, 0.01)
    grade = 0.04 * np.sin(time / 7)
    log = drive(17 + 8 * np.sin(time / 5), grade)
    rng = np.random.default_rng(0)
    noisy = {
        "accel_x": log["accel_x"] + rng.normal(0, 0.05, len(time)),
        "accel_y": rng.normal(0, 0.05, len(time)),
        "yaw_rate": rng.normal(0, 0.002, len(time)),
        "pitch_rate": rng.normal(0, 0.003, len(time)) - np.gradient(grade, time),
    }
    log = log.with_channels(noisy).select({*log.channels, *noisy} - {f"wheel_speed_{w}" for w in WHEELS})
    ways = WAYS | {"stuck": stuck}
    return {way: log.with_channels({"speed": of(log["ref_velocity_x"])}) for way, of in ways.items()}


@pytest.fixture(scope="module")
def estimates(vehicle: Vehicle, logs: dict[str, Log]) -> dict[str, Estimates]:
    joint = build("joint", vehicle, logs["held"].available)
    return dict(zip(logs, batch([joint] * len(logs), list(logs.values())), strict=True))


@pytest.mark.parametrize("way", list(WAYS))
def test_no_sound_sensor_is_called_faulty(estimates: dict[str, Estimates], way: str) -> None:
    """An error that lasts for a while is no slope that the pitch gyroscope ought to have seen."""
    assert estimates[way].metadata.get("faults", []) == []


@pytest.mark.parametrize(("way", "least"), [("rounded", 0.95), ("cut off", 0.85), ("held", 0.95)])
def test_the_speeds_interval(
    logs: dict[str, Log], estimates: dict[str, Estimates], way: str, least: float
) -> None:
    """Half a km/h of a speed that is cut off cannot be known, but that it is possible can."""
    said = estimates[way]
    error = (said.values["speed"] - logs[way]["ref_velocity_x"])[FROM:]
    std = said.std["speed"][FROM:]
    assert np.mean(np.abs(error) < 1.96 * std) > least
    assert np.median(std) < 0.16


@pytest.mark.parametrize("way", list(WAYS))
def test_the_grades_interval(logs: dict[str, Log], estimates: dict[str, Estimates], way: str) -> None:
    said = estimates[way]
    error = (said.values["grade"] - logs[way]["ref_grade"])[FROM:]
    assert np.sqrt(np.mean(error**2)) < 0.005
    assert np.mean(np.abs(error) < 1.96 * said.std["grade"][FROM:]) > 0.9


def test_a_speed_that_is_stuck(logs: dict[str, Log], estimates: dict[str, Estimates]) -> None:
    """It repeats itself, too, but the car's speed changes meanwhile."""
    said = estimates["stuck"]
    faults = said.metadata["faults"]
    assert [f["fault"] for f in faults] == ["speed: refused, contradicts the motion"]
    assert 0 < faults[0]["first_s"] - STUCK / 100 < 1.5
    error = said.values["speed"] - logs["stuck"]["ref_velocity_x"]
    lies = slice(STUCK, STUCK + 800)
    assert np.abs(error[lies]).max() < 0.5
    assert (np.abs(error) < 3 * said.std["speed"])[lies].all()
