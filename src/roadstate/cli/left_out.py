"""What readers left out of a log, in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from roadstate.core import CHANNELS, InputError

if TYPE_CHECKING:
    from roadstate import io

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


def missed_channels(metadata: Mapping[str, Any], mapping: io.Mapping) -> list[str]:
    """Canonical channels that a log would have but for what could not be read, in words.

    Args:
        metadata: of what the mapping has made.
        mapping: names that it takes from elsewhere, or ignores, are not missed.
    """
    listed = {*mapping.channels, *mapping.reference}
    missed = []
    for name, reason in map(_split, metadata.get("skipped", ())):
        is_wanted = name in listed or not mapping.only_listed
        is_taken = metadata["sources"].get(name, [name]) != [name]
        if name in CHANNELS and name != "time" and is_wanted and not is_taken:
            missed.append(f"{name} was left out ({reason})")
    return missed


@contextmanager
def blaming(missed: Sequence[str]) -> Iterator[None]:
    """Let a refusal tell of the channels that were left out, which may well be why."""
    try:
        yield
    except InputError as error:
        if not missed:
            raise
        raise InputError(f"{error.what}; {', '.join(missed)}", where=error.where, mend=error.mend) from error


def _split(entry: str) -> tuple[str, str]:
    name, _, reason = str(entry).partition(": ")
    return name, reason or _NO_NUMBERS


def _some(texts: Sequence[str], separator: str = ",") -> str:
    more = f" and {len(texts) - _SHOWN} more" if len(texts) > _SHOWN else ""
    return f"{separator} ".join(texts[:_SHOWN]) + more
