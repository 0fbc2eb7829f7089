"""dynamax: its Kalman and unscented Kalman filter, each one compiled scan over covariances."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from benchmarks.peers.problems import Problem
from benchmarks.peers.program import Program
from benchmarks.peers.reference import first_prior, linear_system
from dynamax.linear_gaussian_ssm.inference import lgssm_filter, make_lgssm_params
from dynamax.nonlinear_gaussian_ssm.inference_ukf import UKFHyperParams, unscented_kalman_filter
from dynamax.nonlinear_gaussian_ssm.models import ParamsNLGSSM

_NOTE = (
    "it updates before it predicts: given the prior carried one step ahead; it adds 1e-9 to the diagonal of "
    "S before it solves for the gain, hence the difference"
)


def program(problem: Problem) -> Program:
    """Its jitted scan over the log."""
    dt = problem.dt
    mean, cov = (jnp.asarray(a) for a in first_prior(problem))
    Q, R = jnp.diag(problem.q**2), jnp.diag(problem.r**2)
    inputs, samples = jnp.asarray(problem.inputs), jnp.asarray(problem.samples)

    @jax.jit
    def unscented(mean: Any, cov: Any, Q: Any, R: Any, inputs: Any, samples: Any) -> Any:
        params = ParamsNLGSSM(
            mean,
            cov,
            lambda x, u: problem.f(jnp, x, u, dt),
            Q,
            lambda x, u: problem.h(jnp, x, u),
            R,
        )
        fields = ["filtered_means", "filtered_covariances"]
        settings = UKFHyperParams(alpha=1.0, beta=2.0, kappa=0.0)
        out = unscented_kalman_filter(params, samples, settings, inputs, fields)
        return out.filtered_means, _stds(out.filtered_covariances)

    @jax.jit
    def kalman(mean: Any, cov: Any, Q: Any, R: Any, inputs: Any, samples: Any) -> Any:
        F, B, H = linear_system(problem)
        params = make_lgssm_params(mean, cov, F, Q, H, R, dynamics_input_weights=B)
        out = lgssm_filter(params, samples, inputs)
        return out.filtered_means, _stds(out.filtered_covariances)

    run = kalman if problem.method == "kf" else unscented

    def call() -> Any:
        return jax.block_until_ready(run(mean, cov, Q, R, inputs, samples))

    return Program(call, lambda out: np.asarray(out[0]), problem.steps, note=_NOTE)


def _stds(covariances: Any) -> Any:
    return jnp.sqrt(jnp.diagonal(covariances, axis1=1, axis2=2))
