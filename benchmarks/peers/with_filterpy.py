"""FilterPy: its Kalman and unscented Kalman filter, and a particle filter around its resampling."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from benchmarks.peers.problems import Problem
from benchmarks.peers.program import Program
from benchmarks.peers.reference import Run, linear_system, particle
from filterpy.kalman import KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from filterpy.monte_carlo import systematic_resample

_NOTES = {
    "kf": "",
    "ukf": "",
    "pf": "it has no particle filter, only the resampling: NumPy around that",
}


def program(problem: Problem) -> Program:
    """Its objects, called for each sample."""
    calls: dict[str, Callable[[], Run]] = {
        "kf": lambda: _kalman(problem),
        "ukf": lambda: _unscented(problem),
        "pf": lambda: particle(problem, resample=systematic_resample),
    }
    method = problem.method
    return Program(calls[method], lambda out: out[0], problem.steps, note=_NOTES[method])


def _kalman(problem: Problem) -> Run:
    F, B, H = linear_system(problem)
    filter_ = KalmanFilter(dim_x=len(problem.q), dim_z=len(problem.r), dim_u=B.shape[1])
    filter_.x, filter_.P = problem.mean.copy(), np.diag(problem.std**2)
    filter_.F, filter_.B, filter_.H = F, B, H
    filter_.Q, filter_.R = np.diag(problem.q**2), np.diag(problem.r**2)
    means, stds = np.empty((2, problem.steps, len(problem.q)))
    for t, (u, z) in enumerate(zip(problem.inputs, problem.samples, strict=True)):
        filter_.predict(u)
        filter_.update(z)
        means[t], stds[t] = filter_.x, np.sqrt(np.diag(filter_.P))
    return means, stds


def _unscented(problem: Problem) -> Run:
    n, m = len(problem.q), len(problem.r)
    filter_ = UnscentedKalmanFilter(
        n,
        m,
        problem.dt,
        hx=lambda x, u: problem.h(np, x, u),
        fx=lambda x, dt, u: problem.f(np, x, u, dt),
        points=MerweScaledSigmaPoints(n, alpha=1.0, beta=2.0, kappa=0.0),
    )
    filter_.x, filter_.P = problem.mean.copy(), np.diag(problem.std**2)
    filter_.Q, filter_.R = np.diag(problem.q**2), np.diag(problem.r**2)
    means, stds = np.empty((2, problem.steps, n))
    for t, (u, z) in enumerate(zip(problem.inputs, problem.samples, strict=True)):
        filter_.predict(u=u)
        filter_.update(z, u=u)
        means[t], stds[t] = filter_.x, np.sqrt(np.diag(filter_.P))
    return means, stds
