"""Many logs at once."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from roadstate.core import Estimates, InputError, Log
from roadstate.core.numerics import jit_loop
from roadstate.core.packing import Layout
from roadstate.estimators.base import Estimator
from roadstate.run.chunk import CHUNK, Row, cut, inputs, kept, scan_steps, start, to_estimates
from roadstate.run.scan import scan

_BUDGET = 512 * 2**20
_BUDGET_ELSEWHERE = 4 * 2**30  # a GPU goes through a thousand logs in the time of one
PER_PROCESSOR = 2
"""Threads for each processor: while one waits for XLA to take its program over, or to give it back, another's
runs."""
_ROW = 32  # numbers that a step's row may be taken to have, for the memory budget


def _scan_chunks(
    params: Any, static: Any, layout: Layout, states: Any, samples: Any, dt: Any, count: Any, alike: bool
) -> tuple[Any, Row]:
    """``count`` steps through a chunk of each log of a group: the single log's loop under ``vmap``.

    Parameters and states are ``alike`` for all logs, or have one row for each.
    """

    def one(own: Any, state: Any, values: Any, steps: Any) -> tuple[Any, Row]:
        return scan_steps(eqx.combine(own, static), layout, state, values, steps, count, kept)

    return jax.vmap(one, (None if alike else 0, 0, 0, 0))(params, states, samples, dt)


_compiled = jit_loop(_scan_chunks)


def batch(
    estimators: Estimator[Any] | Sequence[Estimator[Any]],
    logs: Sequence[Log],
    *,
    together: int | None = None,
    memory: int | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Estimates]:
    """Run an estimator over many logs, or over many seeds of one.

    Logs are taken in groups, which are shared among threads (a compiled loop holds no lock); within a group
    all logs advance together. On a CPU a group is a single log: one keeps a core as busy as many would, and
    the program is that of :func:`roadstate.run.scan` for a log as long as all of them. The numbers are
    those of ``scan``, to rounding.

    Args:
        estimators: one for all logs, or one for each (built alike: same channels, other parameters).
        logs: of any lengths; groups are of similar lengths.
        together: logs of a group; default 1 on a CPU, elsewhere as many as fit the memory budget.
        memory: bytes that the samples and rows of the chunks at work may take; default 512 MiB on a CPU,
            elsewhere 4 GiB.
        workers: threads; default :data:`PER_PROCESSOR` for each processor, and one where the work is not
            done on a CPU.
        progress: called with (logs done, logs) after every group.

    Raises:
        InputError: no logs, a number of estimators that differs from that of logs, estimators not built
            alike, or less than one log together or one thread.
    """
    if not logs:
        raise InputError("no logs to run over")
    for what, number in (("together", together), ("workers", workers)):
        if number is not None and number < 1:
            raise InputError(f"{what}: {number}", mend="give 1 or more, or None")
    each = [estimators] * len(logs) if isinstance(estimators, Estimator) else list(estimators)
    if len(each) != len(logs):
        raise InputError(f"{len(each)} estimators for {len(logs)} logs", mend="give one, or one for each log")
    kinds = [eqx.partition(e, eqx.is_array)[1] for e in each]
    if any(kind != kinds[0] for kind in kinds):
        raise InputError("the estimators are not built alike", mend="build them for the same channels")
    on_cpu = jax.default_backend() == "cpu"
    workers = min(workers or (PER_PROCESSOR * (os.cpu_count() or 1) if on_cpu else 1), len(logs))
    if memory is None:
        memory = _BUDGET if on_cpu else _BUDGET_ELSEWHERE
    per_log = CHUNK * (len(each[0].channels) + 1 + _ROW) * 8
    if together is None and on_cpu:
        together = 1
    fitting = max(1, min(memory // (per_log * workers), -(-len(logs) // workers)))
    size = int(min(together or fitting, fitting))
    among = sum(len(log) for log in logs)
    order = np.argsort([-len(log) for log in logs], kind="stable")
    groups = [order[i : i + size] for i in range(0, len(order), size)]

    def run(group: NDArray[np.int64]) -> list[Estimates]:
        # the last group is filled up, so that every group has the compiled shape
        members = np.resize(group, size)
        own = [each[int(i)] for i in members], [logs[int(i)] for i in members]
        return _run_group(*own, among)[: len(group)]

    results: dict[int, Estimates] = {}
    with ThreadPoolExecutor(workers) as pool:
        for group, estimates in zip(groups, pool.map(run, groups), strict=True):
            results |= {int(i): e for i, e in zip(group, estimates, strict=True)}
            if progress is not None:
                progress(len(results), len(logs))
    return [results[i] for i in range(len(logs))]


def _run_group(estimators: list[Estimator[Any]], logs: list[Log], among: int) -> list[Estimates]:
    """Run logs together, each to the end of the longest; ``among`` samples of all groups."""
    if len(logs) == 1:
        return [scan(estimators[0], logs[0], among=among)]
    alike = all(e is estimators[0] for e in estimators)
    arrays, static = eqx.partition(estimators[0], eqx.is_array)
    states, layout = start(estimators[0])
    if alike:
        params = arrays
        states = jax.tree.map(lambda leaf: np.broadcast_to(leaf, (len(logs), *leaf.shape)), states)
    else:
        # fetched all at once: one by one, from a GPU, takes longer than all the steps
        own = jax.device_get([(eqx.filter(e, eqx.is_array), start(e)[0]) for e in estimators])
        params, states = jax.tree.map(lambda *leaves: np.stack(leaves), *own)
    each = [inputs(e, log) for e, log in zip(estimators, logs, strict=True)]
    parts: list[Row] = []
    longest = max(len(one.samples) for one in each)
    for begin in range(0, longest, CHUNK):
        cuts = [cut(one.samples, one.dt, begin) for one in each]
        samples, dt = (np.stack(column) for column in zip(*cuts, strict=True))
        count = jnp.asarray(min(CHUNK, longest - begin))
        states, rows = _compiled(params, static, layout, states, samples, dt, count, alike)
        parts.append(jax.device_get(rows))
    whole = parts[0]
    if len(parts) > 1:
        whole = jax.tree.map(lambda *leaves: np.concatenate(leaves, axis=1), *parts)
    rows_of = [jax.tree.map(lambda leaf, i=i: leaf[i, each[i].own], whole) for i in range(len(logs))]
    return [to_estimates(*one) for one in zip(estimators, logs, rows_of, strict=True)]
