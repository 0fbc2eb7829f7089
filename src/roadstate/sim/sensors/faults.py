"""Faults to put into a recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from roadstate.core import InputError, Recording, Signal
from roadstate.core.channels import did_you_mean

Array = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong with signals for a while.

    Attributes:
        kind: ``dropout`` (no samples), ``stuck`` (the last value before), ``spike`` (single samples off by
            ±``size``, ``spikes_per_second`` of them), ``drift`` (``size`` per second), ``sign`` (swapped),
            ``time_jump`` (time stamps from ``start`` on are off by ``size`` s, for good).
        channel: name, or a pattern such as ``wheel_speed_*`` or ``*``; references are never touched.
        start: s.
        duration: s.
        size: in the signal's unit, unless the kind says otherwise.
        spikes_per_second: mean number of spikes.
    """

    kind: str
    channel: str
    start: float = 0.0
    duration: float = np.inf
    size: float = 1.0
    spikes_per_second: float = 1.0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"no fault is called '{self.kind}'", mend=did_you_mean(self.kind, KINDS))
        numbers = (self.start, self.size, self.spikes_per_second)
        if not np.isfinite(numbers).all() or not self.duration > 0 or self.spikes_per_second < 0:
            raise InputError(
                f"a fault '{self.kind}' with impossible figures", mend="check start and duration"
            )


def inject(recording: Recording, faults: Sequence[Fault], seed: int = 0) -> Recording:
    """The recording with faults, one after the other.

    Args:
        recording: signals by name; what is stored there stays.
        faults: in the order in which they act.
        seed: of the spikes.

    Raises:
        InputError: a fault names no signal of the recording.
    """
    signals = dict(recording.signals)
    for number, fault in enumerate(faults):
        hit = [n for n in signals if not n.startswith("ref_") and fnmatchcase(n, fault.channel)]
        if not hit:
            raise InputError(
                f"no signal '{fault.channel}' for a fault", mend=did_you_mean(fault.channel, signals)
            )
        for name in hit:
            signal = signals[name]
            during = (signal.time >= fault.start) & (signal.time < fault.start + fault.duration)
            rng = np.random.default_rng([seed, number, crc32(name.encode())])
            signals[name] = KINDS[fault.kind](fault, signal, during, rng)
    described = [{**vars(f), "duration": min(f.duration, 1e9)} for f in faults]
    return Recording(signals, {**recording.metadata, "faults": described} if faults else recording.metadata)


def _dropout(fault: Fault, signal: Signal, during: NDArray[np.bool_], rng: np.random.Generator) -> Signal:
    return replace(signal, time=signal.time[~during], values=signal.values[~during])


def _stuck(fault: Fault, signal: Signal, during: NDArray[np.bool_], rng: np.random.Generator) -> Signal:
    if not during.any():
        return signal
    last = max(int(np.argmax(during)) - 1, 0)
    return replace(signal, values=np.where(during, signal.values[last], signal.values))


def _spike(fault: Fault, signal: Signal, during: NDArray[np.bool_], rng: np.random.Generator) -> Signal:
    chance = fault.spikes_per_second / max(signal.rate, 1e-9)
    hit = during & (rng.uniform(size=len(signal)) < chance)
    sign = rng.choice([-1.0, 1.0], size=len(signal))
    return replace(signal, values=signal.values + np.where(hit, fault.size * sign, 0.0))


def _drift(fault: Fault, signal: Signal, during: NDArray[np.bool_], rng: np.random.Generator) -> Signal:
    gone = np.where(during, signal.time - fault.start, 0.0)
    return replace(signal, values=signal.values + fault.size * gone)


def _sign(fault: Fault, signal: Signal, during: NDArray[np.bool_], rng: np.random.Generator) -> Signal:
    return replace(signal, values=np.where(during, -signal.values, signal.values))


def _time_jump(fault: Fault, signal: Signal, during: NDArray[np.bool_], rng: np.random.Generator) -> Signal:
    return replace(signal, time=np.where(signal.time >= fault.start, signal.time + fault.size, signal.time))


KINDS: Mapping[str, Callable[..., Signal]] = {
    "dropout": _dropout,
    "stuck": _stuck,
    "spike": _spike,
    "drift": _drift,
    "sign": _sign,
    "time_jump": _time_jump,
}
"""The faults there are."""
