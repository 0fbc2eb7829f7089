"""Samples that a table repeats from row to row, told from signals that are only coarse."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import Log
from roadstate.core.held import hold_period, is_new, sampled

Array = NDArray[np.float64]
TIME = np.arange(0.0, 120.0, 0.01)
SPEED = 15 + 10 * np.sin(TIME / 9)


def held(values: Array, rows: float, jitter: float = 0.0) -> Array:
    """The latest sample of a clock that ticks every ``rows`` rows, each up to ``jitter`` rows off."""
    ticks = np.arange(0, len(values), rows)
    at = ticks + jitter * np.random.default_rng(0).uniform(-1, 1, len(ticks))
    latest = np.searchsorted(at, np.arange(len(values)), side="right") - 1
    return values[ticks[np.maximum(latest, 0)].astype(int)]


@pytest.mark.parametrize("rows", [2, 3, 5, 10, 50, 200])
def test_the_period_of_a_slow_clock(rows: int) -> None:
    noisy = SPEED + np.random.default_rng(rows).normal(0, 0.1, len(SPEED))
    many = np.tile(noisy, 5)
    assert hold_period(held(many, rows)) == rows


@pytest.mark.parametrize(("rows", "jitter"), [(10.03, 0.0), (10, 0.6), (20, 1.0)])
def test_a_clock_of_its_own(rows: float, jitter: float) -> None:
    """One that drifts against the table's, or jitters: each sample is taken as often as it was taken."""
    values = held(SPEED, rows, jitter)
    assert hold_period(values) == round(rows)
    new = is_new(values, round(rows))
    assert new.sum() == pytest.approx(len(values) / rows, rel=0.01)
    assert new[1:][np.diff(values) != 0].all()


def test_a_value_that_comes_twice_is_two_samples() -> None:
    coarse = np.round(np.minimum(SPEED, 20.0), 2)
    values = held(coarse, 10)
    taken, rows = sampled(values)
    assert rows == 10
    assert np.isfinite(taken).sum() == len(values) // 10
    stays = values == 20.0
    assert np.isfinite(taken[stays]).sum() == pytest.approx(stays.sum() / 10, abs=2)


@pytest.mark.parametrize(
    ("what", "values"),
    [
        ("its own noise", SPEED + np.random.default_rng(0).normal(0, 0.1, len(SPEED))),
        ("whole km/h", np.round(3.6 * SPEED) / 3.6),
        ("whole km/h of a steady acceleration", np.round(3.6 * 0.5 * TIME) / 3.6),
        ("a converter's few steps", np.round(SPEED + np.random.default_rng(0).normal(0, 0.3, len(SPEED)))),
        ("a switch", np.where(np.sin(TIME) > 0, 1.0, 0.0)),
        ("standing", np.zeros(len(TIME))),
        ("nothing", np.full(len(TIME), np.nan)),
        ("one sample", np.ones(1)),
    ],
)
def test_what_is_not_held(what: str, values: Array) -> None:
    taken, rows = sampled(values)
    assert rows == 1, what
    assert taken is values


def test_samples_are_counted_where_there_are_any() -> None:
    """A receiver held over the rows in which another message came, too."""
    values = np.full(2 * len(SPEED), np.nan)
    values[::2] = held(SPEED, 10)
    taken, rows = sampled(values)
    assert rows == 10
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(taken))[:3], [0, 20, 40])


def test_a_log_made_in_memory() -> None:
    log = Log(TIME, {"speed": held(SPEED, 10), "accel_x": SPEED, "ref_velocity_x": held(SPEED, 10)})
    once = log.without_repeats()
    assert np.isfinite(once["speed"]).sum() == len(TIME) // 10
    np.testing.assert_array_equal(once["speed"][::10], log["speed"][::10])
    for name in ("accel_x", "ref_velocity_x"):
        np.testing.assert_array_equal(once[name], log[name])
