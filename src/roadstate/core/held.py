"""Sample and hold: a slow signal written down at a faster clock, each of its samples over and over."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_LONGEST = 200  # samples for which a value is held; a slower signal tells little, repeated or not
_CHANGES = 30  # of the value; fewer do not tell a clock from chance
_ON_CLOCK = 0.97  # share of the runs of equal samples that last a whole number of periods
_ONCE = 0.2  # and of those that last a single one
_LARGER = 0.1  # share of the changes by more than the least: one that rises step by step is only coarse
_COUNTED, _JITTER = 5, 0.12  # samples below which periods are exact; share by which longer ones may be off
_MANY = 20  # periods; of so long a run two clocks that differ a little lose count


def hold_period(values: Array) -> int:
    """For how many samples each value of a signal is held, as if sampled by a slower clock.

    Between changes there are as many samples then, or a multiple of it where a value came twice; a coarse
    signal (speed in whole km/h) changes when it pleases.

    Args:
        values: (N,), NaN where there is none.

    Returns:
        Samples (of those that are no NaN) from 2 to 200; 1 where nothing is held.
    """
    present = values[np.isfinite(values)]
    change = np.diff(present)
    changes = np.flatnonzero(change)
    if len(changes) <= _CHANGES or 1.5 * len(changes) > len(present):
        return 1
    sizes = np.abs(change[changes])
    if np.mean(sizes > 1.5 * sizes.min()) < _LARGER:
        return 1
    runs = np.diff(changes)
    best, least = 1, np.inf
    for period in range(2, min(int(np.median(runs)) + 1, _LONGEST) + 1):
        near = runs[runs < _MANY * period]
        times = np.rint(near / period)
        off = np.abs(near - times * period)
        on_clock = (times >= 1) & (off <= _tolerance(period))
        enough = len(near) >= _CHANGES and np.mean(on_clock) >= _ON_CLOCK
        if enough and np.mean(on_clock & (times == 1)) >= _ONCE and np.mean(off) < least:
            best, least = period, float(np.mean(off))
    return best


def is_new(values: Array, period: int) -> NDArray[np.bool_]:
    """Which samples of a signal held for ``period`` samples are not merely repeated.

    Args:
        values: (N,), NaN where there is none.
        period: of :func:`hold_period`.

    Returns:
        (N,) true at each change, and each ``period`` samples while none follows.
    """
    new = np.isfinite(values)
    present = values[new]
    starts = np.flatnonzero(np.append(True, np.diff(present) != 0))
    lengths = np.diff(np.append(starts, len(present)))
    place = np.arange(len(present)) - np.repeat(starts, lengths)
    left = np.repeat(lengths, lengths) - place
    # a run that a late clock has made a little longer brings nothing more at its end
    again = (place % period == 0) & ((place == 0) | (2 * left > period))
    # of the first run nobody saw the beginning: it ends on the clock
    first = slice(0, lengths[0] if len(lengths) > 1 else 0)
    again[first] = left[first] % period == 0
    new[new] = again
    return new


def sampled(values: Array) -> tuple[Array, int]:
    """A signal without the samples that merely repeat one, and for how many samples each was held.

    A held sample is older than it looks, and its error comes again with it: an estimator that takes it for
    ten is late, and too sure of it.

    Args:
        values: (N,), NaN where there is none.

    Returns:
        (N,) the same, or NaN in place of repeats; and :func:`hold_period`.
    """
    period = hold_period(values)
    return (values, 1) if period == 1 else (np.where(is_new(values, period), values, np.nan), period)


def _tolerance(period: int) -> float:
    """How many samples a run may be off."""
    return 0.0 if period < _COUNTED else max(1.0, _JITTER * period)
