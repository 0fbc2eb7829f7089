"""What readers left out of a log, and what else is wrong with it, in words."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roadstate.core import CHANNELS, InputError

if TYPE_CHECKING:
    from roadstate import io
    from roadstate.core import Log
    from roadstate.lateness import Late

LOOK_AT_IT = "look at its column, and at 'range' and 'valid' in the mapping"
"""How to mend a channel that is there but empty."""
_SHOWN = 6  # names of each kind
_NO_NUMBERS = "no plain numbers"


def left_out(metadata: Mapping[str, Any]) -> str | None:
    """One line: the columns and messages that are not among the signals, and why; ``None`` without any.

    Args:
        metadata: of a recording.
    """
    by_reason: dict[str, list[str]] = {}
    for entry in metadata.get("skipped", ()):
        name, reason = _split(entry)
        by_reason.setdefault(reason, []).append(name)
    if undecoded := list(metadata.get("undecoded", ())):
        by_reason["no DBC explains them"] = undecoded
    parts = [f"{_some(names)} ({reason})" for reason, names in by_reason.items()]
    return f"left out: {_some(parts, ';')}" if parts else None


def missed_channels(metadata: Mapping[str, Any], mapping: io.Mapping) -> dict[str, str]:
    """Canonical channels that a log would have but for what could not be read, or for how they are spelt.

    Args:
        metadata: of what the mapping has made.
        mapping: names that it takes from elsewhere, or ignores, are not missed.

    Returns:
        What is missed, in words → how to mend it.
    """
    listed = {*mapping.channels, *mapping.reference}
    missed = {}
    for name, reason in map(_split, metadata.get("skipped", ())):
        is_wanted = name in listed or not mapping.only_listed
        is_taken = metadata["sources"].get(name, [name]) != [name]
        if name in CHANNELS and name != "time" and is_wanted and not is_taken:
            missed[f"{name} was left out ({reason})"] = "correct it, or map another signal"
    for name, meant in metadata.get("misspelt", {}).items():
        missed[f"column '{name}' is not used"] = f"did you mean '{meant}'? Rename it, or map it"
    return missed


def empty_channels(log: Log) -> dict[str, str]:
    """Channels of a log that hold no number: what to say of each → how to mend it."""
    silent = [name for name in log.channels if name not in log.available]
    return {f"{name} has no sample that is a number": LOOK_AT_IT for name in silent}


def held_channels(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Channels whose samples were repeated row by row: what was done about it → how to have it otherwise."""
    by_rows: dict[int, list[str]] = {}
    for name, rows in metadata.get("held", {}).items():
        by_rows.setdefault(rows, []).append(name)
    return {
        f"{_some(names)}: each sample is repeated for {rows} rows; it is taken once": (
            "if these are measurements of their own, set 'time: {held: keep}' in the mapping"
        )
        for rows, names in by_rows.items()
    }


def late_channels(late: Iterable[Late]) -> dict[str, str]:
    """Channels that come late throughout: what to say of each → how to mend it."""
    said = {}
    for one in late:
        what = f"{_some(one.channels)}: {one.seconds:.2f} ± {one.std:.2f} s later than the other channels"
        said[what] = f"add {round(100 * one.seconds)}0 ms to its 'delay' in the mapping"
    return said


def notes(file: Path, log: Log, mapping: io.Mapping, late: Iterable[Late]) -> list[InputError]:
    """What a user had better know of a log that was taken as it is, a line each.

    Args:
        file: to name.
        log: as the estimators see it.
        mapping: that made it.
        late: channels of it that come late.
    """
    found = missed_channels(log.metadata, mapping) | empty_channels(log)
    found |= held_channels(log.metadata) | late_channels(late)
    return [InputError(what, where=str(file), mend=mend) for what, mend in found.items()]


@contextmanager
def blaming(missed: Iterable[str]) -> Iterator[None]:
    """Let a refusal tell of the channels that were left out, which may well be why."""
    try:
        yield
    except InputError as error:
        if not (said := ", ".join(missed)):
            raise
        raise InputError(f"{error.what}; {said}", where=error.where, mend=error.mend) from error


def _split(entry: str) -> tuple[str, str]:
    name, _, reason = str(entry).partition(": ")
    return name, reason or _NO_NUMBERS


def _some(texts: Sequence[str], separator: str = ",") -> str:
    more = f" and {len(texts) - _SHOWN} more" if len(texts) > _SHOWN else ""
    return f"{separator} ".join(texts[:_SHOWN]) + more
