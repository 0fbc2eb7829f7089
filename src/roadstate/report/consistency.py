"""Do the innovations agree with the covariance the filter claims for them?"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roadstate.core import Estimates

Array = NDArray[np.float64]

EXPECTED_BEYOND = math.erfc(2.0 / math.sqrt(2.0))
"""Share of a normal distribution outside ±2σ: 4.55 %."""


@dataclass(frozen=True)
class SensorConsistency:
    """One sensor's normalised innovation ν/σ_ν.

    Attributes:
        sensor: its name in the filter.
        n: samples.
        mean: mean of ν/σ_ν, 0 expected.
        rms: root mean square of ν/σ_ν, 1 expected.
        beyond: share with |ν| > 2 σ_ν, 0.0455 expected.
    """

    sensor: str
    n: int
    mean: float
    rms: float
    beyond: float


@dataclass(frozen=True)
class NisConsistency:
    """Normalised innovation squared νᵀ S⁻¹ ν over a log.

    Attributes:
        n: samples that have one.
        mean: its mean.
        expected: mean number of sensors with a sample, the mean it should have (a sample that a gate
            refused counts here although the filter leaves it out of the NIS).
        beyond: share above the 95 % quantile of χ² with as many degrees of freedom; 0.05 expected.
    """

    n: int
    mean: float
    expected: float
    beyond: float


def sensor_consistency(estimates: Estimates) -> list[SensorConsistency]:
    """Whiteness in size, sensor by sensor; those without a sample are left out."""
    rows = []
    for i, sensor in enumerate(estimates.sensors):
        ratio = estimates.innovation[:, i] / estimates.innovation_std[:, i]
        ratio = ratio[np.isfinite(ratio)]
        if len(ratio):
            mean, rms = float(np.mean(ratio)), math.sqrt(np.mean(ratio**2))
            beyond = float(np.mean(np.abs(ratio) > 2.0))
            rows.append(SensorConsistency(sensor, len(ratio), mean, rms, beyond))
    return rows


def sensors_used(estimates: Estimates) -> NDArray[np.int64]:
    """(T,) number of sensors with a sample, at each instant."""
    count: NDArray[np.int64] = np.sum(np.isfinite(estimates.innovation), axis=1, dtype=np.int64)
    return count


def nis_consistency(estimates: Estimates) -> NisConsistency | None:
    """The NIS against χ² (Bar-Shalom, Li & Kirubarajan, *Estimation with Applications*, 2001, 5.4)."""
    if len(estimates.nis) == 0 or len(estimates.innovation) == 0:
        return None
    count = sensors_used(estimates)
    counted = np.isfinite(estimates.nis) & (count > 0)
    if not counted.any():
        return None
    nis, count = estimates.nis[counted], count[counted]
    limits = np.zeros(int(count.max()) + 1)
    for dof in np.unique(count):
        limits[dof] = chi2_quantile(0.95, int(dof))
    return NisConsistency(
        len(nis), float(np.mean(nis)), float(np.mean(count)), float(np.mean(nis > limits[count]))
    )


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


def chi2_quantile(probability: float, dof: int) -> float:
    """Quantile of χ² with ``dof`` degrees of freedom, by bisection on its exact distribution function.

    The survival function follows Q(x; k) = Q(x; k−2) + (x/2)^(k/2−1) e^(−x/2) / Γ(k/2) (Abramowitz & Stegun,
    26.4.8), from Q(x; 1) = erfc √(x/2) and Q(x; 2) = e^(−x/2).
    """
    low, high = 0.0, 20.0 * dof + 100.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _survival(middle, dof) < 1.0 - probability else (middle, high)
    return 0.5 * (low + high)


def _survival(x: float, dof: int) -> float:
    half = 0.5 * x
    q = math.erfc(math.sqrt(half)) if dof % 2 else math.exp(-half)
    for k in range(3 if dof % 2 else 4, dof + 1, 2):
        q += half ** (k / 2 - 1) * math.exp(-half) / math.gamma(k / 2)
    return q
