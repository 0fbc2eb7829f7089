"""How far estimates are from the reference channels of a log, and whether their uncertainty is honest."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roadstate.core import QUANTITIES, REFERENCES, Estimates, InputError, Log, reference

Array = NDArray[np.float64]

NORMAL_95 = 1.959964
"""Two-sided 95 % of a normal distribution, in σ."""
_MAD_TO_STD = 1.4826  # makes the median absolute deviation of a normal distribution its σ
_SETTLED_FOR = 1.0  # s


@dataclass(frozen=True)
class Metrics:
    """Errors e = estimate − reference of one quantity, and how they compare with the stated σ.

    Attributes:
        unit: unit of the errors: ``%`` (rise over run) for grade, the quantity's SI unit otherwise.
        mae: mean |e|.
        rmse: √(mean e²).
        max: largest |e|.
        bias: mean e.
        mae_bias_removed: mean |e − bias|.
        correlation: Pearson's r of estimate and reference; ``None`` where one of them is constant.
        settle_s: see :func:`settle_time`; ``None`` where the error never settles.
        nees: mean (e/σ)², about 1 for an honest σ (Bar-Shalom, Li & Kirubarajan, *Estimation with
            Applications to Tracking and Navigation*, 2001, section 5.4); ``None`` without σ.
        coverage95: share of samples with |e| ≤ 1.959964 σ, about 0.95 for an honest σ.
        n: samples compared.
    """

    unit: str
    mae: float
    rmse: float
    max: float
    bias: float
    mae_bias_removed: float
    correlation: float | None
    settle_s: float | None
    nees: float | None
    coverage95: float | None
    n: int

    def to_json(self) -> dict[str, Any]:
        """The same as a dictionary of numbers, texts and ``None``; never NaN or infinity."""
        return {
            k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in asdict(self).items()
        }


def evaluate(estimates: Estimates, log: Log, *, settle: float = 0.0) -> dict[str, Metrics]:
    """Compare each quantity that has a reference in the log, over the samples where both are finite.

    Grade is compared as slope in per cent, 100·(tan θ̂ − tan θ); NEES and coverage use the angle and its σ. A
    reference that is derived errs itself: where the log's metadata says by how much (``reference_std``), e is
    held against √(σ² + σ_ref²).

    Args:
        estimates: (T,) on the log's own time base.
        log: holds the references (``ref_grade`` …).
        settle: s; samples earlier than this after the log's first one count for nothing but ``settle_s``.

    Returns:
        Quantity → :class:`Metrics`; empty where the log has no reference for any quantity.

    Raises:
        InputError: another time base, a negative ``settle``, or one that leaves no sample to compare.
    """
    check_time(estimates, log)
    if not (math.isfinite(settle) and settle >= 0):
        raise InputError(f"settle must be 0 s or more, got {settle:g}")
    elapsed = log.time - log.time[0]
    found: dict[str, Metrics] = {}
    for quantity, values in estimates.values.items():
        truth = reference(quantity, log.channels)
        if truth is None:
            continue
        both = np.isfinite(values) & np.isfinite(truth)
        if not both.any():
            continue
        used = both & (elapsed >= settle)
        if not used.any():
            raise InputError(
                f"no sample of {quantity} is left to compare after {settle:g} s",
                where=", ".join(REFERENCES[quantity].channels),
                mend=f"use a shorter settle; the last one lies at {elapsed[both][-1]:.6g} s",
            )
        std = error_std(estimates, log, quantity)
        settled = settle_time(
            elapsed[both], presented(quantity, values[both]) - presented(quantity, truth[both])
        )
        found[quantity] = _metrics(quantity, values[used], truth[used], std[used], settled)
    return found


def error_std(estimates: Estimates, log: Log, quantity: str) -> Array:
    """(T,) 1σ of estimate − reference, √(σ² + σ_ref²), in the quantity's SI unit; NaN without σ.

    Args:
        estimates: (T,).
        log: as of :func:`reference_std`.
        quantity: one that has a reference.

    Raises:
        InputError: as :func:`reference_std`.
    """
    own = reference_std(log, REFERENCES[quantity].channels)
    std = estimates.std.get(quantity, np.full_like(estimates.values[quantity], np.nan))
    return np.hypot(std, own)


def reference_std(log: Log, channels: Iterable[str]) -> float:
    """1σ of a reference's own error, in its SI unit, as the log's metadata tells; 0 where it does not.

    Args:
        log: its metadata may map channels to 1σ under ``reference_std``, as
            :meth:`roadstate.io.Mapping.apply` does for a grade derived from an altitude.
        channels: the reference is made of; only of a single one it is told.

    Raises:
        InputError: what is told is no standard deviation.
    """
    told = log.metadata.get("reference_std", {})
    names = [name for name in channels if isinstance(told, dict) and name in told]
    if len(names) != 1:
        return 0.0
    value = told[names[0]]
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < math.inf:
        raise InputError(
            f"metadata 'reference_std' gives {value!r}, which is no standard deviation",
            where=names[0],
            mend="give a number of 0 or more, or leave it out",
        )
    return float(value)


def presented(quantity: str, values: Array) -> Array:
    """Values of a quantity as people read them: grade in per cent (100·tan θ), others in SI."""
    return 100.0 * np.tan(values) if quantity == "grade" else values


def presented_unit(quantity: str) -> str:
    """The unit that goes with :func:`presented`."""
    return "%" if quantity == "grade" else QUANTITIES[quantity].unit


def check_time(estimates: Estimates, log: Log) -> None:
    """Refuse estimates that were not made on this log's time base.

    Raises:
        InputError: the two time bases differ.
    """
    if not np.array_equal(estimates.time, log.time):
        raise InputError(
            f"the estimates ({len(estimates)} samples) and the log ({len(log)} samples) differ in time",
            mend="compare estimates with the log they were made from",
        )


def settle_time(elapsed: Array, error: Array) -> float | None:
    """When the error has come to rest, judged by its own noise at the end.

    The second half of the log, by time, gives the level at rest: m = median e and
    s = 1.4826·median |e − m|. The error has settled at the first sample from which
    |e| ≤ |m| + 3 s holds for all samples of one second, up to and including the first sample at or after
    that second's end. A constant offset thus counts as settled: it is what ``bias`` tells.

    Args:
        elapsed: (T,) s since the log's first sample, increasing.
        error: (T,) finite.

    Returns:
        Seconds since the log's first sample; ``None`` where no second qualifies.
    """
    late = error[elapsed >= 0.5 * (elapsed[0] + elapsed[-1])]
    center = float(np.median(late))
    spread = _MAD_TO_STD * float(np.median(np.abs(late - center)))
    bound = (abs(center) + 3.0 * spread) * (1.0 + 1e-9)
    n = len(elapsed)
    outside = np.flatnonzero(np.abs(error) > bound)
    # a calm stretch is longest from its beginning: the first sample, or the one after an outside one
    first = np.concatenate([[0], outside + 1])
    until = np.concatenate([outside, [n]])
    first, until = first[first < n], until[first < n]
    second_ends = np.searchsorted(elapsed, elapsed[first] + _SETTLED_FOR - 1e-9)
    settled = second_ends < until
    return float(elapsed[first[np.argmax(settled)]]) if settled.any() else None


def _metrics(quantity: str, values: Array, reference: Array, std: Array, settled: float | None) -> Metrics:
    shown, truth = presented(quantity, values), presented(quantity, reference)
    error = shown - truth
    bias = float(np.mean(error))
    stated = np.isfinite(std) & (std > 0)
    ratio = (values - reference)[stated] / std[stated]
    return Metrics(
        unit=presented_unit(quantity),
        mae=float(np.mean(np.abs(error))),
        rmse=float(np.sqrt(np.mean(error**2))),
        max=float(np.max(np.abs(error))),
        bias=bias,
        mae_bias_removed=float(np.mean(np.abs(error - bias))),
        correlation=_correlation(shown, truth),
        settle_s=settled,
        nees=float(np.mean(ratio**2)) if len(ratio) else None,
        coverage95=float(np.mean(np.abs(ratio) <= NORMAL_95)) if len(ratio) else None,
        n=len(error),
    )


def _correlation(a: Array, b: Array) -> float | None:
    if np.ptp(a) == 0 or np.ptp(b) == 0:
        return None
    a, b = a - np.mean(a), b - np.mean(b)
    return float(np.clip(a @ b / math.sqrt(float(a @ a) * float(b @ b)), -1.0, 1.0))
