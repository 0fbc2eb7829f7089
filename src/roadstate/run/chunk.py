"""What scan, batch and stream share: one step, its packed state, and the compiled loop over a chunk."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import NDArray

from roadstate import __version__
from roadstate.core import Estimates, InputError, Log
from roadstate.core.gaussian import Gate, Info, Reason
from roadstate.core.halves import two_kernels
from roadstate.core.numerics import jit_loop
from roadstate.core.packing import Layout
from roadstate.core.traced import returned
from roadstate.estimators.base import SILENT_STEP, Estimate, Estimator

R = TypeVar("R")
C = TypeVar("C")

CHUNK = 2048
"""Samples a compiled loop takes at once: any log runs through such a program, padded at its end.

So many that starting the program costs little beside its steps, so few that a short log does not wait long
for its padding.
"""


LONGEST_BREAK = 300.0
"""Seconds between two samples for which an estimator goes on with what it knew.

A longer break counts as one of this length: the road is another one by then, and what may have changed
besides, nobody saw. A model that is carried on over hours in a single step says nothing, and may overflow.
"""


BREAK = 5.0
"""Seconds between two samples beyond which an estimator goes through the time between without any.

In one step it would take what it last heard for what went on all the while. A log with a sample every few
seconds has no breaks, but a low rate.
"""
_LISTENS = 5  # of the first steps through a break, until all is stale; then each is twice as long
_LAST = 0.02  # s: of the one that leads to the sample


@returned
class Heard(NamedTuple):
    """What came of one step's samples, by sensor."""

    innovation: Float[Array, " m"]
    innovation_std: Float[Array, " m"]
    nis: Float[Array, ""]
    gate: Int[Array, " m"]


@returned
class Row(NamedTuple):
    """What one step leaves behind."""

    estimate: Estimate
    heard: Heard


def heard(info: Info) -> Heard:
    """Of what a filter told of a step, what is kept."""
    used = jnp.isfinite(info.innovation) & (info.gate != Gate.REJECTED)
    updated = info.ok & (info.reason != Reason.NO_MEASUREMENT) & jnp.any(used)
    nis = jnp.where(updated, info.nis, jnp.nan)
    return Heard(info.innovation, jnp.sqrt(jnp.diagonal(info.S)), nis, info.gate)


def kept(estimator: Estimator[Any], state: Any, info: Info) -> Row:
    """What a step leaves behind."""
    return Row(estimator.estimate(state), heard(info))


@eqx.filter_jit
def start(estimator: Estimator[Any]) -> tuple[dict[str, Any], Layout]:
    """The packed state before the first sample, and how it unpacks."""
    state = estimator.init()
    layout = Layout(state)
    return layout.pack(state), layout


def scan_steps(
    estimator: Estimator[Any],
    layout: Layout,
    packed: dict[str, Array],
    samples: Float[Array, "k c"],
    dt: Float[Array, " k"],
    count: Int[Array, ""] | int,
    keep: Callable[[Estimator[Any], Any, Info], R],
    *,
    apart: bool = False,
) -> tuple[dict[str, Array], R]:
    """``count`` steps through a chunk: the packed state after them, and of each what is to be kept.

    Rows beyond ``count`` are zero. Where steps are to stand ``apart``, each is a kernel or two of its own,
    with one vector per dtype going in and out.
    """

    def one(estimator: Estimator[Any], state: Any, samples: Array, dt: Array, i: Any) -> tuple[Any, R]:
        sample = {c: samples[i, column] for column, c in enumerate(estimator.channels)}
        state, info = estimator.step(state, sample, dt[i])
        return state, keep(estimator, state, info)

    if not apart:
        unpacked = layout.unpack(packed)
        state, rows = _steps(lambda s, i: one(estimator, s, samples, dt, i), unpacked, len(dt), count)
        return layout.pack(state), rows

    row: Layout

    @two_kernels
    def kernel(estimator: Estimator[Any], packed: Any, samples: Array, dt: Array, i: Any) -> tuple[Any, Any]:
        nonlocal row
        state, told = one(estimator, layout.unpack(packed), samples, dt, i)
        row = Layout(told)
        return layout.pack(state), row.pack(told)

    packed, packed_rows = _steps(lambda p, i: kernel(estimator, p, samples, dt, i), packed, len(dt), count)
    return packed, row.unpack(packed_rows)


def _steps(
    step: Callable[[C, Any], tuple[C, R]], carry: C, length: int, count: Int[Array, ""] | int
) -> tuple[C, R]:
    """Calls of ``step(carry, i)`` for ``count`` i: the last carry, and ``length`` rows."""
    begin = jnp.zeros((), int)
    step = eqx.filter_closure_convert(step, carry, begin)  # traced once, for the shapes and for the loop
    shapes = step.out_struct[1]  # type: ignore[attr-defined]
    rows = jax.tree.map(lambda one: jnp.zeros((length, *one.shape), one.dtype), shapes)

    def body(i: Any, work: tuple[C, R]) -> tuple[C, R]:
        carry, row = step(work[0], i)
        put = jax.lax.dynamic_update_index_in_dim
        return carry, jax.tree.map(lambda rows, new: put(rows, new, i, axis=0), work[1], row)

    return cast("tuple[C, R]", jax.lax.fori_loop(begin, count, body, (carry, rows)))


SHORT = 30_000
"""Samples up to which whoever waits for a run waits for the compiler.

A loop that is one kernel takes twice as long to compile as one whose steps are kernels, since what a compiler
does to one of the many small loops in a step it does within all that is around it, and more than twice as
long where a step is two kernels, compiled side by side. Steps of their own take a third longer.
"""

_WHOLE = jit_loop(scan_steps, kept=True)
_APART = jit_loop(partial(scan_steps, apart=True), whole=False, kept=True)


def steps_through(total: int) -> Callable[..., Any]:
    """The compiled :func:`scan_steps` for a run of so many samples."""
    return _APART if total <= SHORT else _WHOLE


class Inputs(NamedTuple):
    """What an estimator goes through with a log of T samples.

    Attributes:
        samples: (T', c) of the estimator's channels, NaN where there is none.
        dt: (T',) steps, s.
        own: (T,) rows of the log's samples among them; the others are within breaks.
    """

    samples: NDArray[np.float64]
    dt: NDArray[np.float64]
    own: NDArray[np.int64]


def through(gap: float) -> list[float]:
    """Steps in s, at least one, that lead from a sample to the next one, ``gap`` s later.

    All but the last have no sample; there are some fifteen in the longest break, which takes no more than
    :data:`LONGEST_BREAK`.
    """
    if gap <= BREAK:
        return [gap]
    steps: list[float] = []
    left = min(gap, LONGEST_BREAK) - _LAST
    while left > 0:
        longest = SILENT_STEP * 2.0 ** max(len(steps) - _LISTENS + 1, 0)
        steps.append(left if left < 1.5 * longest else longest)
        left -= steps[-1]
    return [*steps, _LAST]


def inputs(estimator: Estimator[Any], log: Log) -> Inputs:
    """What the estimator goes through.

    Raises:
        InputError: what should be a log is none.
    """
    if not isinstance(log, Log):
        raise InputError(f"a log that is a {type(log).__name__}", mend="give a Log(time, {channel: values})")
    missing = np.full(len(log), np.nan)
    heard = np.stack([log.channels.get(c, missing) for c in estimator.channels], axis=1)
    dt = np.diff(log.time, prepend=log.time[0])
    breaks = np.flatnonzero(dt > BREAK)
    steps = [through(float(gap)) for gap in dt[breaks]]
    counts = np.ones(len(log), np.int64)
    counts[breaks] = [len(one) for one in steps]
    own = np.cumsum(counts) - 1
    samples = np.full((own[-1] + 1, heard.shape[1]), np.nan)
    samples[own] = heard
    within = np.zeros(len(samples))
    within[own] = dt
    for at, one in zip(own[breaks], steps, strict=True):
        within[at + 1 - len(one) : at + 1] = one
    return Inputs(samples, within, own)


def cut(
    samples: NDArray[np.float64], dt: NDArray[np.float64], begin: int, length: int = CHUNK
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """``length`` rows from row ``begin`` on, filled up with missing samples that take no time."""
    part = samples[begin : begin + length]
    values, steps = np.full((length, samples.shape[1]), np.nan), np.zeros(length)
    values[: len(part)], steps[: len(part)] = part, dt[begin : begin + length]
    return values, steps


def faults_found(
    names: tuple[str, ...], faults: NDArray[np.bool_] | None, time: NDArray[np.float64]
) -> list[dict[str, Any]]:
    """Those that occur, in the order in which they begin: what, first and last time (s), share of samples."""
    if faults is None:
        return []
    found = []
    for i in np.flatnonzero(faults.any(axis=0)):
        when = time[faults[:, i]]
        share = float(np.mean(faults[:, i]))
        found.append(
            {"fault": names[i], "first_s": float(when[0]), "last_s": float(when[-1]), "share": share}
        )
    return sorted(found, key=lambda one: one["first_s"])


def _faults(rows: Row) -> NDArray[np.bool_] | None:
    return None if rows.estimate.faults is None else np.asarray(rows.estimate.faults, dtype=bool)


def to_estimates(estimator: Estimator[Any], log: Log, rows: Row) -> Estimates:
    """Rows of a whole log as estimates."""

    def host(tree: Mapping[str, Any]) -> dict[str, NDArray[np.float64]]:
        return {k: np.asarray(v, dtype=np.float64) for k, v in tree.items()}

    told = rows.heard
    refused = (np.asarray(told.gate) == Gate.REJECTED).sum(axis=0)
    return Estimates(
        time=log.time,
        values=host(rows.estimate.values),
        std=host(rows.estimate.std),
        validity=np.asarray(rows.estimate.validity, dtype=np.int8),
        sensors=tuple(estimator.sensors),
        innovation=np.asarray(told.innovation, dtype=np.float64),
        innovation_std=np.asarray(told.innovation_std, dtype=np.float64),
        nis=np.asarray(told.nis, dtype=np.float64),
        metadata={
            "estimator": estimator.name,
            "roadstate": __version__,
            "jax": jax.__version__,
            "rejected": {s: int(n) for s, n in zip(estimator.sensors, refused, strict=True)},
            "faults": faults_found(estimator.fault_names, _faults(rows), log.time),
            "log": dict(log.metadata),
        },
        sensor_units=dict(estimator.sensor_units),
    )
