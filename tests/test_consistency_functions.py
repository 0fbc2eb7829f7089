"""Tests of consistency against SciPy's distributions, by hand, and by how often they raise a false alarm."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from roadstate.consistency import (
    chi2_quantile,
    coverage_test,
    nees,
    nees_test,
    nis,
    nis_test,
    normal_quantile,
    whiteness,
)

NAN = np.nan


def random_factor(seed: int, n: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(n, n)) + 2 * np.eye(n)


@pytest.mark.parametrize("rows", [None, [1], [3, 0], [2, 1, 0, 3]])
def test_nees_is_the_quadratic_form(rows: list[int] | None) -> None:
    """With any factor, triangular or not, of any sign."""
    random = np.random.default_rng(0)
    S, e = np.stack([random_factor(k, 4) for k in range(6)]), random.normal(size=(6, 4))
    chosen = rows or [0, 1, 2, 3]
    P = (S @ S.transpose(0, 2, 1))[:, chosen][:, :, chosen]
    expected = np.einsum("ti,tij,tj->t", e[:, chosen], np.linalg.inv(P), e[:, chosen])
    np.testing.assert_allclose(nees(e, S, rows), expected, rtol=1e-9)
    lower = np.linalg.cholesky(S @ S.transpose(0, 2, 1))
    np.testing.assert_allclose(nees(e, lower, rows), expected, rtol=1e-9)


def test_nees_where_there_is_no_uncertainty() -> None:
    S = np.diag([2.0, 0.0])
    assert nees([4.0, 0.0], S) == 4.0
    assert nees([4.0, 0.1], S) == np.inf


def test_nis_counts_the_sensors_that_are_there() -> None:
    S = np.stack([random_factor(k, 3) @ random_factor(k, 3).T for k in range(4)])
    v = np.array([[1.0, -2.0, 0.5], [1.0, NAN, 0.5], [NAN, NAN, 3.0], [NAN, NAN, NAN]])
    values, dof = nis(v, S)
    assert dof.tolist() == [3, 2, 1, 0]
    for k, there in enumerate(np.isfinite(v)):
        expected = (
            v[k, there] @ np.linalg.solve(S[k][np.ix_(there, there)], v[k, there]) if there.any() else 0
        )
        assert values[k] == pytest.approx(expected, rel=1e-10)


def test_bands_are_those_of_chi_squared() -> None:
    runs = np.full((50, 7), 3.1)
    test = nees_test(runs, 3)
    low, high = stats.chi2.ppf([0.025, 0.975], 150) / 150
    np.testing.assert_allclose(test.value, 3.1 / 3)
    np.testing.assert_allclose(test.low, low, rtol=1e-10)
    np.testing.assert_allclose(test.high, high, rtol=1e-10)
    assert test.value.shape == (7,)
    assert test.inside.all()
    wide = nees_test(runs[:, 0], 3, confidence=0.999)
    np.testing.assert_allclose([wide.low, wide.high], stats.chi2.ppf([0.0005, 0.9995], 150) / 150, rtol=1e-9)


def test_nis_band_leaves_out_what_is_missing() -> None:
    values, dof = np.array([2.0, 0.0, 5.0, NAN]), np.array([2, 0, 3, 2])
    test = nis_test(values, dof)
    assert test.value == pytest.approx(7 / 5)
    np.testing.assert_allclose([test.low, test.high], stats.chi2.ppf([0.025, 0.975], 5) / 5, rtol=1e-9)
    with pytest.raises(ValueError, match="no sample"):
        nis_test(np.zeros(3), 0)


def test_coverage_band_is_the_binomials() -> None:
    """Its normal approximation, within 2 of the 1000 trials at either end."""
    error = np.where(np.arange(1000) < 40, 5.0, 0.5)
    error[-1] = NAN
    test = coverage_test(error, np.ones(1000))
    assert test.value == pytest.approx(959 / 999)
    exact = stats.binom.ppf([0.025, 0.975], 999, 0.95) / 999
    assert np.abs(np.array([test.low, test.high]) - exact).max() < 0.003
    half = coverage_test(np.array([0.67, 0.68]), 1.0, level=0.5)
    assert half.value == 0.5  # the quartile lies at 0.6745 σ


@given(
    st.floats(1e-12, 1 - 1e-12),
    st.one_of(st.floats(0.05, 50), st.integers(1, 10**6).map(float)),
)
def test_chi_squared_quantiles(probability: float, dof: float) -> None:
    expected = stats.chi2.ppf(probability, dof)
    assert chi2_quantile(probability, dof) == pytest.approx(expected, rel=1e-8, abs=1e-290)


def test_quantiles_at_the_ends_and_out_of_range() -> None:
    assert chi2_quantile(0.0, 3) == 0
    np.testing.assert_allclose(chi2_quantile([0.1, 0.9], [[1], [8]]), stats.chi2.ppf([0.1, 0.9], [[1], [8]]))
    np.testing.assert_allclose(
        normal_quantile([0.025, 0.5, 0.9999]), stats.norm.ppf([0.025, 0.5, 0.9999]), atol=1e-12
    )
    for probability, dof in ((1.0, 3), (-0.1, 3), (NAN, 3), (0.5, 0), (0.5, np.inf), (0.5, NAN)):
        with pytest.raises(ValueError, match=r"probability lies|degrees of freedom"):
            chi2_quantile(probability, dof)


class TestWhiteness:
    def test_correlations_by_hand(self) -> None:
        result = whiteness(np.array([2.0, 4.0, NAN, 6.0, 2.0, 4.0]), np.full(6, 2.0), lags=2)
        # the pairs one apart of 1 2 – 3 1 2, and those two apart
        first = (1 * 2 + 3 * 1 + 1 * 2) / np.sqrt((1 + 9 + 1) * (4 + 1 + 4))
        second = (2 * 3 + 3 * 2) / np.sqrt((4 + 9) * (9 + 4))
        np.testing.assert_allclose(result.correlation[:, 0], [first, second], rtol=1e-12)
        np.testing.assert_allclose(result.bound[:, 0], stats.norm.ppf(0.975) / np.sqrt([3, 2]), rtol=1e-9)
        np.testing.assert_allclose(result.portmanteau, 3 * first**2 + 2 * second**2, rtol=1e-12)
        assert result.limit == pytest.approx(stats.chi2.ppf(0.95, 2))

    def test_coloured_ones_are_found_out(self) -> None:
        """x⁺ = 0.5 x + w has correlation 0.5ˡ; a moving average of two, 0.5 at the first lag alone."""
        random = np.random.default_rng(1)
        w = random.normal(size=(20_001, 2))
        coloured = np.zeros((20_000, 2))
        for k in range(1, 20_000):
            coloured[k, 0] = 0.5 * coloured[k - 1, 0] + w[k, 0]
        coloured[:, 1] = w[1:, 1] + w[:-1, 1]
        result = whiteness(coloured, np.ones_like(coloured), lags=5)
        np.testing.assert_allclose(result.correlation[:, 0], 0.5 ** np.arange(1, 6), atol=0.025)
        np.testing.assert_allclose(result.correlation[:, 1], [0.5, 0, 0, 0, 0], atol=0.025)
        assert (result.portmanteau > 100 * result.limit).all()
        assert result.share_outside[0] >= 0.8
        assert result.share_outside[1] >= 0.2

    def test_lags_must_fit(self) -> None:
        for lags in (0, 10, -1):
            with pytest.raises(ValueError, match="lags must lie between 1 and the number of samples, 10"):
                whiteness(np.zeros(10), np.ones(10), lags=lags)


class TestFalseAlarms:
    """Over many draws that are as promised, each test speaks up in the 5 % of cases that it should."""

    TRIALS = 2000

    def share(self, outside: np.ndarray) -> None:
        spread = np.sqrt(0.05 * 0.95 / len(outside))
        assert abs(np.mean(outside) - 0.05) < 4 * spread

    def test_nees(self) -> None:
        random = np.random.default_rng(0)
        S = random_factor(1, 3)
        errors = random.normal(size=(25, self.TRIALS, 3)) @ S.T
        self.share(~nees_test(nees(errors, np.broadcast_to(S, (25, self.TRIALS, 3, 3))), 3).inside)

    def test_nis_with_gaps(self) -> None:
        random = np.random.default_rng(1)
        L = random_factor(2, 2)
        outside = []
        for _ in range(self.TRIALS):
            v = random.normal(size=(30, 2)) @ L.T
            v[random.random(v.shape) < 0.3] = NAN
            outside.append(not nis_test(*nis(v, np.broadcast_to(L @ L.T, (30, 2, 2)))).inside)
        self.share(np.array(outside))

    def test_coverage(self) -> None:
        errors = np.random.default_rng(2).normal(size=(2000, self.TRIALS)) * 3
        inside = coverage_test(errors, np.full(errors.shape, 3.0)).inside
        # a share of 2000 is a multiple of 1/2000, so the probability is near 5 %, not 5 %
        assert abs(np.mean(~inside) - 0.05) < 4 * np.sqrt(0.05 * 0.95 / self.TRIALS) + 0.005

    def test_whiteness(self) -> None:
        white = np.random.default_rng(3).normal(size=(400, self.TRIALS))
        result = whiteness(white, np.ones_like(white), lags=10)
        assert abs(np.mean(result.share_outside) - 0.05) < 0.005
        # Box and Pierce's statistic is a little too small in finite samples
        assert 0.03 < np.mean(result.portmanteau > result.limit) < 0.06
