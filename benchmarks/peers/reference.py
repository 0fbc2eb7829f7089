"""The textbook's filters as plain loops: what every implementation is measured against."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from benchmarks.peers.problems import Array, Problem
from numpy.typing import NDArray

Run = tuple[Array, Array]
"""Means and standard deviations, (T, n) each."""


def kalman(problem: Problem) -> Run:
    """Covariance-form KF; F and H are read off f and h, which are affine."""
    n, m, dt = len(problem.q), len(problem.r), problem.dt
    x, P = problem.mean.copy(), np.diag(problem.std**2)
    means, stds = np.empty((problem.steps, n)), np.empty((problem.steps, n))
    for t, (u, z) in enumerate(zip(problem.inputs, problem.samples, strict=True)):
        moved = problem.f(np, x, u, dt)
        F = np.stack([problem.f(np, x + e, u, dt) - moved for e in np.eye(n)], 1)
        x, P = moved, F @ P @ F.T + np.diag(problem.q**2)
        seen = problem.h(np, x, u)
        H = np.stack([problem.h(np, x + e, u) - seen for e in np.eye(n)], 1).reshape(m, n)
        S = H @ P @ H.T + np.diag(problem.r**2)
        K = P @ H.T @ np.linalg.inv(S)
        x, P = x + K @ (z - seen), P - K @ S @ K.T
        means[t], stds[t] = x, np.sqrt(np.diag(P))
    return means, stds


def linear_system(problem: Problem) -> tuple[Array, Array, Array]:
    """F (n, n), B (n, k) and H (m, n) of a problem with f = F x + B u and h = H x."""
    n, k = len(problem.q), problem.inputs.shape[1]
    nothing, still = np.zeros(n), np.zeros(k)
    F = np.stack([problem.f(np, e, still, problem.dt) for e in np.eye(n)], 1)
    B = np.stack([problem.f(np, nothing, e, problem.dt) for e in np.eye(k)], 1)
    return F, B, np.stack([problem.h(np, e, still) for e in np.eye(n)], 1)


def ahead(problem: Problem, x: Array, P: Array, u: Array) -> tuple[Array, Array]:
    """A mean and covariance carried through f by the unscented transform, which is exact where f is affine.

    Libraries that update before they predict are given the prior as this leaves it.
    """
    weights, spread = _weights(len(x))
    points = np.stack([problem.f(np, point, u, problem.dt) for point in _points(x, P)])
    mean = weights @ points
    return mean, (spread * (points - mean).T) @ (points - mean) + np.diag(problem.q**2)


def first_prior(problem: Problem) -> tuple[Array, Array]:
    """Mean and covariance just before the first sample."""
    return ahead(problem, problem.mean, np.diag(problem.std**2), problem.inputs[0])


def unscented(problem: Problem) -> Run:
    """Covariance-form UKF with α = 1, β = 2, κ = 0, its points redrawn before the update."""
    n = len(problem.q)
    weights, spread = _weights(n)
    x, P = problem.mean.copy(), np.diag(problem.std**2)
    means, stds = np.empty((problem.steps, n)), np.empty((problem.steps, n))
    for t, (u, z) in enumerate(zip(problem.inputs, problem.samples, strict=True)):
        x, P = ahead(problem, x, P, u)
        points = _points(x, P)
        seen = np.stack([problem.h(np, point, u) for point in points])
        expected = weights @ seen
        S = (spread * (seen - expected).T) @ (seen - expected) + np.diag(problem.r**2)
        C = (spread * (points - x).T) @ (seen - expected)
        K = C @ np.linalg.inv(S)
        x, P = x + K @ (z - expected), P - K @ S @ K.T
        means[t], stds[t] = x, np.sqrt(np.diag(P))
    return means, stds


def _weights(n: int) -> tuple[Array, Array]:
    """Of the points' mean and covariance: λ = 0, so that the center counts with 0 and with 1 − α² + β = 2."""
    weights = np.r_[0.0, np.full(2 * n, 0.5 / n)]
    return weights, np.r_[2.0, weights[1:]]


def _points(x: Array, P: Array) -> Array:
    offsets = np.sqrt(len(x)) * np.linalg.cholesky(P).T
    return np.concatenate([x[None], x + offsets, x - offsets])


def systematic(weight: Array, rng: np.random.Generator) -> NDArray[np.int64]:
    """Indices of the particles chosen by systematic resampling."""
    count = len(weight)
    targets = (np.arange(count) + rng.random()) / count
    return np.minimum(np.searchsorted(np.cumsum(weight), targets), count - 1)


def particle(
    problem: Problem,
    particles: int | None = None,
    seed: int = 0,
    resample: Callable[[Array], NDArray[np.integer[Any]]] | None = None,
) -> Run:
    """SIR particle filter, resampled at each step; f and h take particles along the last axis.

    Args:
        problem: what to run.
        particles: default the problem's.
        seed: of the random numbers.
        resample: normalised weights → indices of the particles chosen; default :func:`systematic`.
    """
    rng = np.random.default_rng(seed)
    count, n = particles or problem.particles, len(problem.q)
    cloud = problem.mean[:, None] + problem.std[:, None] * rng.standard_normal((n, count))
    means, stds = np.empty((problem.steps, n)), np.empty((problem.steps, n))
    for t, (u, z) in enumerate(zip(problem.inputs, problem.samples, strict=True)):
        columns = u[:, None]
        cloud = problem.f(np, cloud, columns, problem.dt)
        cloud = cloud + problem.q[:, None] * rng.standard_normal((n, count))
        distance = (z[:, None] - problem.h(np, cloud, columns)) / problem.r[:, None]
        log_weight = -0.5 * np.sum(distance**2, axis=0)
        weight = np.exp(log_weight - log_weight.max())
        weight /= weight.sum()
        means[t] = cloud @ weight
        stds[t] = np.sqrt((cloud - means[t][:, None]) ** 2 @ weight)
        cloud = cloud[:, systematic(weight, rng) if resample is None else resample(weight)]
    return means, stds


def reference(problem: Problem) -> Run:
    """The method the problem asks for."""
    return {"kf": kalman, "ukf": unscented, "pf": particle}[problem.method](problem)
