"""One estimator, one sample at a time, in time order or nearly so."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter, deque
from collections.abc import Mapping
from enum import IntEnum
from functools import lru_cache
from itertools import islice
from math import inf, isfinite, isnan, nan
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from numpy.typing import NDArray

from roadstate.core import InputError, channel
from roadstate.core.kernel import one_kernel
from roadstate.core.numerics import loop_options
from roadstate.core.packing import Layout
from roadstate.estimators.base import Estimate, Estimator
from roadstate.run.chunk import start, through
from roadstate.run.saved import Saved, load, save


class Arrival(IntEnum):
    """What became of a sample that was pushed."""

    NEW = 0
    """Later than all before it: the estimator moved on."""
    LATE = 1
    """Earlier than the newest, within the window: put in its place, the steps after it done again."""
    MERGED = 2
    """At the time of a sample already taken: joined to it, channel by channel."""
    DROPPED = 3
    """Earlier than the window reaches back: not used at all."""


class Step(NamedTuple):
    """A sample taken, and the packed state after it; before the first sample, time is NaN."""

    time: float
    values: list[float]
    state: dict[str, Any]


class _Program:
    """The compiled step of all estimators built alike.

    Parameters, state, sample (Δt first) and estimate go in and out as one vector per dtype, since every array
    handed over costs microseconds.

    Args:
        static: what of the estimator is no array.
        given: layout of what is.
        layout: of the state.
    """

    _told: Layout

    def __init__(self, static: Any, given: Layout, layout: Layout) -> None:
        def step(packed: dict[str, Any], state: dict[str, Any], row: Any) -> tuple[dict[str, Any], Any]:
            estimator = eqx.combine(given.unpack(packed), static)
            sample = {c: row[i] for i, c in enumerate(estimator.channels, 1)}
            new, _ = estimator.step(layout.unpack(state), sample, row[0])
            estimate = estimator.estimate(new)
            self._told = Layout(estimate)
            return layout.pack(new), self._told.pack(estimate)

        self._step = jax.jit(one_kernel(step), compiler_options=loop_options())

    def __call__(
        self, packed: dict[str, Any], state: dict[str, Any], row: NDArray[np.float64]
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """The packed state after a sample, and the packed estimate."""
        result: tuple[dict[str, Any], dict[str, Any]] = self._step(packed, state, row)
        return result

    def read(self, packed: dict[str, Any]) -> Estimate:
        """An estimate that a step told, in NumPy's numbers."""
        estimate: Estimate = self._told.unpack({kind: np.asarray(v) for kind, v in packed.items()})
        return estimate


_program = lru_cache(maxsize=64)(_Program)


@eqx.filter_jit
def _read(estimator: Estimator[Any], layout: Layout, state: dict[str, Any]) -> Estimate:
    return estimator.estimate(layout.unpack(state))


class Stream:
    """An estimator fed one sample at a time; gives the numbers that :func:`scan` gives on the same samples.

    With a window, samples may come late, or in parts (each channel by itself, as from a bus): one whose time
    lies up to ``window`` before the newest is put in its place, and the steps after it are done again from
    the state saved there (fixed-lag rewind). State and estimate are then, bit for bit, those of a stream to
    which all came in order and whole. The cost is a step for every sample redone.

    - A sample at the time of one already taken is joined to it. What is missing or not finite in it leaves
      the other's values; a value for a channel that has one already takes its place (the one that comes last
      counts) and, if it differs, is counted in ``replaced``.
    - A sample before the window is dropped: ``arrival`` is then ``DROPPED`` and ``counts`` goes up.
    - A clock that is set back makes all that follows late; such a drive wants a new stream.

    Args:
        estimator: built for the channels that will come.
        window: s that a sample may lag behind the newest; 0 only joins samples of the same time; ``None``
            refuses any whose time does not increase.
        capacity: samples of the window kept at most, each with the state after it; where the window holds
            more, it reaches back less. It bounds memory, and the steps that a late sample can cost.

    Raises:
        InputError: a window or capacity that is none.
    """

    def __init__(
        self, estimator: Estimator[Any], *, window: float | None = None, capacity: int = 1000
    ) -> None:
        if window is not None and not (_is_number(window) and 0 <= float(window) < inf):
            raise InputError(f"a window of {window} s", mend="give a finite time of 0 s or more, or None")
        if capacity < 1:
            raise InputError(f"a capacity of {capacity} samples", mend="give 1 or more")
        self._estimator, self._window, self._capacity = estimator, window, capacity
        params, static = eqx.partition(estimator, eqx.is_array)
        packed, self._layout = start(estimator)
        given = Layout(params)
        self._parameters, self._step = given.pack(params), _program(static, given, self._layout)
        self._known = set(estimator.channels)  # names that have been looked up, since that takes longer
        self._base = Step(nan, [], packed)
        self._steps: deque[Step] = deque()
        self._estimate: Estimate | None = None
        self.arrival: Arrival | None = None
        """What became of the last sample pushed; ``None`` before the first."""
        self.counts: Counter[Arrival] = Counter()
        """How many samples have arrived in each way."""
        self.replaced = 0
        """How many values another, different one for the same channel and time has taken the place of."""

    @property
    def time(self) -> float | None:
        """Time (s) of the newest sample; ``None`` before the first. Setting it empties the window."""
        newest = self._head.time
        return None if isnan(newest) else newest

    @time.setter
    def time(self, time: float | None) -> None:
        self._set(self._head._replace(time=nan if time is None else time))

    @property
    def state(self) -> dict[str, Any]:
        """All the estimator remembers, one vector per dtype; with ``time`` it may be kept and put back.

        Setting it empties the window; :meth:`save` keeps that too.

        Raises:
            InputError: when set, to one that another estimator remembers.
        """
        return self._head.state

    @state.setter
    def state(self, state: dict[str, Any]) -> None:
        own, given = ({kind: np.shape(v) for kind, v in s.items()} for s in (self.state, state))
        if own != given:
            raise InputError("the state of another estimator", mend=f"give vectors of {own}")
        self._set(self._head._replace(state=state))

    def push(self, time: float, sample: Mapping[str, float]) -> Estimate:
        """Take one sample.

        Args:
            time: in s.
            sample: canonical channel → value in SI; what is absent or NaN is missing, and channels that the
                estimator does not use are passed over.

        Returns:
            The estimate at the newest time, this sample included unless it was dropped (see ``arrival``).

        Raises:
            InputError: time is not finite, or without a window does not increase; a name is no canonical
                channel, or a value no number. The stream is then as it was.
        """
        newest, values = self.time, self._values(sample)
        try:
            time = float(time)
        except (TypeError, ValueError) as error:
            raise InputError(f"sample at {time!r}: not a time", mend="give seconds") from error
        if not isfinite(time):
            raise InputError(f"sample at {time} s", mend="give a finite time in s")
        if newest is None or time > newest:
            step, told = self._advance(self._head, time, values)
            self._estimate = self._step.read(told)
            self._steps.append(step)
            self._forget()
            arrival = Arrival.NEW
        elif self._window is None:
            raise InputError(
                f"sample at {time} s does not come after {newest} s",
                mend="push in time order, or give the stream a window",
            )
        elif time < newest - self._window or time <= self._base.time:
            arrival = Arrival.DROPPED
        else:
            arrival = self._rewind(time, values)
        self.arrival = arrival
        self.counts[arrival] += 1
        if self._estimate is None:  # nothing has been stepped since the state was put back
            self._estimate = _read(self._estimator, self._layout, self.state)
        return self._estimate

    def save(self, path: str | Path) -> Path:
        """Write all that :meth:`restore` needs to go on bit for bit: state, window and counts.

        Args:
            path: an ``.npz`` file by convention; it appears whole or not at all.

        Raises:
            InputError: the folder does not exist or cannot be written.
        """
        steps = [self._base, *self._steps]
        saved = Saved(
            time=np.array([s.time for s in steps]),
            values=np.array([s.values for s in self._steps]).reshape(-1, len(self._estimator.channels)),
            states={kind: np.stack([np.asarray(s.state[kind]) for s in steps]) for kind in self.state},
            counts=np.array([*(self.counts[a] for a in Arrival), self.replaced], np.int64),
        )
        return save(path, self._estimator, saved)

    def restore(self, path: str | Path) -> None:
        """Go on where a stream of the same estimator was saved.

        Window and capacity stay this stream's own; what of the file's window lies beyond them is left out.

        Args:
            path: what :meth:`save` wrote.

        Raises:
            InputError: no such file, not one of a stream, or saved from another estimator. The stream is then
                as it was.
        """
        sizes = {kind: vector.shape[0] for kind, vector in self.state.items()}
        saved = load(path, self._estimator, sizes, len(Arrival) + 1)
        packed = [{kind: v[i] for kind, v in saved.states.items()} for i in range(len(saved.time))]
        first, *times = saved.time.tolist()
        self._set(Step(first, [], packed[0]))
        self._steps.extend(map(Step, times, saved.values.tolist(), packed[1:]))
        self._forget()
        *counts, self.replaced = saved.counts.tolist()
        self.counts = Counter(dict(zip(Arrival, counts, strict=True)))
        self.arrival = None

    @property
    def _head(self) -> Step:
        return self._steps[-1] if self._steps else self._base

    def _set(self, base: Step) -> None:
        self._base, self._estimate = base, None
        self._steps.clear()

    def _values(self, sample: Mapping[str, float]) -> list[float]:
        channels = self._estimator.channels
        if not isinstance(sample, Mapping):
            raise InputError(f"a sample that is {sample!r}", mend="give channels with their values")
        if not sample.keys() <= self._known:
            self._known.update(channel(str(name)).name for name in sample if name not in self._known)
        try:
            return [float(sample.get(c, nan)) for c in channels]
        except (TypeError, ValueError) as error:
            wrong = next(c for c in channels if not _is_number(sample.get(c, nan)))
            raise InputError(f"{sample[wrong]!r} is no number", where=wrong, mend="leave it out") from error

    def _advance(self, before: Step, time: float, values: list[float]) -> tuple[Step, dict[str, Any]]:
        state, *steps = before.state, *through(0.0 if isnan(before.time) else time - before.time)
        missing = [nan] * len(values)
        for dt in steps[:-1]:
            state, _ = self._step(self._parameters, state, np.array([dt, *missing]))
        state, told = self._step(self._parameters, state, np.array([steps[-1], *values]))
        return Step(time, values, state), told

    def _rewind(self, time: float, values: list[float]) -> Arrival:
        """Put a sample in its place, and do again what came after it."""
        place = bisect_left(self._steps, time, key=lambda step: step.time)
        replaced, arrival = 0, Arrival.LATE
        rest = list(islice(self._steps, place, None))
        if rest and rest[0].time == time:
            old, arrival = rest.pop(0).values, Arrival.MERGED
            replaced = sum(isfinite(b) and isfinite(a) and a != b for a, b in zip(old, values, strict=True))
            values = [b if isfinite(b) else a for a, b in zip(old, values, strict=True)]
            if np.array_equal(old, values, equal_nan=True):
                return arrival
        told: dict[str, Any] = {}
        redone = [self._steps[place - 1] if place else self._base]
        for at, what in [(time, values), *((step.time, step.values) for step in rest)]:
            step, told = self._advance(redone[-1], at, what)
            redone.append(step)
        self._steps = deque([*islice(self._steps, place), *redone[1:]])
        self._estimate = self._step.read(told)
        self.replaced += replaced
        self._forget()
        return arrival

    def _forget(self) -> None:
        """Let go of steps that no sample can be put before."""
        reach = inf if self._window is None else self._head.time - self._window
        while self._steps and (self._steps[0].time < reach or len(self._steps) > self._capacity):
            self._base = self._steps.popleft()


def _is_number(value: Any) -> bool:
    try:
        float(value)
    except (TypeError, ValueError):
        return False
    return True
