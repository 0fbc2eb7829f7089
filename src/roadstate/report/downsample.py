"""Thin out long series for drawing without losing a peak or hiding a gap."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from roadstate.core import Validity

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_GAP = 3.0
"""Samples further apart than this many median steps are not joined (a lone late or lost one still is)."""

_SAMPLED = 20_000
_RANDOM_ORDER = np.random.default_rng(0).integers(0, 2**62, _SAMPLED)

SEVERITY = (
    Validity.EXCITED,
    Validity.LOW_EXCITATION,
    Validity.STANDSTILL,
    Validity.GEAR_SHIFT,
    Validity.BRAKING,
    Validity.SENSOR_FAULT,
    Validity.SENSOR_MISSING,
    Validity.DIVERGED,
)
"""Which validity is shown where several fall on one stretch of the strip: the last of them here."""


@dataclass(frozen=True)
class Selection:
    """Samples chosen to stand for a series.

    Attributes:
        index: (K,) non-decreasing sample numbers; a break repeats the one before it.
        is_break: (K,) where the pen is lifted.
        lone: (L,) sample numbers with a break on both sides, which a line alone would not show.
    """

    index: Index
    is_break: NDArray[np.bool_]
    lone: Index

    def take(self, values: Array) -> Array:
        """(K,) the chosen values, NaN at breaks."""
        return np.where(self.is_break, np.nan, values[self.index])


def select(time: Array, values: Array, points: int) -> Selection:
    """Choose the minimum and maximum of every bin, both ends, and both sides of every gap.

    A gap is a stretch without finite values longer than 3 median steps of the finite ones, so a slow sensor
    in a fast log is one line. Where there are more than ``points / 8`` gaps the longest are kept.

    Args:
        time: (T,) s, increasing.
        values: (T,) any unit, NaN where missing.
        points: about how many samples to keep, 16 at least; shorter series are kept whole.
    """
    finite = np.flatnonzero(np.isfinite(values))
    if len(finite) == 0:
        nothing = np.zeros(0, np.intp)
        return Selection(nothing, np.zeros(0, bool), nothing)
    seen = values if len(finite) == len(values) else values[finite]
    breaks = _breaks(time if len(finite) == len(values) else time[finite], points // 8)
    if len(finite) <= points:
        kept = np.arange(len(finite))
    else:
        ends = np.concatenate([[0, len(seen) - 1], breaks, breaks + 1])
        kept = np.unique(np.concatenate([ends, _extremes(seen, (points - len(ends)) // 2)]))
    after = np.searchsorted(kept, breaks) + 1
    index = np.insert(finite[kept], after, finite[breaks])
    is_break = np.insert(np.zeros(len(kept), bool), after, True)
    edges = np.concatenate([[-1], breaks, [len(seen) - 1]])
    lone = finite[edges[1:][np.diff(edges) == 1]]
    return Selection(index, is_break, lone)


def envelope(time: Array, lower: Array, upper: Array, points: int) -> tuple[Array, Array]:
    """The outline of a band, as polygons separated by NaN, that covers every sample of it.

    Each bin has its lowest ``lower`` and highest ``upper``; at the edge between two bins the outline takes
    the wider of the two, so that straight lines between edges still enclose all samples.

    Args:
        time: (T,) s, increasing.
        lower: (T,) lower limit, NaN where missing.
        upper: (T,) upper limit, same unit.
        points: about how many edges to keep; shorter bands are kept whole.

    Returns:
        x and y of the polygons' corners.
    """
    finite = np.flatnonzero(np.isfinite(lower) & np.isfinite(upper))
    if len(finite) == 0:
        return np.zeros(0), np.zeros(0)
    t, low, high = time[finite], lower[finite], upper[finite]
    cuts = np.concatenate([[0], _breaks(t, points // 8) + 1, [len(t)]])
    xs: list[Array] = []
    ys: list[Array] = []
    lift = np.array([np.nan])
    for start, stop in pairwise(cuts):
        part = slice(start, stop)
        edges, bottom, top = _enclose(low[part], high[part], max(2, points * (stop - start) // len(t)))
        x = t[part][edges]
        xs += [x, x[::-1], lift]
        ys += [bottom, top[::-1], lift]
    return np.concatenate(xs[:-1]), np.concatenate(ys[:-1])


def runs(time: Array, codes: NDArray[np.int8], points: int) -> tuple[Array, Array, NDArray[np.int8]]:
    """Stretches of equal validity: their starts and ends in s, and their codes.

    Where there are more than ``points`` of them, each bin of samples shows its most severe code.

    Args:
        time: (T,) s, increasing.
        codes: (T,) :class:`roadstate.core.Validity` codes.
        points: how many stretches are fine enough.
    """
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    breaks = _breaks(time, points // 8)
    starts = np.unique(np.concatenate([[0], np.flatnonzero(np.diff(codes)) + 1, breaks + 1]))
    if len(starts) > points:
        grid = np.linspace(0, len(codes), points, endpoint=False).astype(np.intp)
        starts = np.unique(np.concatenate([grid, breaks + 1]))
        rank = np.argsort(SEVERITY)
        worst = np.array(SEVERITY, np.int8)[np.maximum.reduceat(rank[codes], starts)]
        fresh = np.concatenate([[True], (np.diff(worst) != 0) | np.isin(starts[1:], breaks + 1)])
        starts, shown = starts[fresh], worst[fresh]
    else:
        shown = codes[starts]
    last = np.concatenate([starts[1:], [len(time)]]) - 1
    stop = np.concatenate([time[starts[1:]], [time[-1] + step]])
    at_gap = np.isin(last, breaks)
    stop[at_gap] = time[last[at_gap]] + step
    return time[starts], stop, shown


def _breaks(time: Array, limit: int) -> Index:
    """The samples after which a gap lies."""
    if len(time) < 3:  # of two samples nobody knows the usual step
        return np.zeros(0, np.intp)
    steps = np.diff(time)
    # a sample of the steps tells the median as well; drawn at random, lest it beat with a pattern in them
    few = steps if len(steps) <= _SAMPLED else steps[_RANDOM_ORDER % len(steps)]
    found = np.flatnonzero(steps > _GAP * np.median(few))
    if len(found) > limit:
        found = np.sort(found[np.argsort(steps[found])[len(found) - limit :]])
    return found


def _extremes(values: Array, bins: int) -> Index:
    size = -(-len(values) // max(bins, 1))
    whole = len(values) // size * size
    table = values[:whole].reshape(-1, size)
    offset = np.arange(0, whole, size)
    found = [offset + np.argmin(table, axis=1), offset + np.argmax(table, axis=1)]
    if whole < len(values):
        rest = values[whole:]
        found.append(whole + np.array([np.argmin(rest), np.argmax(rest)]))
    return np.concatenate(found)


def _enclose(lower: Array, upper: Array, edges: int) -> tuple[Index, Array, Array]:
    n = len(lower)
    if n <= edges:
        return np.arange(n), lower, upper
    starts = np.linspace(0, n, edges - 1, endpoint=False).astype(np.intp)
    low, high = np.minimum.reduceat(lower, starts), np.maximum.reduceat(upper, starts)
    bottom = np.minimum(np.append(low, low[-1]), np.insert(low, 0, low[0]))
    top = np.maximum(np.append(high, high[-1]), np.insert(high, 0, high[0]))
    return np.append(starts, n - 1), bottom, top
