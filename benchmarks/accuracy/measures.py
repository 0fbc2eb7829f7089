"""What is measured of one run: plain functions of estimates and the log they were made from."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from roadstate.core import WHEELS, Estimates, Log, reference
from roadstate.metrics import NORMAL_95, presented

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

AXLES: Mapping[str, tuple[str, ...]] = {"front": WHEELS[:2], "rear": WHEELS[2:], "car": WHEELS}
"""Groups of wheels whose friction is measured."""
CLASSES: Mapping[str, tuple[float, float]] = {
    "≥ 0.7": (0.7, np.inf),
    "0.4–0.7": (0.4, 0.7),
    "< 0.4": (0.0, 0.4),
}
"""Classes of the share of the friction that is used: from, below."""
_STAYS = 0.1  # s for which a change must last to count


def peak_of(group: str) -> str:
    """The quantity that gives the peak friction of a group of :data:`AXLES`."""
    return "friction_peak" if group == "car" else f"friction_peak_{group}"


def share_used(log: Log, group: str) -> Array:
    """(T,) share of the friction that a group of wheels uses: |ΣF| / ΣF_z over its mean peak friction.

    Args:
        log: with the truth.
        group: of :data:`AXLES`.
    """
    along, across, load = (
        np.sum([log[f"ref_{kind}_{w}"] for w in AXLES[group]], axis=0)
        for kind in ("force_x", "force_y", "load")
    )
    peak = np.mean([log[f"ref_friction_{w}"] for w in AXLES[group]], axis=0)
    share: Array = np.hypot(along, across) / np.maximum(load, 1.0) / peak
    return share


def in_class(share: Array, name: str) -> Mask:
    """(T,) the samples of a class of :data:`CLASSES`."""
    low, high = CLASSES[name]
    mask: Mask = (share >= low) & (share < high)
    return mask


def after_excitation(share: Array, time: Array, *, least: float = 0.7, seconds: float = 0.5) -> Mask:
    """(T,) samples that use at least a share, once that has been so for some seconds in all.

    Args:
        share: (T,) of the friction.
        time: (T,) s.
        least: share.
        seconds: of excitation before the sample, not necessarily in one go.
    """
    excited = share >= least
    had = np.cumsum(np.where(excited, np.diff(time, prepend=time[0]), 0.0))
    return np.asarray(excited & (had >= seconds - 1e-9))


def relative_error(estimates: Estimates, log: Log, quantity: str) -> Array | None:
    """(T,) |error| over the truth, %; ``None`` without such an estimate or its truth."""
    truth = reference(quantity, log.channels)
    if truth is None or quantity not in estimates.values:
        return None
    error: Array = 100 * np.abs(estimates.values[quantity] / truth - 1)
    return error


def rmse(estimates: Estimates, log: Log, quantity: str, *, settle: float = 0.0) -> float:
    """Root of the mean squared error, grade in per cent of slope; NaN without estimates or where they are.

    Args:
        estimates, log: of one run.
        quantity: which.
        settle: s of the log's start that do not count.
    """
    truth = reference(quantity, log.channels)
    if truth is None or quantity not in estimates.values:
        return float("nan")
    used = log.time - log.time[0] >= settle
    error = presented(quantity, estimates.values[quantity]) - presented(quantity, truth)
    return float(np.sqrt(np.mean(error[used] ** 2)))


def rmse_of_peak(estimates: Estimates, log: Log, quantity: str) -> float:
    """RMSE over the largest size of the truth, %."""
    return share_of_peak(rmse(estimates, log, quantity), log, quantity)


def share_of_peak(value: float, log: Log, quantity: str) -> float:
    """A value over the largest size of a quantity's truth, %; NaN without that truth."""
    truth = reference(quantity, log.channels)
    return float("nan") if truth is None else 100 * value / float(np.max(np.abs(truth)))


def interval(estimates: Estimates, quantity: str) -> tuple[Array, Array] | None:
    """(T,) ends of what an estimate states: its own bounds, or ±1.96 σ; ``None`` without either.

    Args:
        estimates: of one run.
        quantity: one that they give.
    """
    values = estimates.values
    if f"{quantity}_lower" in values and f"{quantity}_upper" in values:
        return values[f"{quantity}_lower"], values[f"{quantity}_upper"]
    if quantity not in estimates.std:
        return None
    reach = NORMAL_95 * estimates.std[quantity]
    return values[quantity] - reach, values[quantity] + reach


def covered(estimates: Estimates, log: Log, quantity: str, *, settle: float = 0.0) -> tuple[int, int] | None:
    """Samples whose interval holds the truth, and all samples; ``None`` where there is no truth or interval.

    A quantity with bounds (5 % and 95 %) is judged by these, 90 % of them ideally inside; others by ±1.96 σ,
    95 % ideally inside. Samples without a finite estimate count as missed.

    Args:
        estimates, log: of one run.
        quantity: which.
        settle: s of the log's start that do not count.
    """
    truth = reference(quantity, log.channels)
    ends = interval(estimates, quantity) if quantity in estimates.values else None
    if truth is None or ends is None:
        return None
    inside = (ends[0] <= truth) & (truth <= ends[1])
    used = np.isfinite(truth) & (log.time - log.time[0] >= settle)
    return int(np.sum(inside & used)), int(np.sum(used))


def inside(estimates: Estimates, log: Log, quantity: str, *, settle: float = 0.0) -> float:
    """Share in % of the samples that :func:`covered` counts; NaN where there are none."""
    held, total = covered(estimates, log, quantity, settle=settle) or (0, 0)
    return 100 * held / total if total else float("nan")


def averaged(rows: list[dict[str, float]]) -> dict[str, float]:
    """Each key's mean over rows that have the same keys."""
    return {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}


def crossing(log: Log) -> int | None:
    """The sample at which the front axle is half (in the logarithm) on the second surface of a joint road."""
    truth = reference("friction_peak_front", log.channels)
    if truth is None:
        return None
    half = 0.5 * (np.log(truth[0]) + np.log(truth[-1]))
    crossed = (np.log(truth) - half) * np.sign(np.log(truth[-1] / truth[0])) >= 0
    return int(np.argmax(crossed)) if truth[0] != truth[-1] else None


def half_way_time(estimates: Estimates, log: Log, quantity: str) -> float:
    """s from the front axle's crossing until a friction has gone half the way to the new one, and stays.

    Half the way is in the logarithm, from the old truth to the new; it must stay for 0.1 s. NaN where it
    never does, or where the estimate is on the new surface's side already when the axle crosses: it cannot
    have noticed what it had not known before.

    Args:
        estimates, log: of one run over a joint road.
        quantity: a peak friction.
    """
    at, truth = crossing(log), reference("friction_peak_front", log.channels)
    if at is None or truth is None or quantity not in estimates.values:
        return float("nan")
    with np.errstate(invalid="ignore", divide="ignore"):
        level = np.log(estimates.values[quantity] / np.sqrt(truth[0] * truth[-1]))
    beyond = level * np.sign(np.log(truth[-1] / truth[0])) >= 0
    if beyond[at]:
        return float("nan")
    before = np.append(log.time[~beyond], np.inf)
    for k in np.flatnonzero(beyond[at:]) + at:
        if log.time[k] + _STAYS > log.time[-1]:
            break
        if before[np.searchsorted(before, log.time[k])] > log.time[k] + _STAYS - 1e-9:
            return float(log.time[k] - log.time[at])
    return float("nan")
