"""A recording as read: every signal on the time base it came with."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roadstate.core.channels import CHANNELS
from roadstate.core.errors import InputError
from roadstate.core.log import Log

Array = NDArray[np.float64]
_MAX_RATE = 100.0  # Hz; what a vehicle-dynamics estimator needs, and no more
_MAX_TICKS = 2.0**53  # beyond it neighbouring ticks are one float
_SAME_RATE = 0.01  # relative
_FEW = 0.01  # of a signal's samples


@dataclass(frozen=True)
class Signal:
    """One signal on its own time base.

    Attributes:
        time: (N,) seconds since the recording's start, strictly increasing, finite.
        values: (N,) in ``unit``; NaN where the source marked the sample invalid.
        unit: unit text as the source gave it; ``None`` where it gave none.
        source: where it came from, for messages (``drive.csv:speed``).
        message: the bus message that carried it, where there was one.
        bus: the bus channel, where there was one.
    """

    time: Array
    values: Array
    unit: str | None = None
    source: str = ""
    message: str | None = None
    bus: int | None = None

    def __post_init__(self) -> None:
        if self.time.shape != self.values.shape or self.time.ndim != 1:
            raise ValueError(f"time {self.time.shape} and values {self.values.shape} must be equal (N,)")

    def __len__(self) -> int:
        return len(self.time)

    @property
    def rate(self) -> float:
        """Median sampling rate in Hz; 0 with fewer than two samples."""
        return 0.0 if len(self) < 2 else float(1.0 / np.median(np.diff(self.time)))

    def check_time(self) -> None:
        """Refuse a time base that runs backward, repeats or is not finite.

        Raises:
            InputError: names the first offending row.
        """
        bad = ~np.isfinite(self.time)
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(f"time is not a number at row {row}", where=self.source, mend=_REPAIR)
        step = np.diff(self.time)
        if (step > 0).all():
            return
        row = int(np.argmax(step <= 0)) + 1
        kind = "repeats" if step[row - 1] == 0 else "runs backward"
        count = int((step <= 0).sum())
        raise InputError(
            f"time {kind} at row {row} ({self.time[row - 1]:.6g} s, then {self.time[row]:.6g} s; "
            f"{count} such rows)",
            where=self.source,
            mend=_REPAIR,
        )

    def repaired(self) -> Signal:
        """The signal without the samples whose time is not finite or out of order (:func:`in_order`)."""
        keep = in_order(self.time)
        return replace(self, time=self.time[keep], values=self.values[keep])


def in_order(time: Array) -> NDArray[np.bool_]:
    """Which samples to keep so that time increases: as many as can be, the first of those that repeat.

    A stamp later than most of its followers is taken for the wrong one, not the followers.

    Args:
        time: (N,) in s.

    Returns:
        (N,) true where a sample stays; never where its time is not finite.
    """
    keep = np.isfinite(time)
    stamps = time[keep]
    ahead = np.ones(len(stamps), dtype=bool)
    ahead[1:] = stamps[1:] > np.maximum.accumulate(stamps)[:-1]
    if not ahead.all():
        longest = _longest_increasing(stamps.tolist())
        if len(longest) > ahead.sum():
            ahead[:] = False
            ahead[longest] = True
    keep[keep] = ahead
    return keep


def _longest_increasing(stamps: list[float]) -> list[int]:
    """Rows of the longest strictly increasing subsequence, by patience sorting: O(N log N)."""
    ends: list[float] = []  # the least end of an increasing run of each length
    rows: list[int] = []
    before: list[int] = []
    for row, stamp in enumerate(stamps):
        length = bisect_left(ends, stamp) if ends and stamp <= ends[-1] else len(ends)
        before.append(rows[length - 1] if length else -1)
        if length == len(ends):
            ends.append(stamp)
            rows.append(row)
        elif stamp < ends[length]:
            ends[length], rows[length] = stamp, row
    found: list[int] = []
    row = rows[-1] if rows else -1
    while row >= 0:
        found.append(row)
        row = before[row]
    return found[::-1]


_REPAIR = "sort the log, or set 'time: {repair: drop}' in the mapping to leave such samples out"


@dataclass(frozen=True)
class Recording:
    """Signals by name, each on its own time base, as a file holds them.

    Attributes:
        signals: by name: the source's names as read, canonical ones after a mapping.
        metadata: what is known of the source (``files``, ``start_time`` as ISO text, ``format``).
    """

    signals: Mapping[str, Signal]
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Signal:
        return self.signals[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.signals)

    def __len__(self) -> int:
        return len(self.signals)

    @property
    def is_common_base(self) -> bool:
        """Whether all signals share one time base (as a CSV's columns do)."""
        bases = [s.time for s in self.signals.values()]
        return all(b is bases[0] or np.array_equal(b, bases[0]) for b in bases[1:])

    def resample(self, rate: float | None = None) -> Log:
        """Bring canonical signals onto one time base.

        With ``rate=None``, signals that share a time base keep it. Otherwise each sample goes to its nearest
        tick of the grid (so by at most half a tick, and its jitter where the signal keeps half a tick away
        from the grid), several in one tick are averaged, which is also the anti-alias filter; a tick without
        a sample is NaN, and ticks that no signal reaches (gaps) are left out. References are interpolated
        where their neighbours are at most 1 s (or two of their own samples) apart. Nothing is extrapolated.

        Args:
            rate: ticks per second in Hz; default the fastest measured signal's, at most 100.

        Raises:
            InputError: no signals, a name that is not canonical, or a bad time base.
        """
        if not self.signals:
            raise InputError(
                "no canonical channel found", mend="give a mapping ('roadstate channels FILE --suggest')"
            )
        unknown = [n for n in self.signals if n not in CHANNELS or n == "time"]
        if unknown:
            raise InputError(f"'{unknown[0]}' is not a canonical channel", mend="apply a mapping first")
        for signal in self.signals.values():
            signal.check_time()
        if not any(len(s) for s in self.signals.values()):
            files = ", ".join(str(f) for f in self.metadata.get("files", []))
            raise InputError("every mapped channel is empty", where=files, mend="check the mapping")
        if rate is not None and not 0.1 <= rate <= 10_000:
            raise InputError(f"a rate of {rate:g} Hz is out of range", mend="choose 0.1 to 10000 Hz")
        if rate is None and self.is_common_base:
            first = next(iter(self.signals.values()))
            return Log(first.time, {n: s.values for n, s in self.signals.items()}, dict(self.metadata))
        measured = {n: s for n, s in self.signals.items() if not CHANNELS[n].is_reference and len(s)}
        if not measured:
            measured = {n: s for n, s in self.signals.items() if len(s)}
        if rate is None:
            fastest = max(s.rate for s in measured.values())
            rate = min(float(f"{fastest:.2g}"), _MAX_RATE) if fastest > 0 else 1.0
        return self._on_grid(measured, rate)

    def _on_grid(self, measured: Mapping[str, Signal], rate: float) -> Log:
        start = min(s.time[0] for s in measured.values())
        last = max(measured.values(), key=lambda s: float(s.time[-1]))
        if (last.time[-1] - start) * rate > _MAX_TICKS:
            raise InputError(
                f"time runs from {start:.6g} s to {last.time[-1]:.6g} s",
                where=last.source,
                mend="check the unit of the time",
            )
        ticks_of = {n: _ticks((s.time - start) * rate) for n, s in measured.items()}
        used = np.unique(np.concatenate(list(ticks_of.values())))
        time = start + used / rate
        columns: dict[str, Array] = {}
        for name, signal in self.signals.items():
            if name in measured and not CHANNELS[name].is_reference:
                columns[name] = _bin_mean(np.searchsorted(used, ticks_of[name]), signal.values, len(used))
            else:
                columns[name] = interpolate(signal, time)
        return Log(time, columns, {**self.metadata, "rate": rate})


def _ticks(place: Array) -> NDArray[np.int64]:
    """The tick of each sample, from its place on the grid (in ticks).

    Of a signal as fast as the grid whose samples lie about half-way between two ticks, jitter would send
    neighbours to one tick and leave the next one empty: all of them go the same way then.
    """
    nearest = np.rint(place).astype(np.int64)
    few = _FEW * len(place)
    if _doubled(nearest) <= few or abs(float(np.median(np.diff(place))) - 1.0) > _SAME_RATE:
        return nearest
    phase = float(np.angle(np.mean(np.exp(2j * np.pi * place)))) / (2.0 * np.pi)
    together = np.rint(place - phase).astype(np.int64)
    return together if _doubled(together) < _doubled(nearest) - few else nearest


def _doubled(ticks: NDArray[np.int64]) -> int:
    """How many of the ticks, which do not fall, are those of the sample before."""
    return int((np.diff(ticks) == 0).sum())


def _bin_mean(index: NDArray[np.int64], values: Array, size: int) -> Array:
    good = np.isfinite(values)
    total = np.bincount(index[good], weights=values[good], minlength=size)
    count = np.bincount(index[good], minlength=size)
    with np.errstate(invalid="ignore"):
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def interpolate(signal: Signal, time: Array) -> Array:
    """The signal at other times: linear between valid samples at most 1 s (or two of its own steps) apart.

    Args:
        signal: the samples; NaN ones are passed over.
        time: (T,) in s.

    Returns:
        (T,) in the signal's unit; NaN in wider gaps and outside the signal's span.
    """
    good = np.isfinite(signal.values)
    if good.sum() < 2:
        return np.full(len(time), np.nan)
    t, v = signal.time[good], signal.values[good]
    out = np.interp(time, t, v, left=np.nan, right=np.nan)
    after = np.clip(np.searchsorted(t, time, side="left"), 1, len(t) - 1)
    reach = max(1.0, 2.0 * float(np.median(np.diff(t))))
    wide = (t[after] - t[after - 1] > reach) & (time > t[after - 1]) & (time < t[after])
    return np.where(wide, np.nan, out)
