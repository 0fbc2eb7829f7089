"""Time the implementations of one problem in turns, and hold them against the plain loops."""

from __future__ import annotations

import gc
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from benchmarks.peers.implementations import Size
from benchmarks.peers.problems import Array, Problem
from benchmarks.peers.program import Program
from benchmarks.peers.reference import particle, reference

Row = dict[str, Any]
"""What one implementation did: its keys are explained in :func:`measure`."""


class Truth(NamedTuple):
    """What means are held against.

    Attributes:
        means: (T, n).
        sampling_error: greatest difference of ten runs of the plain loop with as many particles as are timed;
            ``None`` where nothing is drawn.
    """

    means: Array
    sampling_error: float | None = None


def truth(problem: Problem, size: Size) -> Truth:
    """The plain loop's means; for particles, those of very many over the first samples."""
    if problem.method != "pf":
        return Truth(reference(problem)[0])
    first = problem.first(size.compared)
    means = particle(first, size.many, seed=1)[0]
    runs = [particle(first, seed=seed)[0] for seed in range(2, 12)]
    return Truth(means, float(np.abs(np.stack(runs) - means).max()))


class _Call(NamedTuple):
    """What a call took, μs per step and log, of wall and of processor time; and of each single step."""

    wall: float
    cpu: float
    single: Array | None


_TURN, _CALLS = 0.05, 10


def _call(program: Program) -> tuple[_Call, Any]:
    gc.collect()
    cpu, wall = time.process_time(), time.perf_counter()
    out = program.call()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    scale = 1e6 / (program.steps * program.logs)
    single = None if program.latencies is None else program.latencies(out) * 1e6
    return _Call(wall * scale if single is None else float(np.median(single)), cpu * scale, single), out


def _turn(program: Program) -> list[_Call]:
    """Calls until the turn's 50 ms are over, so that short ones are not told by a single one."""
    calls, begin = [_call(program)[0]], time.perf_counter()
    while time.perf_counter() - begin < _TURN and len(calls) < _CALLS:
        calls.append(_call(program)[0])
    return calls


def measure(programs: Mapping[str, Program], against: Truth, repeats: int) -> dict[str, Row]:
    """Name → figures of each implementation.

    The first calls come one after another, then ``repeats`` rounds over all implementations, so that what
    else the machine does falls on all of them alike.

    - ``us_per_step``: median over all calls of the time per sample and log, μs; where each step is a call of
      its own, of the median step. ``us_per_step_min`` the least, ``cpu_us_per_step`` the median processor
      time of all threads.
    - ``ratio_to_c``: median over the rounds of the ratio to C in the same round, least call to least call.
    - ``first_call_s``: what the first call took, compiling included, s.
    - ``p99_us``: of the single steps, where there are such.
    - ``max_abs_diff``: greatest difference of a mean from ``against``, ``null`` with a ``why_not`` where that
      cannot be told; ``sampling_error`` that of the plain loop with as many particles.
    - ``steps``, ``logs``: what one call runs over. ``note``: what has to be known.
    """
    rows: dict[str, Row] = {}
    for name, program in programs.items():
        begin = time.perf_counter()
        try:
            out = program.call()
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            rows[name] = {"us_per_step": None, "first_call_s": None, "max_abs_diff": None}
            rows[name]["why_not"] = f"it stopped: {error}"
            continue
        spent = time.perf_counter() - begin
        rows[name] = {"us_per_step": None, "first_call_s": spent} | _compared(program.means(out), against)
    alive = {name: programs[name] for name, row in rows.items() if row["first_call_s"] is not None}
    turns = [{name: _turn(program) for name, program in alive.items()} for _ in range(repeats)]
    for name, program in alive.items():
        calls, row = [call for turn in turns for call in turn[name]], rows[name]
        row["us_per_step"] = float(np.median([call.wall for call in calls]))
        row["us_per_step_min"] = min(call.wall for call in calls)
        row["cpu_us_per_step"] = float(np.median([call.cpu for call in calls]))
        if "c" in alive:
            row["ratio_to_c"] = float(np.median([_least(turn[name]) / _least(turn["c"]) for turn in turns]))
        single = [call.single for call in calls if call.single is not None]
        if single:
            row["p99_us"] = float(np.percentile(np.concatenate(single), 99))
        row |= {"steps": program.steps, "logs": program.logs}
        if program.note:
            row["note"] = program.note
    return rows


def _least(calls: list[_Call]) -> float:
    return min(call.wall for call in calls)


def _compared(means: Array, against: Truth) -> Row:
    count = min(len(means), len(against.means))
    if not np.isfinite(means).all():
        return {"max_abs_diff": None, "why_not": "its means are not finite"}
    row: Row = {"max_abs_diff": float(np.abs(means[:count] - against.means[:count]).max())}
    return row if against.sampling_error is None else row | {"sampling_error": against.sampling_error}
