"""Innovation statistics against scipy and against hand calculations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from roadstate.core import Estimates
from roadstate.report.consistency import (
    EXPECTED_BEYOND,
    chi2_quantile,
    nis_consistency,
    sensor_consistency,
    windowed_ratio,
)


@pytest.mark.parametrize("dof", [1, 2, 3, 4, 7, 12])
@pytest.mark.parametrize("probability", [0.025, 0.5, 0.95, 0.999])
def test_quantile_is_scipys(probability: float, dof: int) -> None:
    assert chi2_quantile(probability, dof) == pytest.approx(stats.chi2.ppf(probability, dof), rel=1e-9)


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
    assert found.mean == pytest.approx(4.0)
    assert found.expected == pytest.approx(5 / 3)  # 2, 1 and 2 sensors
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


def test_without_innovations_there_is_nothing_to_say() -> None:
    bare = Estimates(np.arange(3.0), {}, {}, np.zeros(3, np.int8))
    assert sensor_consistency(bare) == []
    assert nis_consistency(bare) is None
