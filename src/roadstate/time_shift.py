"""By how much one signal comes later than another that tells of the same motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RATE = 25.0
"""Samples per second of the grid that signals are compared on."""
_LOW, _HIGH = 0.12, 3.0  # s: 1σ of the weights of the means which the band that is compared lies between
_MOST = 0.6  # s
_BLOCK = 4.0  # s: errors so far apart are independent
_BLOCKS = 5  # without so many nobody can tell
LEAST_TIME = _BLOCK * _BLOCKS
"""s that signals have to last."""
_SUSPECT = 0.11  # of what does not fit may look like a shift throughout
_ROUNDS = 6  # of weighting blocks by how well they fit
_BOXES = 3  # moving means in a row that make a bell
_EXACT = 1e-9  # of the power: less misfit is rounding
_TINY = np.finfo(float).tiny


class TimeShift(NamedTuple):
    """What comparing two signals says.

    Attributes:
        seconds: by which the second is later than the first.
        std: 1σ of that, s.
        correlation: of the two, once shifted.
    """

    seconds: float
    std: float
    correlation: float


def smooth(values: Array, std: float = _LOW) -> Array:
    """Mean over neighbours on the grid, weighted by a bell of so many s (1σ); NaN beside gaps."""
    good = np.isfinite(values)
    width = int(std * RATE * np.sqrt(12 / _BOXES)) | 1
    total, count = np.where(good, values, 0.0), good.astype(float)
    for _ in range(_BOXES):
        total, count = _box(total, width), _box(count, width)
    enough = good & (count > 0.5 * width**_BOXES)
    return np.where(enough, total / np.maximum(count, 1.0), np.nan)


def rate_of(values: Array) -> Array:
    """Time derivative of the smoothed signal on the grid."""
    return np.gradient(smooth(values)) * RATE


def time_shift(first: Array, second: Array, used: NDArray[np.bool_]) -> TimeShift | None:
    """By how much ``second`` is later than ``first``; ``None`` where too little is there, or it is too much.

    Least squares second(t) ≈ g·first(t − τ) over gain g > 0 and τ within 0.6 s of none, in the band from
    about 0.05 to 1.3 Hz. Blocks of 4 s count by how well they fit, so that a wheel's spinning or a kerb does
    not decide. σ is that of an M-estimator (sandwich; Huber, *Robust Statistics*, ch. 6), so that errors may
    be correlated within a block, and a share of what does not fit is taken to look like a shift throughout.

    Args:
        first, second: (N,) on the grid, NaN where missing.
        used: (N,) where the two should agree.
    """
    x, y = (np.where(used, _in_band(signal), np.nan) for signal in (first, second))
    reach = int(_MOST * RATE)
    where = np.flatnonzero(_is_clear(x, reach + 1) & _is_clear(y, 1))
    _, block = np.unique(where // int(_BLOCK * RATE), return_inverse=True)
    if not len(where) or block[-1] + 1 < _BLOCKS:
        return None
    starts, Y = np.flatnonzero(np.diff(block, prepend=-1)), y[where]

    def later(steps: int) -> Array:
        """The first as if it came so many steps later."""
        return x[where - steps]

    shifts = np.arange(-reach, reach + 1)
    products = [[np.add.reduceat(of, starts) for of in (X * X, X * Y)] for X in map(later, shifts.tolist())]
    xx, xy = np.moveaxis(np.array(products), 1, 0)
    yy, count = np.add.reduceat(Y * Y, starts), np.diff(starts, append=len(Y))
    exact = max(_EXACT * float(np.mean(yy / count)), _TINY)
    weight = np.ones(len(starts))
    best, gain, correlation = 0, 0.0, np.zeros(len(shifts))
    for _ in range(_ROUNDS):
        size = (xx @ weight) * (yy @ weight)
        correlation = (xy @ weight) / np.sqrt(np.maximum(size, _TINY))
        best = int(np.argmax(correlation))
        gain = (xy[best] @ weight) / max(xx[best] @ weight, _TINY)
        misfit = np.maximum(yy - 2 * gain * xy[best] + gain**2 * xx[best], 0.0) / count
        usual = max(float(np.median(misfit)), exact)
        weight = usual / np.maximum(misfit, usual)
    if best in (0, 2 * reach) or correlation[best] <= 0:
        return None
    before, at, after = correlation[best - 1 : best + 2]
    part = 0.5 * (before - after) / (before - 2 * at + after)
    earlier, X, behind = (later(shifts[best] + k) for k in (-1, 0, 1))
    each = weight[block]
    error = Y - gain * ((1 - abs(part)) * X + abs(part) * (behind if part > 0 else earlier))
    slope = 0.5 * gain * RATE * (behind - earlier)
    slope -= X * (np.sum(each * slope * X) / np.sum(each * X**2))
    scores = np.add.reduceat(each * slope * error, starts)
    # by both slopes: of one alone, noise would make it look sharp
    sharp = -np.sum(each * slope * 0.5 * RATE * (y[where + 1] - y[where - 1]))
    if sharp <= 0:
        return None
    lasting = _SUSPECT * np.sqrt(np.sum(each * error**2) / sharp)
    std = float(np.hypot(np.sqrt(np.sum(scores**2)) / sharp, lasting))
    return TimeShift(float(shifts[best] + part) / RATE, std, float(at))


def _in_band(values: Array) -> Array:
    low = smooth(values)
    return low - smooth(low, _HIGH)


def _is_clear(values: Array, reach: int) -> NDArray[np.bool_]:
    """Whether nothing is missing from so many steps before to as many after."""
    return _box(np.isfinite(values).astype(float), 2 * reach + 1) > 2 * reach + 0.5


def _box(values: Array, width: int) -> Array:
    """Sum over ``width`` neighbours, an odd number."""
    summed = np.cumsum(np.pad(values, (width // 2 + 1, width // 2)))
    return summed[width:] - summed[:-width]
