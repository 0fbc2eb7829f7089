"""Several files of one drive as one recording."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from itertools import pairwise

import numpy as np

from roadstate.core.errors import InputError
from roadstate.core.signals import Array, Recording, Signal


def join(recordings: Sequence[Recording]) -> Recording:
    """Join the files of one drive into one recording.

    Recordings that all carry absolute start times (UTC where they name no zone) are laid on the earliest
    one's clock; otherwise their times are taken to be on one clock already. Files that follow one another are
    put in time order, each signal's pieces end to end; files that run at the same time must hold different
    signals (a CAN log and a GNSS log, say), or the same at different times, and lie side by side. The
    metadata are the earliest one's, with all ``files`` and whatever any of them left out (``skipped``,
    ``undecoded``).

    Raises:
        InputError: no file; two files hold the same signal at the same time, or give it different units; a
            start time that is no date.
    """
    if not recordings:
        raise InputError("no recording to join", mend="give at least one file")
    if len(recordings) == 1:
        return recordings[0]
    shifted = sorted(_on_one_clock(recordings), key=_start)
    parts: dict[str, list[Signal]] = {}
    for recording in shifted:
        for name, signal in recording.signals.items():
            if len(signal):
                parts.setdefault(name, []).append(signal)
    for name, pieces in parts.items():
        pieces.sort(key=lambda piece: _span(piece)[0])
        for earlier, later in pairwise(pieces):
            _check_follows(earlier, name, later)
    joined: dict[str, Signal] = {}
    bases: dict[tuple[int, ...], Array] = {}
    for name, pieces in parts.items():
        key = tuple(id(p.time) for p in pieces)
        if key not in bases:
            bases[key] = np.concatenate([p.time for p in pieces])
        joined[name] = replace(pieces[0], time=bases[key], values=np.concatenate([p.values for p in pieces]))
    files = [f for r in shifted for f in r.metadata.get("files", [])]
    left_out = {key: _union(r.metadata.get(key, ()) for r in shifted) for key in ("skipped", "undecoded")}
    known = {key: names for key, names in left_out.items() if names}
    return Recording(joined, {**shifted[0].metadata, **known, "files": files})


def _union(lists: Iterable[Iterable[str]]) -> list[str]:
    return list(dict.fromkeys(text for texts in lists for text in texts))


def _check_follows(last: Signal, name: str, signal: Signal) -> None:
    if signal.unit != last.unit:
        raise InputError(
            f"{name} is in '{signal.unit}' here and in '{last.unit}' in {last.source}",
            where=signal.source,
            mend="convert one of the files",
        )
    begin, end = _span(signal)[0], _span(last)[1]
    if begin <= end:
        raise InputError(
            f"{name} begins at {begin:.6g} s, before {last.source} ends ({end:.6g} s)",
            where=signal.source,
            mend="give files of one drive; without absolute time they must continue each other's clock",
        )


def _span(signal: Signal) -> tuple[float, float]:
    """First and last stamp that is a number; a missing one says nothing of the order."""
    finite = signal.time[np.isfinite(signal.time)]
    return (float(finite[0]), float(finite[-1])) if len(finite) else (np.inf, -np.inf)


def _start(recording: Recording) -> float:
    return min((_span(s)[0] for s in recording.signals.values()), default=np.inf)


def _on_one_clock(recordings: Sequence[Recording]) -> list[Recording]:
    starts = [r.metadata.get("start_time") for r in recordings]
    if any(s is None for s in starts):
        return list(recordings)
    instants = [_instant(str(s), r) for s, r in zip(starts, recordings, strict=True)]
    first = min(instants)
    moved: list[Recording] = []
    for recording, instant in zip(recordings, instants, strict=True):
        offset = (instant - first).total_seconds()
        bases = {id(s.time): s.time + offset if offset else s.time for s in recording.signals.values()}
        signals = {n: replace(s, time=bases[id(s.time)]) for n, s in recording.signals.items()}
        moved.append(Recording(signals, {**recording.metadata, "start_time": starts[instants.index(first)]}))
    return moved


def _instant(text: str, recording: Recording) -> datetime:
    try:
        instant = datetime.fromisoformat(text)
        return instant.replace(tzinfo=UTC) if instant.tzinfo is None else instant.astimezone(UTC)
    except (ValueError, OverflowError) as error:
        files = ", ".join(str(f) for f in recording.metadata.get("files", []))
        raise InputError(
            f"start time '{text}' is no date", where=files, mend="write it in ISO 8601"
        ) from error
