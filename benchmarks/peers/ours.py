"""roadstate's filters: a log in one compiled loop, many logs at once, and sample by sample."""

from __future__ import annotations

import os
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from benchmarks.peers.problems import Array, Problem, model
from benchmarks.peers.program import Program

from roadstate.core.kernel import one_kernel
from roadstate.core.numerics import jit_loop, loop_options
from roadstate.core.packing import Layout
from roadstate.filters import KF, UKF, Filter
from roadstate.filters.marginal import MarginalUKF
from roadstate.filters.particle import ParticleFilter
from roadstate.filters.weighted import deviations
from roadstate.run.batch import PER_PROCESSOR

LOGS = 256


def choose(problem: Problem, marginal: bool = False, seed: Any = 0) -> Filter[Any]:
    """The filter the problem asks for."""
    if marginal:
        return MarginalUKF()
    if problem.method == "pf":
        return ParticleFilter(particles=problem.particles, threshold=1.0, seed=seed)
    return KF() if problem.method == "kf" else UKF()


def _moments(filter_: Filter[Any], state: Any) -> Any:
    """Mean and standard deviations, side by side: as much as every implementation gives."""
    if isinstance(filter_, ParticleFilter):
        mean, spread = deviations(state.particles, state.log_weights)
        return jnp.concatenate([mean, jnp.sqrt(jnp.sum(spread**2, axis=1))])
    now = filter_.posterior(state)
    return jnp.concatenate([now.mean, now.std])


def _step(filter_: Filter[Any], system: Any, state: Any, row: Any, dt: Any) -> tuple[Any, Any]:
    m = len(system.sensors)
    state, _ = filter_.step(system, state, row[:-m], row[-m:], dt)
    return state, _moments(filter_, state)


def _scan(filter_: Filter[Any], system: Any, layout: Layout, packed: Any, rows: Any, dt: Any) -> Any:
    def body(state: Any, row: Any) -> tuple[Any, Any]:
        return _step(filter_, system, state, row, dt)

    return jax.lax.scan(body, layout.unpack(packed), rows)[1]


def _rows(problem: Problem, samples: Array) -> Array:
    inputs = np.broadcast_to(problem.inputs, (*samples.shape[:-1], problem.inputs.shape[-1]))
    return np.concatenate([inputs, samples], axis=-1)


def scan(problem: Problem, marginal: bool = False) -> Program:
    """The whole log in one compiled loop."""
    filter_, system = choose(problem, marginal), model(problem)
    state = filter_.init(system)
    layout = Layout(state)
    run = jit_loop(_scan)
    packed, rows = jax.block_until_ready((layout.pack(state), jnp.asarray(_rows(problem, problem.samples))))
    dt = jnp.asarray(problem.dt)

    def call() -> Any:
        return jax.block_until_ready(run(filter_, system, layout, packed, rows, dt))

    return Program(call, lambda out: np.asarray(out)[:, : len(problem.q)], problem.steps)


def batch(problem: Problem, marginal: bool = False, logs: int = LOGS) -> Program:
    """Many logs, as :func:`roadstate.run.batch` takes them: each by the loop of :func:`scan`, on every core.

    The first is the problem's own, the others have noise of their own.

    Args:
        problem: the log, and what to run.
        marginal: with :class:`~roadstate.filters.marginal.MarginalUKF`.
        logs: how many.
    """
    filter_, system = choose(problem, marginal), model(problem)
    random = np.random.default_rng(5)
    noise = random.standard_normal((logs, *problem.samples.shape)) * problem.r
    noise[0] = 0
    layout = Layout(filter_.init(system))

    def begin(seed: Any) -> Any:
        return layout.pack(choose(problem, marginal, seed).init(system))

    each = [
        (jax.jit(begin)(jnp.asarray(i)), jnp.asarray(row))
        for i, row in enumerate(_rows(problem, problem.samples + noise))
    ]
    each = jax.block_until_ready(each)
    run, dt = jit_loop(_scan), jnp.asarray(problem.dt)
    threads = PER_PROCESSOR * (os.cpu_count() or 1)
    pool = ThreadPoolExecutor(threads)

    def one(log: Any) -> Any:
        return jax.block_until_ready(run(filter_, system, layout, *log, dt))

    def call() -> list[Any]:
        return list(pool.map(one, each))

    note = f"{logs} logs of {problem.steps} samples, per step and log, shared by {threads} threads"
    return Program(call, lambda out: np.asarray(out[0])[:, : len(problem.q)], problem.steps, logs, note=note)


def stream(problem: Problem) -> Program:
    """One sample at a time, as :class:`roadstate.run.Stream` does it: a compiled step called from Python."""
    filter_, system = choose(problem), model(problem)
    state = filter_.init(system)
    layout = Layout(state)
    start = jax.block_until_ready(layout.pack(state))
    leaves, structure = jax.tree.flatten(eqx.filter((filter_, system), eqx.is_array))
    static = eqx.filter((filter_, system), eqx.is_array, inverse=True)
    rows = _rows(problem, problem.samples)
    rows = np.concatenate([np.full((len(rows), 1), problem.dt), rows], axis=1)

    def step(arrays: list[Any], packed: Any, row: Any) -> Any:
        own, what = eqx.combine(jax.tree.unflatten(structure, arrays), static)
        state, moments = _step(own, what, layout.unpack(packed), row[1:], row[0])
        return layout.pack(state), moments

    run = jax.jit(one_kernel(step), compiler_options=loop_options())

    def call() -> Any:
        packed, outs, times = start, [], []
        for row in rows:
            begin = time.perf_counter()
            packed, out = run(leaves, packed, row)
            outs.append(np.asarray(out))
            times.append(time.perf_counter() - begin)
        return np.stack(outs), np.array(times)

    return Program(
        call,
        lambda out: out[0][:, : len(problem.q)],
        problem.steps,
        latencies=lambda out: out[1],
        note="called from Python for each sample: the median step, the estimate read",
    )
