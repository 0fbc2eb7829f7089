"""A grade to compare with, from a log's own height: the slope of height over travelled distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roadstate.core import Signal
from roadstate.io.slope_noise import Lines, slope_std

Array = NDArray[np.float64]

_MIN_SAMPLES = 4
_MIN_REACH = 0.25  # of the window, to either side of its centre
_MAX_STEP = 1 / 3  # of the window, between neighbouring samples
_MAX_DISTINCT = 0.9  # of the heights, if they are rounded
_MAX_SPEED_GAP = 3.0  # s; over longer ones the distance is not known
_BLOCK = 4096


@dataclass(frozen=True)
class SlopeReference:
    """A derived grade and how well it is known.

    Attributes:
        grade: on the height's time base, rad; NaN where there is none.
        std: (N,) standard error of each value in rad; NaN where there is none.
        median_std: root of the median variance, in rad; NaN where there is no value at all.
    """

    grade: Signal
    std: Array
    median_std: float


def slope_reference(
    altitude: Signal, speed: Signal, *, over: float, min_speed: float = 5.0
) -> SlopeReference:
    """Least-squares slope of height against travelled distance in a centred window of the road.

    At each height sample a straight line is fitted to the heights within ``over/2`` of it along the road
    (Savitzky and Golay's smoothing derivative of first order, on uneven samples); the grade is the slope's
    arctangent. It looks ahead, so it is a reference and no estimate. A sinusoidal road of wavelength L comes
    out smaller by 3 (sin a − a cos a)/a³ with a = π·over/L.

    The standard error is of :func:`roadstate.io.slope_noise.slope_std`: from the heights' own scatter about
    the lines, their noise taken as white plus a random walk.

    Args:
        altitude: heights in m, (N,).
        speed: speed along the road in m/s on any time base; linear between samples up to 3 s apart.
        over: length of the window in m.
        min_speed: speed in m/s below which samples are neither used nor given a value.

    Returns:
        The grade on the height's time base. There is none where the window holds fewer than 4 samples, a gap
        of over a third of it, or nothing beyond a quarter of it to one side.

    Raises:
        InputError: a time base that is not increasing.
    """
    altitude.check_time()
    speed.check_time()
    time = altitude.time
    distance, pace = _travelled(speed, time, over)
    good = np.isfinite(altitude.values) & np.isfinite(distance) & (pace >= min_speed)
    grade, std = np.full(len(time), np.nan), np.full(len(time), np.nan)
    if good.sum() >= _MIN_SAMPLES:
        s, h = distance[good], altitude.values[good]
        lines, is_usable = _fit(s, h, over)
        slope = lines.slope[is_usable]
        grade_good, std_good = np.full(len(s), np.nan), np.full(len(s), np.nan)
        grade_good[is_usable] = np.arctan(slope)
        # d(atan k)/dk = 1/(1 + k²)
        std_good[is_usable] = slope_std(lines[is_usable], _resolution(altitude.values)) / (1 + slope**2)
        grade[good], std[good] = grade_good, std_good
    known = std[np.isfinite(std)]
    median = float(np.sqrt(np.median(known**2))) if len(known) else float("nan")
    source = f"slope of {altitude.source} over {speed.source}"
    return SlopeReference(Signal(time, grade, "rad", source), std, median)


def _travelled(speed: Signal, time: Array, over: float) -> tuple[Array, Array]:
    """Distance and speed at ``time``; across gaps the distance leaps so far that no window spans them."""
    good = np.isfinite(speed.values)
    # backing up is no way along the road, and would put the places out of order
    t, v = speed.time[good], np.maximum(speed.values[good], 0.0)
    if len(t) < 2:
        nothing = np.full(len(time), np.nan)
        return nothing, nothing
    step = np.diff(t)
    is_gap = step > _MAX_SPEED_GAP
    increments = np.where(is_gap, 10 * over, (v[1:] + v[:-1]) / 2 * step)
    path = np.concatenate([[0.0], np.cumsum(increments)])
    before = np.clip(np.searchsorted(t, time, side="right") - 1, 0, len(t) - 2)
    elapsed = time - t[before]
    slope = (v[before + 1] - v[before]) / step[before]
    known = (time >= t[0]) & (time <= t[-1]) & (~is_gap[before] | (elapsed == 0))
    # the speed is linear between its samples, so the distance is quadratic
    distance = path[before] + (v[before] + slope * elapsed / 2) * elapsed
    return np.where(known, distance, np.nan), np.where(known, v[before] + slope * elapsed, np.nan)


def _fit(s: Array, h: Array, over: float) -> tuple[Lines, NDArray[np.bool_]]:
    """Straight lines through the heights ``h`` within ``over/2`` of each place ``s`` (N,), sorted."""
    first = np.searchsorted(s, s - over / 2, side="left")
    last = np.searchsorted(s, s + over / 2, side="right")
    nothing = np.zeros(len(s))
    lines = Lines(
        nothing,
        nothing.copy(),
        nothing.copy(),
        nothing.copy(),
        span=s[last - 1] - s[first],
        count=last - first,
    )
    for begin in range(0, len(s), _BLOCK):
        centres = slice(begin, min(begin + _BLOCK, len(s)))
        low, high = first[begin], last[centres.stop - 1]
        # sums from an origin nearby: over a whole log they would cancel to nothing
        x, y = s[low:high] - s[begin], h[low:high] - h[begin]
        a, b = first[centres] - low, last[centres] - low
        sum_x, sum_y, sum_xx, sum_xy, sum_yy = (_window_sums(z, a, b) for z in (x, y, x * x, x * y, y * y))
        dx, dy = np.diff(x), np.diff(y)
        step_xx, step_xy, step_yy = (_window_sums(z, a, b - 1) for z in (dx * dx, dx * dy, dy * dy))
        count = (b - a).astype(np.float64)
        scatter = np.maximum(sum_xx - sum_x**2 / count, 0.0)
        together = sum_xy - sum_x * sum_y / count
        slope = np.divide(together, scatter, out=np.zeros(len(a)), where=scatter > 0)
        lines.slope[centres], lines.scatter[centres] = slope, scatter
        lines.residual[centres] = np.maximum(sum_yy - sum_y**2 / count - slope * together, 0.0)
        lines.roughness[centres] = np.maximum(step_yy - slope * (2 * step_xy - slope * step_xx), 0.0)
    widest = _widest(np.diff(s, prepend=s[0]), first, last)
    is_usable = (
        (lines.count >= _MIN_SAMPLES)
        & (s - s[first] >= _MIN_REACH * over)
        & (s[last - 1] - s >= _MIN_REACH * over)
        & (widest <= _MAX_STEP * over)
    )
    return lines, is_usable


def _window_sums(values: Array, first: NDArray[np.int64], last: NDArray[np.int64]) -> Array:
    total = np.concatenate([[0.0], np.cumsum(values)])
    sums: Array = total[last] - total[first]
    return sums


def _widest(step: Array, first: NDArray[np.int64], last: NDArray[np.int64]) -> Array:
    """The widest step within each window: the steps of samples ``first + 1`` to ``last - 1``."""
    limits = np.stack([np.minimum(first + 1, len(step) - 1), last], axis=1).ravel()
    # a segment [i, j) with i >= j gives step[i]; such windows hold one sample and are refused for it
    padded = np.append(step, 0.0)
    widest: Array = np.maximum.reduceat(padded, limits)[::2]
    return widest


def _resolution(values: Array) -> float:
    """The step in which the values come, 0 where they are not rounded: rounded ones meet again and again."""
    known = values[np.isfinite(values)]
    levels = np.unique(known)
    steps = np.diff(levels)
    steps = steps[steps > 1e-9]
    return float(steps.min()) if len(steps) and len(levels) < _MAX_DISTINCT * len(known) else 0.0
