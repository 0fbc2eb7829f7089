"""Finding the one raw signal a mapping means."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from fnmatch import translate
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from roadstate.core import InputError, Signal

_MAX_SHOWN = 4
_MAX_NAME = 128  # characters of a raw name that patterns look at
_MAX_WORK = 30  # bits: a repeat tries up to 2^7 lengths of such a name, a choice two ways
_ESCAPE_OR_CLASS = re.compile(r"\\.|\[\^?\]?(?:\\.|[^\]\\])*\]", re.DOTALL)
_LAZY = re.compile(r"([*+?}])[?+]")


class Candidate(BaseModel):
    """One way to name a raw signal: exactly, by glob or by regex; optionally on one message or bus only.

    Attributes:
        signal: the exact name: the recording's key or its last part (``YawRate`` of ``ESP_02.YawRate``).
        glob: shell pattern (``*yaw*rate*``) over the whole key or its last part; ignores case.
        regex: regular expression that must match the whole key or its last part; heeds case.
        message: the bus message that must carry the signal.
        bus: the bus channel that must carry the signal.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    signal: str | None = Field(None, min_length=1, max_length=200)
    glob: str | None = Field(None, min_length=1, max_length=100)
    regex: str | None = Field(None, min_length=1, max_length=200)
    message: str | None = Field(None, min_length=1, max_length=200)
    bus: int | None = Field(None, ge=0)

    @model_validator(mode="after")
    def _one_kind(self) -> Candidate:
        if sum(kind is not None for kind in (self.signal, self.glob, self.regex)) != 1:
            raise InputError("a candidate needs exactly one of signal, glob, regex")
        return self

    @field_validator("regex")
    @classmethod
    def _safe_regex(cls, pattern: str | None) -> str | None:
        if pattern is not None:
            check_pattern(pattern)
        return pattern

    def __str__(self) -> str:
        kind = "glob" if self.glob else "regex" if self.regex else "signal"
        text = f"'{getattr(self, kind)}'" if kind == "signal" else f"{kind} '{getattr(self, kind)}'"
        text += f" in message '{self.message}'" if self.message is not None else ""
        return text + (f" on bus {self.bus}" if self.bus is not None else "")

    def matches(self, signals: Mapping[str, Signal]) -> list[str]:
        """Keys of the raw signals that fit; an exact key outranks last parts that are equal to it."""
        there = {k: s for k, s in signals.items() if self._is_carried_by(k, s)}
        if self.signal is not None:
            if self.signal in there:
                return [self.signal]
            return [k for k in there if self.signal in names_of(k)]
        text, flags = (translate(self.glob), re.IGNORECASE) if self.glob else (self.regex or "", 0)
        pattern = re.compile(text, flags)
        return [k for k in there if any(pattern.fullmatch(n[:_MAX_NAME]) for n in names_of(k))]

    def _is_carried_by(self, key: str, signal: Signal) -> bool:
        if self.bus is not None and signal.bus != self.bus:
            return False
        return self.message is None or self.message == (signal.message or message_of(key))


def as_candidate(value: Any) -> Any:
    """The long form of a candidate given as a bare text."""
    return {"signal": value} if isinstance(value, str) else value


def check_pattern(pattern: str) -> None:
    """Refuse a regular expression that is no such thing or could run for ages.

    A repeated group, or many repeats one behind the other, makes the time to fail grow without bound.

    Raises:
        InputError: says which rule it breaks.
    """
    try:
        re.compile(pattern)
    except (re.error, RecursionError, OverflowError) as error:
        raise InputError(f"regex '{pattern}' cannot be read ({error})") from error
    plain = _LAZY.sub(r"\1", _ESCAPE_OR_CLASS.sub("x", pattern)).replace("(?", "(")
    if re.search(r"\)[*+{]", plain):
        raise InputError(f"regex '{pattern}' repeats a group", mend="write the repeats out or use a glob")
    if 7 * len(re.findall(r"[*+{]", plain)) + len(re.findall(r"[?|]", plain)) > _MAX_WORK:
        raise InputError(
            f"regex '{pattern}' has too many repeats and choices", mend="use a glob or several candidates"
        )


def message_of(key: str) -> str | None:
    """The part of a key before its last dot, if any: the message of a decoded CAN signal."""
    head, dot, _ = key.split("@")[0].rpartition(".")
    return head if dot else None


def names_of(key: str) -> set[str]:
    """What a raw signal answers to: its key, and the last part of it, each with and without ``@bus``."""
    plain = key.split("@")[0]
    return {key, plain, key.rpartition(".")[2] if "." in plain else key, plain.rpartition(".")[2]}


def find(candidates: Iterable[Candidate], signals: Mapping[str, Signal]) -> str | None:
    """The key that the first candidate with a match matches; ``None`` where none has one.

    Raises:
        InputError: that candidate matches two or more signals.
    """
    for candidate in candidates:
        keys = candidate.matches(signals)
        if len(keys) == 1:
            return keys[0]
        if keys:
            shown = ", ".join(_described(k, signals[k]) for k in keys[:_MAX_SHOWN])
            more = f" and {len(keys) - _MAX_SHOWN} more" if len(keys) > _MAX_SHOWN else ""
            raise InputError(
                f"candidate {candidate} matches {len(keys)} signals: {shown}{more}",
                mend="two matches are an error, not a guess: give an exact name, or add 'message:' or 'bus:'",
            )
    return None


def not_found(
    candidates: Iterable[Candidate], signals: Mapping[str, Signal], skipped: Iterable[str] = ()
) -> InputError:
    """The error for candidates none of which is in the recording, with the closest raw names.

    Args:
        candidates: what was looked for.
        signals: what there is.
        skipped: what the reader left out, ``name`` or ``name: reason``.
    """
    tried = list(candidates)
    wanted = [c.signal or (c.glob or c.regex or "").strip("*^$.") for c in tried]
    for name, _, reason in (entry.partition(": ") for entry in skipped):
        if name in wanted:
            what = f"'{name}' is there, but was left out ({reason or 'no plain numbers'})"
            return InputError(what, mend="correct it, or name another signal")
    close = list(dict.fromkeys(k for w in wanted for k in _closest(w, signals)))[:_MAX_SHOWN]
    if close:
        mend = "closest: " + ", ".join(f"'{k}'" for k in close)
    elif len(signals) <= 12:
        mend = "the file has " + (", ".join(f"'{k}'" for k in signals) or "no signals")
    else:
        mend = "'roadstate channels FILE' lists the file's signals"
    return InputError(f"no signal matches {' or '.join(str(c) for c in tried)}", mend=f"{mend}")


def _closest(wanted: str, signals: Mapping[str, Signal]) -> list[str]:
    by_name: dict[str, str] = {}
    for key in signals:
        for name in sorted(names_of(key)):
            by_name.setdefault(name.lower(), key)
    close = difflib.get_close_matches(wanted.lower()[:_MAX_NAME], by_name, n=3, cutoff=0.55)
    return [by_name[c] for c in close]


def _described(key: str, signal: Signal) -> str:
    bus = f" (bus {signal.bus})" if signal.bus is not None and "@" not in key else ""
    return f"'{key}'{bus}"
