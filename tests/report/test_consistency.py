"""Innovation and error statistics against scipy and against hand calculations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from roadstate.core import Estimates, Log
from roadstate.metrics import evaluate
from roadstate.report.consistency import (
    EXPECTED_BEYOND,
    LAGS,
    error_consistency,
    nis_consistency,
    sensor_consistency,
    windowed_ratio,
)


def test_expected_share_beyond_two_sigma() -> None:
    assert pytest.approx(2 * stats.norm.sf(2.0)) == EXPECTED_BEYOND


def two_sensors() -> Estimates:
    innovation = np.array([[1.0, 0.5], [-3.0, np.nan], [0.0, -0.5], [np.nan, np.nan]])
    spread = np.array([[1.0, 0.5]] * 4)
    nis = np.array([2.0, 9.0, 1.0, np.nan])
    return Estimates(np.arange(4.0), {}, {}, np.zeros(4, np.int8), ("a", "b"), innovation, spread, nis)


def test_sensors_by_hand() -> None:
    a, b = sensor_consistency(two_sensors())
    assert (a.sensor, a.n, b.sensor, b.n) == ("a", 3, "b", 2)
    assert a.mean == pytest.approx(-2 / 3)
    assert a.rms == pytest.approx(math.sqrt(10 / 3))
    assert a.beyond == pytest.approx(1 / 3)
    assert (b.mean, b.rms, b.beyond) == (0.0, 1.0, 0.0)


def test_nis_by_hand() -> None:
    found = nis_consistency(two_sensors())
    assert found is not None
    assert found.n == 3
    assert found.mean.value == pytest.approx(12 / 5)  # 2, 1 and 2 sensors
    assert found.mean.low == pytest.approx(stats.chi2.ppf(0.025, 5) / 5)
    assert found.mean.high == pytest.approx(stats.chi2.ppf(0.975, 5) / 5)
    assert found.beyond == pytest.approx(1 / 3)  # 9 > 3.84; 2 and 1 < 5.99


def test_the_limit_follows_the_number_of_sensors() -> None:
    estimates = two_sensors()
    estimates.nis[:3] = [5.0, 5.0, 5.0]  # above 3.84 with one sensor, below 5.99 with two
    found = nis_consistency(estimates)
    assert found is not None
    assert found.beyond == pytest.approx(1 / 3)


def test_windows_by_hand() -> None:
    estimates = two_sensors()
    center, ratio = windowed_ratio(estimates.time, estimates, 2.0)
    np.testing.assert_allclose(center, [1.0, 3.0])
    np.testing.assert_allclose(ratio, [11 / 3, 1 / 2])


def of_sensor(values: np.ndarray) -> Estimates:
    """One sensor's innovations of unit deviation, a sample in every row that is not NaN."""
    n = len(values)
    spread = np.ones((n, 1))
    return Estimates(
        np.arange(float(n)), {}, {}, np.zeros(n, np.int8), ("a",), values[:, None], spread, values**2
    )


def test_whiteness_counts_a_sensors_own_samples() -> None:
    """A slow sensor in a fast log: what lies between its samples is no lag."""
    rng = np.random.default_rng(4)
    own = rng.normal(size=2000)
    sparse = np.full(20_000, np.nan)
    sparse[::10] = own
    [row] = sensor_consistency(of_sensor(sparse))
    assert row.autocorrelation is not None
    rho = [
        np.sum(own[k:] * own[:-k]) / np.sqrt(np.sum(own[k:] ** 2) * np.sum(own[:-k] ** 2)) for k in (1, LAGS)
    ]
    np.testing.assert_allclose(row.autocorrelation.correlation[[0, -1], 0], rho, rtol=1e-12)
    assert row.autocorrelation.portmanteau[0] < row.autocorrelation.limit


def test_coloured_innovations_are_not_white_and_short_ones_untold() -> None:
    rng = np.random.default_rng(5)
    coloured = np.convolve(rng.normal(size=3000), [0.8, 0.6])
    [row] = sensor_consistency(of_sensor(coloured))
    assert row.autocorrelation is not None
    assert row.autocorrelation.portmanteau[0] > row.autocorrelation.limit
    assert row.autocorrelation.correlation[0, 0] == pytest.approx(0.48, abs=0.05)
    [short] = sensor_consistency(of_sensor(coloured[: 2 * LAGS]))
    assert short.autocorrelation is None


def with_errors(error: np.ndarray, sigma: float = 0.01) -> tuple[Estimates, Log]:
    time = np.arange(float(len(error)))
    truth = 0.02 * np.sin(time / 50)
    std = {"grade": np.full(len(error), sigma)}
    return (
        Estimates(time, {"grade": truth + error}, std, np.zeros(len(error), np.int8)),
        Log(time, {"ref_grade": truth}),
    )


def test_bands_of_correlated_errors_hold_as_often_as_they_promise() -> None:
    """Errors of a perfect filter with a memory of 10 samples: NEES inside its band about 95 times in 100."""
    rng, a, runs = np.random.default_rng(6), np.exp(-0.1), 200
    inside = covered = 0
    for _ in range(runs):
        noise = rng.normal(size=4000) * np.sqrt(1 - a**2)
        noise[0] /= np.sqrt(1 - a**2)
        e = np.empty(4000)
        last = 0.0
        for k, w in enumerate(noise):
            last = a * last + w
            e[k] = last
        found = error_consistency(*with_errors(0.01 * e), "grade")
        assert found is not None
        assert found.nees.value == pytest.approx(np.mean(e**2))
        assert 4000 / 64 <= found.independent <= 4000 / 8
        inside += bool(found.nees.inside)
        covered += bool(found.coverage.inside)
    # binomial: 0.95 ± 3.3 × 0.015; the mean of all samples wanders a little less than that of the few
    assert inside / runs >= 0.90
    assert covered / runs >= 0.90


def test_a_wrong_sigma_is_found() -> None:
    error = 0.02 * np.random.default_rng(7).normal(size=5000)
    found = error_consistency(*with_errors(error), "grade")
    assert found is not None
    assert found.independent == 5000
    assert found.nees.value == pytest.approx(4.0, rel=0.1)
    assert not found.nees.inside
    assert not found.coverage.inside


def test_the_page_says_of_an_erring_reference_what_the_table_says() -> None:
    rng, t = np.random.default_rng(2), np.arange(400.0)
    grade = rng.normal(0.0, 0.01, len(t))
    estimates = Estimates(t, {"grade": grade}, {"grade": np.full(len(t), 0.006)}, np.zeros(len(t), np.int8))
    log = Log(t, {"ref_grade": np.zeros(len(t))}, {"reference_std": {"ref_grade": 0.008}})
    found, row = error_consistency(estimates, log, "grade"), evaluate(estimates, log)["grade"]
    assert found is not None
    assert found.nees.value == pytest.approx(np.mean((grade / 0.01) ** 2))
    assert found.nees.value == pytest.approx(row.nees)
    assert found.coverage.value == pytest.approx(row.coverage95)


def test_a_constant_error_has_no_band() -> None:
    found = error_consistency(*with_errors(np.full(3000, 0.005)), "grade")
    assert found is not None
    assert found.nees.value == pytest.approx(0.25)
    assert np.isnan(found.nees.low)


def test_without_reference_or_sigma_there_is_nothing_to_test() -> None:
    estimates, log = with_errors(np.zeros(10))
    assert error_consistency(estimates, Log(log.time, {}), "grade") is None
    bare = Estimates(estimates.time, estimates.values, {}, estimates.validity)
    assert error_consistency(bare, log, "grade") is None


def test_without_innovations_there_is_nothing_to_say() -> None:
    bare = Estimates(np.arange(3.0), {}, {}, np.zeros(3, np.int8))
    assert sensor_consistency(bare) == []
    assert nis_consistency(bare) is None
