"""Do the innovations, and where there is a reference the errors, agree with what the filter claims?

The tests are those of :mod:`roadstate.consistency`; here they meet real samples, which are not independent.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roadstate.consistency import (
    BandTest,
    Whiteness,
    chi2_quantile,
    coverage_test,
    nees_test,
    nis_test,
    whiteness,
)
from roadstate.core import Estimates, Log
from roadstate.core import reference as reference_of
from roadstate.metrics import error_std

Array = NDArray[np.float64]

EXPECTED_BEYOND = math.erfc(2.0 / math.sqrt(2.0))
"""Share of a normal distribution outside ±2σ: 4.55 %."""

LAGS = 20
"""Lags of the autocorrelation, in the sensor's own samples."""

_INDEPENDENT = 0.15  # correlation under which samples are taken as independent
_FEWEST = 20  # independent samples without which no band is given


@dataclass(frozen=True)
class SensorConsistency:
    """One sensor's normalised innovation ν/σ_ν.

    Attributes:
        sensor: its name in the filter.
        n: samples.
        mean: mean of ν/σ_ν, 0 expected.
        rms: root mean square of ν/σ_ν, 1 expected.
        beyond: share with |ν| > 2 σ_ν, 0.0455 expected.
        autocorrelation: over :data:`LAGS` of its own samples, where there are enough of them.
    """

    sensor: str
    n: int
    mean: float
    rms: float
    beyond: float
    autocorrelation: Whiteness | None


@dataclass(frozen=True)
class NisConsistency:
    """Normalised innovation squared νᵀ S⁻¹ ν over a log.

    Attributes:
        n: samples that have one.
        mean: over the number of sensors with a sample, with the band for independent innovations; 1 expected
            (a sample that a gate refused counts here although the filter leaves it out of the NIS).
        beyond: share above the 95 % quantile of χ² with as many degrees of freedom; 0.05 expected.
    """

    n: int
    mean: BandTest
    beyond: float


@dataclass(frozen=True)
class ErrorConsistency:
    """Error of a quantity over its σ, against a reference.

    Attributes:
        quantity: its name.
        n: samples compared.
        independent: of them, taken evenly so far apart that they hardly correlate; the bands' sample size.
        nees: mean (e/σ)² of all samples, 1 expected; no band where too few are independent.
        coverage: share of all samples within ±1.96σ, 0.95 expected; likewise.
    """

    quantity: str
    n: int
    independent: int
    nees: BandTest
    coverage: BandTest


def sensor_consistency(estimates: Estimates) -> list[SensorConsistency]:
    """Size and whiteness, sensor by sensor; those without a sample are left out."""
    rows = []
    for i, sensor in enumerate(estimates.sensors):
        ratio = estimates.innovation[:, i] / estimates.innovation_std[:, i]
        ratio = ratio[np.isfinite(ratio)]
        if len(ratio):
            rows.append(
                SensorConsistency(
                    sensor,
                    len(ratio),
                    float(np.mean(ratio)),
                    math.sqrt(np.mean(ratio**2)),
                    float(np.mean(np.abs(ratio) > 2.0)),
                    whiteness(ratio, np.ones_like(ratio), lags=LAGS) if len(ratio) > 2 * LAGS else None,
                )
            )
    return rows


def sensors_used(estimates: Estimates) -> NDArray[np.int64]:
    """(T,) number of sensors with a sample, at each instant."""
    count: NDArray[np.int64] = np.sum(np.isfinite(estimates.innovation), axis=1, dtype=np.int64)
    return count


def nis_consistency(estimates: Estimates) -> NisConsistency | None:
    """The NIS against χ², over the samples that have one; ``None`` without any."""
    if len(estimates.nis) == 0 or len(estimates.innovation) == 0:
        return None
    count = sensors_used(estimates)
    counted = np.isfinite(estimates.nis) & (count > 0)
    if not counted.any():
        return None
    nis, count = estimates.nis[counted], count[counted]
    limits = chi2_quantile(0.95, np.arange(1, int(count.max()) + 1))
    return NisConsistency(len(nis), nis_test(nis, count), float(np.mean(nis > limits[count - 1])))


def error_consistency(estimates: Estimates, log: Log, quantity: str) -> ErrorConsistency | None:
    """NEES and coverage of one quantity; ``None`` where the log has no reference or the estimate no σ.

    Errors of a filter are correlated in time even where all is as promised, so the bands are those of every
    k-th sample, k the first power of two at which their correlation is
    under 0.15, or not to be told from none.

    Args:
        estimates: (T,) on the log's time base.
        log: may hold the reference.
        quantity: of the estimates.
    """
    reference = reference_of(quantity, log.channels)
    if reference is None or quantity not in estimates.std:
        return None
    error, std = estimates.values[quantity] - reference, error_std(estimates, log, quantity)
    there = np.isfinite(error) & np.isfinite(std) & (std > 0)
    if not there.any():
        return None
    error, std = error[there], std[there]
    ratio = error / std
    few = _independent(ratio)
    nees, coverage = np.asarray(np.mean(ratio**2)), coverage_test(error, std).value
    if len(few) < _FEWEST:
        nothing = np.asarray(np.nan)
        nees_band, coverage_band = BandTest(nees, nothing, nothing), BandTest(coverage, nothing, nothing)
    else:
        nees_band = nees_test(few**2, 1)._replace(value=nees)
        coverage_band = coverage_test(few, np.ones_like(few))._replace(value=coverage)
    return ErrorConsistency(quantity, len(ratio), len(few), nees_band, coverage_band)


def errors_consistency(results: Mapping[str, Estimates], log: Log) -> list[tuple[str, ErrorConsistency]]:
    """Estimator and :class:`ErrorConsistency` of everything that has a reference."""
    return [
        (name, found)
        for name, estimates in results.items()
        for quantity in estimates.values
        if (found := error_consistency(estimates, log, quantity)) is not None
    ]


def windowed_ratio(time: Array, estimates: Estimates, window: float) -> tuple[Array, Array]:
    """Sum of the NIS over sum of the sensors used, in windows of ``window`` s: 1 where consistent.

    Returns:
        The windows' centres in s and their ratios, NaN where a window has no NIS.
    """
    count = sensors_used(estimates)
    counted = np.isfinite(estimates.nis) & (count > 0)
    slot = ((time - time[0]) / window).astype(np.intp)
    slots = int(slot[-1]) + 1
    nis = np.bincount(slot[counted], estimates.nis[counted], slots)
    expected = np.bincount(slot[counted], count[counted], slots)
    center = time[0] + (np.arange(slots) + 0.5) * window
    return center, np.divide(nis, expected, out=np.full(slots, np.nan), where=expected > 0)


def _independent(ratio: Array) -> Array:
    """Every k-th value, so that neighbours hardly correlate; a constant offset correlates at any distance."""
    while len(ratio) >= _FEWEST:
        near = whiteness(ratio, np.ones_like(ratio), lags=1)
        if abs(near.correlation[0, 0]) < max(_INDEPENDENT, near.bound[0, 0]):
            break
        ratio = ratio[::2]
    return ratio
