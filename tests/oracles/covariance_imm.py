"""The interacting multiple model filter as the textbook writes it: covariances, inverses, mode after mode.

Bar-Shalom, Li & Kirubarajan (2001), table 11.6.6-1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Array = NDArray[np.float64]


class Mode(NamedTuple):
    """x⁺ = F x + w, z = H x + v."""

    F: Array
    Q: Array
    H: Array
    R: Array


def chain(rates: Array, dt: float) -> Array:
    """Transition probabilities over Δt of a chain with these jumps per second (row: from)."""
    generator = np.array(rates, float)
    np.fill_diagonal(generator, 0)
    np.fill_diagonal(generator, -generator.sum(axis=1))
    return np.asarray(expm(generator * dt))


def imm_filter(
    modes: list[Mode], jumps: Array, probability: Array, mean: Array, cov: Array, z: Array
) -> tuple[Array, Array, Array, Array]:
    """Means (T, n), covariances (T, n, n), mode probabilities (T, K), log-likelihoods (T,)."""
    K = len(modes)
    p = np.array(probability, float)
    means, covs = [np.array(mean)] * K, [np.array(cov)] * K
    out = []
    for sample in z:
        predicted = jumps.T @ p
        mixed = []
        for j in range(K):
            weight = jumps[:, j] * p / predicted[j]
            m = sum(w * x for w, x in zip(weight, means, strict=True))
            P = sum(w * (C + np.outer(x - m, x - m)) for w, x, C in zip(weight, means, covs, strict=True))
            mixed.append((m, P))
        likelihood = np.ones(K)
        for j, (mode, (m, P)) in enumerate(zip(modes, mixed, strict=True)):
            m, P = mode.F @ m, mode.F @ P @ mode.F.T + mode.Q
            there = np.isfinite(sample)
            if there.any():
                H, R = mode.H[there], mode.R[np.ix_(there, there)]
                S, innovation = H @ P @ H.T + R, sample[there] - H @ m
                gain = P @ H.T @ np.linalg.inv(S)
                m, P = m + gain @ innovation, P - gain @ S @ gain.T
                quadratic = innovation @ np.linalg.inv(S) @ innovation
                likelihood[j] = np.exp(-0.5 * quadratic) / np.sqrt(np.linalg.det(2 * np.pi * S))
            means[j], covs[j] = m, P
        total = likelihood @ predicted
        p = likelihood * predicted / total
        m = sum(w * x for w, x in zip(p, means, strict=True))
        P = sum(w * (C + np.outer(x - m, x - m)) for w, x, C in zip(p, means, covs, strict=True))
        out.append((m, P, p, np.log(total)))
    return tuple(np.array(column) for column in zip(*out, strict=True))  # type: ignore[return-value]
