"""Breaks in a log: rows that are not there for seconds or more, as where a logger stopped for a while."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import WHEELS, Log
from roadstate.estimators import build
from roadstate.run import Stream, batch, scan, smooth
from roadstate.run.chunk import BREAK, LONGEST_BREAK, inputs, through
from roadstate.vehicles import Vehicle

Array = NDArray[np.float64]
SPEEDS = tuple(f"wheel_speed_{w}" for w in WHEELS)
TIME = np.arange(0, 60, 0.01)


@pytest.mark.parametrize("gap", [0.0, 0.01, BREAK, 5.1, 7.0, 60.0, LONGEST_BREAK, 1e9])
def test_steps_lead_through_a_break(gap: float) -> None:
    steps = through(gap)
    assert sum(steps) == pytest.approx(min(gap, LONGEST_BREAK))
    assert len(steps) == 1 if gap <= BREAK else 6 < len(steps) < 20
    if gap > BREAK:
        assert min(steps) > 0
        assert steps[:4] == pytest.approx([0.1] * 4)
        assert steps[-1] < 0.05


def broken(log: Log, *breaks: tuple[float, float]) -> Log:
    kept = np.ones(len(log), bool)
    for begin, end in breaks:
        kept &= (log.time <= begin) | (log.time > end)
    return Log(log.time[kept], {name: values[kept] for name, values in log.channels.items()})


@pytest.fixture
def log(vehicle: Vehicle, drive: Callable[..., Log]) -> Log:
    """Over hills, with two breaks."""
    speed = 15 + 5 * np.sin(0.2 * TIME)
    whole = drive(speed, 0.04 * np.sin(0.1 * TIME))
    return broken(whole, (12.0, 19.0), (30.0, 52.5))


def test_rows_are_the_logs_own(vehicle: Vehicle, log: Log) -> None:
    estimator = build("kmbe", vehicle, log.available)
    samples, dt, own = inputs(estimator, log)
    assert len(own) == len(log) < len(samples)
    np.testing.assert_allclose(np.cumsum(dt)[own], log.time - log.time[0])
    between = np.setdiff1d(np.arange(len(samples)), own)
    assert np.isnan(samples[between]).all()
    told = np.stack([log[c] for c in estimator.channels if c in log.channels])
    np.testing.assert_array_equal(samples[own][:, [c in log.channels for c in estimator.channels]].T, told)


def test_however_a_log_is_run(vehicle: Vehicle, log: Log) -> None:
    """Whole, beside others and sample by sample; and smoothed, with a row for each sample."""
    estimator = build("kmbe", vehicle, log.available)
    counted: list[tuple[int, int]] = []
    said = scan(estimator, log, progress=lambda *far: counted.append(far))
    assert len(said.time) == len(log)
    assert counted[-1] == (len(log), len(log))
    pair = batch(estimator, [log, log.between(0, 30)], together=2)
    stream = Stream(estimator)
    for i, time in enumerate(log.time):
        now = stream.push(time, {c: v[i] for c, v in log.channels.items()})
        assert float(now.values["grade"]) == pytest.approx(said.values["grade"][i], rel=1e-9, abs=1e-12)
        assert float(now.std["grade"]) == pytest.approx(said.std["grade"][i], rel=1e-9)
    np.testing.assert_allclose(pair[0].values["grade"], said.values["grade"], rtol=1e-9, atol=1e-12)
    assert len(pair[1].time) == len(log.between(0, 30))
    back = smooth(estimator, log)
    assert len(back.time) == len(log)
    assert np.isfinite(back.values["grade"]).all()


@pytest.mark.parametrize("gap", [10.0, 30.0, 120.0])
def test_another_road_lies_behind_a_break(vehicle: Vehicle, drive: Callable[..., Log], gap: float) -> None:
    """It begins while the car stands, and ends at speed on another slope: the old one may not be kept."""
    random = np.random.default_rng(3)
    end = 15 + gap
    time = np.arange(0, end + 20, 0.01)
    speed = np.where(time < 15, np.clip(2 * (10 - time), 0, 15), 18.0)
    grade = np.where(time < 15, -0.05, 0.03)
    whole = drive(speed, grade)
    channels = {"accel_x": whole["accel_x"] + random.normal(0, 0.08, len(time))}
    channels |= {w: np.abs(whole[w] + random.normal(0, 0.03, len(time))) for w in SPEEDS}
    log = broken(Log(time, channels), (14.9, end + 0.1))
    said = scan(build("joint", vehicle, log.available), log)
    after = log.time > end
    error = said.values["grade"] - np.where(log.time < 15, -0.05, 0.03)
    assert np.abs(error / said.std["grade"])[after].max() < 3
    assert np.abs(said.values["speed"] - 18)[log.time > end + 1].max() < 0.5
    assert not said.metadata["faults"]
