"""A linear system's whole trajectory at once: what filtering and smoothing must agree with."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def trajectory(F: Array, b: Array, Q: Array, mean: Array, cov: Array) -> tuple[Array, Array]:
    """Mean (T n,), covariance (T n, T n) of x_1 … x_T before any sample: x_k = F_k x_{k−1} + b_k + w_k."""
    steps, n = b.shape
    m, P = mean, cov
    means, blocks = [], np.zeros((steps, steps, n, n))
    for k in range(steps):
        m, P = F[k] @ m + b[k], F[k] @ P @ F[k].T + Q[k]
        means.append(m)
        blocks[k, k] = P
        for j in range(k):
            blocks[k, j] = F[k] @ blocks[k - 1, j]
            blocks[j, k] = blocks[k, j].T
    return np.concatenate(means), blocks.transpose(0, 2, 1, 3).reshape(steps * n, steps * n)


def condition(mean: Array, cov: Array, H: Array, c: Array, R: Array, z: Array) -> tuple[Array, Array]:
    """A Gaussian trajectory given all samples that are numbers, by one dense solve."""
    steps, m, n = H.shape
    big_H, big_R = np.zeros((steps * m, steps * n)), np.zeros((steps * m, steps * m))
    for k in range(steps):
        big_H[k * m : (k + 1) * m, k * n : (k + 1) * n] = H[k]
        big_R[k * m : (k + 1) * m, k * m : (k + 1) * m] = R[k]
    there = np.isfinite(z.ravel())
    big_H, big_R = big_H[there], big_R[np.ix_(there, there)]
    gain = np.linalg.solve(big_H @ cov @ big_H.T + big_R, big_H @ cov).T
    innovation = z.ravel()[there] - c.ravel()[there] - big_H @ mean
    return mean + gain @ innovation, cov - gain @ big_H @ cov


def least_squares(
    F: Array, b: Array, Q: Array, mean: Array, cov: Array, H: Array, c: Array, R: Array, z: Array
) -> tuple[Array, Array]:
    """The same as a least sum of squares over x_0 … x_T (Q, R, prior regular): means (T, n), P (T, n, n)."""
    steps, n = b.shape
    rows: list[Array] = []
    values: list[Array] = []

    def add(places: dict[int, Array], value: Array, cov: Array) -> None:
        root = np.linalg.inv(np.linalg.cholesky(cov))
        row = np.zeros((len(value), n * (steps + 1)))
        for k, block in places.items():
            row[:, k * n : (k + 1) * n] = root @ block
        rows.append(row)
        values.append(root @ value)

    add({0: np.eye(n)}, mean, cov)
    for k in range(steps):
        add({k: -F[k], k + 1: np.eye(n)}, b[k], Q[k])
        there = np.isfinite(z[k])
        if there.any():
            add({k + 1: H[k][there]}, (z[k] - c[k])[there], R[k][np.ix_(there, there)])
    A, y = np.concatenate(rows), np.concatenate(values)
    x = np.linalg.lstsq(A, y, rcond=None)[0].reshape(-1, n)[1:]
    P = np.linalg.inv(A.T @ A)
    return x, np.array([P[k * n : (k + 1) * n, k * n : (k + 1) * n] for k in range(1, steps + 1)])


def arrays_of(model: Any, u: Any, dt: Any) -> dict[str, Array]:
    """The matrices of a :class:`filters.models.TimeVarying` over its log, as covariances."""
    G, L = np.asarray(u.G), np.asarray(u.L)
    G = G * np.sqrt(np.asarray(dt))[:, None, None]
    return {
        "F": np.asarray(u.F),
        "b": np.asarray(u.b) * np.asarray(dt)[:, None],
        "Q": G @ G.transpose(0, 2, 1),
        "H": np.asarray(u.H),
        "c": np.asarray(u.c),
        "R": L @ L.transpose(0, 2, 1),
        "mean": np.asarray(model.prior().mean),
        "cov": np.asarray(model.prior().cov),
    }
