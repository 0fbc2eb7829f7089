"""What an accelerometer away from the centre of gravity feels of the car's turning."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import ValidationError

from roadstate.core import InputError, Recording, Signal
from roadstate.core.channels import RATES, SPECIFIC_FORCES
from roadstate.io import Mapping
from roadstate.io.lever_arm import LeverArm, to_center

Array = NDArray[np.float64]
RHO = np.array([-1.0, 0.4, 0.3])
ARM = LeverArm(forward=-1.0, left=0.4, up=0.3)


def turning(time: Array) -> tuple[Array, Array]:
    """(T, 3) rates and their derivatives: a swerve twice in three seconds."""
    size, at, late = np.array([0.1, 0.06, 0.4]), 2 * np.pi * np.array([1.2, 0.8, 0.7]), [0.3, 1.1, 0.0]
    phase = at * time[:, None] + late
    return size * np.sin(phase), size * at * np.cos(phase)


def felt(time: Array) -> Array:
    """(T, 3) at the sensor, of a car whose centre of gravity feels (1, -2, 9.8)."""
    rate, rise = turning(time)
    return np.array([1.0, -2.0, 9.8]) + np.cross(rise, RHO) + np.cross(rate, np.cross(rate, RHO))


def drive(gyro: Array, time: Array) -> dict[str, Signal]:
    rate, accel = turning(gyro)[0], felt(time)
    signals = {name: Signal(gyro, rate[:, i]) for i, name in enumerate(RATES)}
    return signals | {name: Signal(time, accel[:, i]) for i, name in enumerate(SPECIFIC_FORCES)}


@pytest.mark.parametrize("rate", [50.0, 100.0, 1000.0])
def test_it_is_what_the_centre_of_gravity_feels(rate: float) -> None:
    """The gyroscope on a base of its own, whose steps are uneven."""
    rng = np.random.default_rng(1)
    gyro = np.cumsum(rng.uniform(0.5, 1.5, int(6 * rate)) / rate)
    time = np.arange(1.0, 5.0, 0.01)
    out = to_center(drive(gyro, time), ARM)
    uncorrected = felt(time) - [1.0, -2.0, 9.8]
    for i, name in enumerate(SPECIFIC_FORCES):
        off = out[name].values - [1.0, -2.0, 9.8][i]
        assert np.sqrt(np.mean(off**2)) < 0.06 * np.sqrt(np.mean(uncorrected**2))


def test_a_car_that_turns_evenly_is_exact() -> None:
    """Rear left of the centre: -r² times where it sits, along and across."""
    time = np.arange(0, 5, 0.01)
    rates = {"yaw_rate": Signal(time, np.full(500, 0.5))}
    accel = {"accel_x": Signal(time, np.zeros(500)), "accel_y": Signal(time, np.full(500, 10.0))}
    out = to_center(rates | accel, ARM)
    np.testing.assert_allclose(out["accel_x"].values, -0.25, rtol=1e-9)
    np.testing.assert_allclose(out["accel_y"].values, 10.1, rtol=1e-9)
    assert sorted(out) == ["accel_x", "accel_y"]


def test_noise_of_the_gyroscope_is_not_blown_up() -> None:
    """.005 rad/s a sample at 100 Hz, 1 m away: a difference from sample to sample would make 0.7 m/s²."""
    time = np.arange(0, 60, 0.01)
    noise = np.random.default_rng(1).normal(0, 0.005, len(time))
    still = {"yaw_rate": Signal(time, noise), "accel_y": Signal(time, np.zeros(len(time)))}
    assert to_center(still, LeverArm(forward=1.0))["accel_y"].values.std() < 0.07


def test_where_the_car_turns_unknown_nothing_is_changed() -> None:
    time = np.arange(0, 12, 0.01)
    signals = drive(time, time)
    gap = (time > 4) & (time < 8)
    signals |= {name: Signal(time, np.where(gap, np.nan, signals[name].values)) for name in RATES}
    out = to_center(signals, ARM)["accel_y"].values
    within = (time > 4.1) & (time < 7.9)
    np.testing.assert_array_equal(out[within], signals["accel_y"].values[within])
    assert np.abs(out[(time > 1) & (time < 3.9)] + 2.0).max() < 0.06
    assert np.isfinite(out).all()


def mapped(content: dict[str, Any], signals: dict[str, Signal]) -> Recording:
    return Mapping.model_validate(content).apply(Recording(signals, {}))


def test_a_mapping_says_where_it_sits() -> None:
    """With a unit, and of channels that the file names as they are."""
    time = np.arange(0.0, 6.0, 0.01)
    signals = drive(time, time)
    out = mapped({"lever_arm": {"forward": "-100 cm", "left": 0.4, "up": "0.3 m"}}, signals)
    for name in SPECIFIC_FORCES:
        np.testing.assert_array_equal(out[name].values, to_center(signals, ARM)[name].values)
    np.testing.assert_array_equal(out["yaw_rate"].values, signals["yaw_rate"].values)


@pytest.mark.parametrize(
    ("content", "names", "told"),
    [
        (
            {"forward": 1.0},
            SPECIFIC_FORCES,
            "lever_arm: how the car turns is not known: there is no yaw_rate",
        ),
        ({}, SPECIFIC_FORCES, "nowhere but at the centre of gravity"),
        ({"forward": 50.0}, SPECIFIC_FORCES, "forward"),
    ],
)
def test_what_cannot_be_is_refused(content: dict[str, Any], names: tuple[str, ...], told: str) -> None:
    time = np.arange(0.0, 6.0, 0.01)
    signals = {name: s for name, s in drive(time, time).items() if name in names}
    with pytest.raises((InputError, ValidationError), match=told):
        mapped({"lever_arm": content}, signals)
