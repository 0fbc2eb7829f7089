"""What the options of ``roadstate simulate`` mean: figures that are off, faults."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from roadstate.core import InputError
from roadstate.core.channels import CHANNELS, did_you_mean

if TYPE_CHECKING:
    from roadstate.sim.sensors import Fault

_FAULT = "--fault"
_FORM = "KIND:CHANNEL[:START[:DURATION[:SIZE]]]"
_SIZED = ("spike", "drift", "time_jump")


def percents(given: Sequence[str]) -> dict[str, float]:
    """Figures of the car that are off, by name, in %.

    Args:
        given: as ``mass=10``.

    Raises:
        InputError: no such figure, or no number.
    """
    from inspect import signature

    from roadstate.sim.plant.mismatch import mismatched

    known = list(signature(mismatched).parameters)[1:]
    found = {}
    for word in given:
        name, _, percent = word.partition("=")
        if name not in known:
            raise InputError(
                f"no figure is called '{name}'", where="--mismatch", mend=did_you_mean(name, known)
            )
        found[name] = _number(percent, "--mismatch", f"write {name}=10 for 10 %")
    return found


def faults(given: Sequence[str], duration: float) -> list[Fault]:
    """Faults to put into the sensors.

    Args:
        given: as ``KIND:CHANNEL[:START[:DURATION[:SIZE]]]``; what is left empty is as by default.
        duration: of the drive, s.

    Raises:
        InputError: another form, no such kind or channel, no number, or a fault outside the drive.
    """
    return [_fault(word, duration) for word in given]


def _fault(word: str, duration: float) -> Fault:
    from roadstate.sim.sensors import Fault

    kind, _, rest = word.partition(":")
    channel, *numbers = rest.split(":")
    if not channel or len(numbers) > 3:
        raise InputError(
            f"'{word}' is no fault", where=_FAULT, mend=f"write {_FORM}, as dropout:yaw_rate:4:1"
        )
    named = dict(zip(("start", "duration", "size"), numbers, strict=False))
    figures = {
        name: _number(text, _FAULT, f"write seconds and a size in {_FORM}")
        for name, text in named.items()
        if text
    }
    try:
        fault = Fault(kind, channel, **figures)
    except InputError as error:
        raise InputError(f"{error.what} in '{word}'", where=_FAULT, mend=error.mend) from error
    if "size" in figures and kind not in _SIZED:
        raise InputError(f"a {kind} has no size", where=_FAULT, mend=f"end '{word}' with its duration")
    if "duration" in figures and kind == "time_jump":
        raise InputError(
            "a time_jump is for good",
            where=_FAULT,
            mend=f"write {kind}:{channel}:START::SIZE without duration",
        )
    measured = [n for n, c in CHANNELS.items() if n != "time" and not c.is_reference]
    if not any(fnmatchcase(name, channel) for name in measured):
        raise InputError(
            f"no measured channel is called '{channel}'", where=_FAULT, mend=did_you_mean(channel, measured)
        )
    if not 0 <= fault.start <= duration:
        raise InputError(
            f"'{word}' begins at {fault.start:g} s, the drive lasts from 0 to {duration:g} s",
            where=_FAULT,
            mend="give a start within it",
        )
    return fault


def _number(text: str, where: str, mend: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise InputError(f"'{text}' is no number", where=where, mend=mend) from error
