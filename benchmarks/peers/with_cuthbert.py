"""cuthbert: its Kalman filter, its moments filter with unscented quadrature, its particle filter."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from benchmarks.peers.problems import Problem
from benchmarks.peers.program import Program
from benchmarks.peers.reference import linear_system
from cuthbert import filter as run_filter
from cuthbert.gaussian import kalman, moments
from cuthbert.smc import particle_filter
from cuthbertlib.quadrature.linearize import functional
from cuthbertlib.quadrature.unscented import weights
from cuthbertlib.resampling import systematic

_NOTES = {
    "kf": "run in sequence, not in parallel over time, which on a processor is slower",
    "ukf": "its moments filter, linearised by its unscented quadrature; noise added after that, since the "
    "quadrature counts it Σw_c = 3 times",
    "pf": "its step in a scan that keeps the moments, not the particles",
}


def program(problem: Problem) -> Program:
    """Its jitted scan over the log."""
    build: dict[str, Callable[[Problem], Any]] = {"kf": _kalman, "ukf": _unscented, "pf": _particle}
    run = jax.jit(build[problem.method](problem))
    rows = jnp.asarray(problem.inputs), jnp.asarray(problem.samples)

    def call() -> Any:
        return jax.block_until_ready(run(*rows))

    return Program(call, lambda out: np.asarray(out[0]), problem.steps, note=_NOTES[problem.method])


def _run(filter_: Any, inputs: Any, samples: Any) -> Any:
    states = run_filter(filter_, (inputs, samples), filter_.init_prepare())
    return states.mean[1:], jnp.sqrt(jnp.sum(states.chol_cov[1:] ** 2, axis=2))


def _kalman(problem: Problem) -> Callable[[Any, Any], Any]:
    F, B, H = (jnp.asarray(a) for a in linear_system(problem))
    zero = jnp.zeros(len(problem.r))

    def run(inputs: Any, samples: Any) -> Any:
        filter_ = kalman.build_filter(
            jnp.asarray(problem.mean),
            jnp.diag(problem.std),
            lambda row: (F, B @ row[0], jnp.diag(problem.q)),
            lambda row: (H, zero, jnp.diag(problem.r), row[1]),
        )
        return _run(filter_, inputs, samples)

    return run


def _unscented(problem: Problem) -> Callable[[Any, Any], Any]:
    n = len(problem.q)
    quadrature = weights(n, alpha=1.0, beta=2.0, kappa=0.0)

    def linear(function: Any, std: Any, state: Any) -> Any:
        cov = state.chol_cov @ state.chol_cov.T
        A, b, rest = functional(function, jnp.zeros((len(std),) * 2), state.mean, cov, quadrature)
        noise = jnp.linalg.cholesky(rest + jnp.diag(std**2))
        return lambda x: (A @ x + b, noise)

    def dynamics(state: Any, row: Any) -> Any:
        return linear(lambda x: problem.f(jnp, x, row[0], problem.dt), problem.q, state), state.mean

    def sensors(state: Any, row: Any) -> Any:
        return linear(lambda x: problem.h(jnp, x, row[0]), problem.r, state), state.mean, row[1]

    def run(inputs: Any, samples: Any) -> Any:
        filter_ = moments.build_filter(
            jnp.asarray(problem.mean), jnp.diag(problem.std), dynamics, sensors, associative=False
        )
        return _run(filter_, inputs, samples)

    return run


def _particle(problem: Problem) -> Callable[[Any, Any], Any]:
    n = len(problem.q)

    def prior(key: Any) -> Any:
        return problem.mean + problem.std * jax.random.normal(key, (n,))

    def propagate(key: Any, x: Any, row: Any) -> Any:
        return problem.f(jnp, x, row[0], problem.dt) + problem.q * jax.random.normal(key, (n,))

    def potential(before: Any, x: Any, row: Any) -> Any:
        return -0.5 * jnp.sum(((row[1] - problem.h(jnp, x, row[0])) / problem.r) ** 2)

    filter_ = particle_filter.build_filter(
        prior, propagate, potential, problem.particles, systematic.resampling
    )

    def run(inputs: Any, samples: Any) -> Any:
        first, rest = jax.random.split(jax.random.key(0))
        state = filter_.init_prepare(key=first)._replace(model_inputs=(inputs[0], samples[0]))

        def body(state: Any, given: Any) -> Any:
            row, key = given
            state = filter_.filter_combine(state, filter_.filter_prepare(row, key=key))
            share = jax.nn.softmax(state.log_weights)
            mean = share @ state.particles
            return state, (mean, jnp.sqrt(share @ (state.particles - mean) ** 2))

        return jax.lax.scan(body, state, ((inputs, samples), jax.random.split(rest, len(samples))))[1]

    return run
