"""pykalman: its Kalman filter, and its additive unscented one with the parameters all others use."""

from __future__ import annotations

import numpy as np
from benchmarks.peers.problems import Problem
from benchmarks.peers.program import Program
from benchmarks.peers.reference import Run, first_prior, linear_system
from pykalman import KalmanFilter
from pykalman.unscented import (
    Moments,
    moments2points,
    unscented_filter_correct,
    unscented_filter_predict,
)

_NOTES = {
    "kf": "it updates before it predicts: given the prior carried one step ahead",
    "ukf": "its class fixes β = 0 and κ = 3 − n: its loop, of its functions, with the parameters of all",
}


def program(problem: Problem) -> Program:
    """Its loop over the log."""
    run = _kalman if problem.method == "kf" else _unscented
    note = _NOTES[problem.method]
    return Program(lambda: run(problem), lambda out: out[0], problem.steps, note=note)


def _kalman(problem: Problem) -> Run:
    F, B, H = linear_system(problem)
    mean, cov = first_prior(problem)
    filter_ = KalmanFilter(
        transition_matrices=F,
        observation_matrices=H,
        transition_covariance=np.diag(problem.q**2),
        observation_covariance=np.diag(problem.r**2),
        transition_offsets=problem.inputs[1:] @ B.T,
        initial_state_mean=mean,
        initial_state_covariance=cov,
    )
    means, covs = filter_.filter(problem.samples)
    return means, np.sqrt(np.diagonal(covs, axis1=1, axis2=2))


def _unscented(problem: Problem) -> Run:
    Q, R, dt = np.diag(problem.q**2), np.diag(problem.r**2), problem.dt
    now = Moments(problem.mean, np.diag(problem.std**2))
    means, stds = np.empty((2, problem.steps, len(problem.q)))
    for t, (u, z) in enumerate(zip(problem.inputs, problem.samples, strict=True)):
        points = moments2points(now, 1.0, 2.0, 0.0)
        _, ahead = unscented_filter_predict(
            lambda x, u=u: problem.f(np, x, u, dt), points, sigma_transition=Q
        )
        points = moments2points(ahead, 1.0, 2.0, 0.0)
        seen = np.ma.asarray(z)
        now = Moments(
            *unscented_filter_correct(
                lambda x, u=u: problem.h(np, x, u), ahead, points, seen, sigma_observation=R
            )
        )
        means[t], stds[t] = now.mean, np.sqrt(np.diag(now.covariance))
    return means, stds
