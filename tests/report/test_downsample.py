"""Thinned-out lines keep every peak and every gap."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadstate.core import Validity
from roadstate.report.downsample import SEVERITY, envelope, runs, select


def test_a_short_series_is_kept_as_it_is() -> None:
    time, values = np.arange(6.0), np.array([3.0, 1.0, 4.0, 1.0, 5.0, 9.0])
    chosen = select(time, values, 16)
    np.testing.assert_array_equal(chosen.index, np.arange(6))
    assert not chosen.is_break.any()
    np.testing.assert_array_equal(chosen.take(values), values)


@given(st.integers(0, 99_999), st.sampled_from([-1.0, 1.0]), st.integers(40, 3000))
def test_a_single_sample_spike_survives(where: int, sign: float, points: int) -> None:
    values = np.sin(np.arange(100_000) / 777.0)
    values[where] = sign * 50.0
    chosen = select(np.arange(100_000) * 0.01, values, points)
    assert where in chosen.index
    assert len(chosen.index) <= points + 4
    assert (np.diff(chosen.index) > 0).all()


def test_every_bin_keeps_its_extremes_not_only_the_largest() -> None:
    values = np.zeros(100_000)
    spikes = np.arange(500, 100_000, 1000)
    values[spikes] = np.where(np.arange(len(spikes)) % 2, 1.0, -1.0) * 5.0
    assert set(spikes) <= set(select(np.arange(100_000) * 0.01, values, 1000).index.tolist())


def test_a_nan_block_stays_a_gap() -> None:
    time, values = np.arange(50_000) * 0.01, np.ones(50_000)
    values[20_000:20_010] = np.nan  # far shorter than a bin
    chosen = select(time, values, 200)
    assert chosen.is_break.sum() == 1
    at = int(np.flatnonzero(chosen.is_break)[0])
    assert chosen.index[at - 1] == 19_999
    assert chosen.index[at + 1] == 20_010
    assert np.isnan(chosen.take(values)[at])


def test_lost_time_breaks_the_line() -> None:
    time = np.concatenate([np.arange(0.0, 10.0, 0.1), np.arange(30.0, 40.0, 0.1)])
    chosen = select(time, np.ones(200), 1000)
    np.testing.assert_array_equal(np.flatnonzero(chosen.is_break), [100])


def test_a_slow_sensor_in_a_fast_log_is_one_line() -> None:
    values = np.full(10_000, np.nan)
    values[::100] = 7.0
    chosen = select(np.arange(10_000) * 0.01, values, 1000)
    np.testing.assert_array_equal(chosen.index, np.arange(0, 10_000, 100))
    assert not chosen.is_break.any()


def test_a_sample_between_two_gaps_is_told() -> None:
    values = np.full(1000, np.nan)
    values[:100], values[500], values[900:] = 1.0, 2.0, 3.0
    np.testing.assert_array_equal(select(np.arange(1000.0), values, 400).lone, [500])


def test_of_too_many_gaps_the_longest_stay() -> None:
    time = np.cumsum(np.where(np.arange(2000) % 10 == 0, 0.5, 0.1))
    time[1000:] += 60.0
    chosen = select(time, np.zeros(2000), 80)
    assert chosen.is_break.sum() == 10
    assert 999 in chosen.index[chosen.is_break]


@pytest.mark.parametrize("values", [np.full(20, np.nan), np.zeros(0)])
def test_nothing_to_draw(values: np.ndarray) -> None:
    assert len(select(np.arange(float(len(values))), values, 100).index) == 0
    x, y = envelope(np.arange(float(len(values))), values, values, 100)
    assert len(x) == len(y) == 0


def test_a_short_band_is_kept_as_it_is() -> None:
    time = np.arange(3.0)
    x, y = envelope(time, -time, time, 16)
    np.testing.assert_array_equal(x, [0, 1, 2, 2, 1, 0])
    np.testing.assert_array_equal(y, [0, -1, -2, 2, 1, 0])


@given(st.integers(0, 2**31), st.integers(20, 400))
def test_a_thinned_band_encloses_every_sample(seed: int, points: int) -> None:
    random = np.random.default_rng(seed)
    time = np.cumsum(random.uniform(0.5, 1.5, 5000))
    middle = random.standard_normal(5000).cumsum()
    half = random.exponential(1.0, 5000)
    x, y = envelope(time, middle - half, middle + half, points)
    edges = len(x) // 2
    assert edges <= points
    lower = np.interp(time, x[:edges], y[:edges])
    upper = np.interp(time, x[edges:][::-1], y[edges:][::-1])
    assert (lower <= middle - half + 1e-9).all()
    assert (upper >= middle + half - 1e-9).all()


def test_a_band_is_split_where_it_is_missing() -> None:
    time, width = np.arange(1000.0), np.ones(1000)
    width[300:400] = np.nan
    x, y = envelope(time, -width, width, 100)
    lift = np.flatnonzero(np.isnan(x))
    assert len(lift) == 1
    np.testing.assert_array_equal(lift, np.flatnonzero(np.isnan(y)))
    assert np.nanmax(x[: lift[0]]) == 299.0
    assert np.nanmin(x[lift[0] + 1 :]) == 400.0


def test_runs_of_validity() -> None:
    codes = np.array([0, 0, 2, 2, 2, 0], np.int8)
    start, stop, code = runs(np.arange(6.0), codes, 100)
    np.testing.assert_array_equal(start, [0, 2, 5])
    np.testing.assert_array_equal(stop, [2, 5, 6])
    np.testing.assert_array_equal(code, [0, 2, 0])


def test_validity_is_not_drawn_over_lost_time() -> None:
    time = np.concatenate([np.arange(10.0), 50.0 + np.arange(10.0)])
    start, stop, _ = runs(time, np.zeros(20, np.int8), 100)
    np.testing.assert_array_equal(start, [0, 50])
    np.testing.assert_array_equal(stop, [10, 60])


def test_a_short_divergence_shows_in_a_long_log() -> None:
    codes = np.tile(np.array([Validity.EXCITED, Validity.BRAKING], np.int8), 50_000)
    codes[70_001] = Validity.DIVERGED
    start, stop, code = runs(np.arange(100_000) * 0.01, codes, 200)
    assert len(start) <= 200
    hit = int(np.flatnonzero(code == Validity.DIVERGED)[0])
    assert start[hit] <= 700.01 <= stop[hit]


def test_every_validity_has_a_rank() -> None:
    assert sorted(SEVERITY) == sorted(Validity)
