"""H∞, limited memory, fading, adaptive R and fuzzy inference as printed: covariances, inverses, loops."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from oracles.covariance_kf import Belief, kf_predict, kf_update

Array = NDArray[np.float64]
Step = tuple[Array, Array, Array]
"""F, b, Q of x⁺ = F x + b + w."""


def hinfinity_update(
    belief: Belief, H: Array, c: Array, R: Array, z: Array, theta: float, S_bar: Array
) -> Belief:
    """M = (I − θS̄P + HᵀR⁻¹HP)⁻¹, K = P M HᵀR⁻¹, x = x + K ν, P = P M (paper 000 §2.3, mended)."""
    P, inverse_R = belief.cov, np.linalg.inv(R)
    M = np.linalg.inv(np.eye(len(P)) - theta * S_bar @ P + H.T @ inverse_R @ H @ P)
    K = P @ M @ H.T @ inverse_R
    return Belief(belief.mean + K @ (z - H @ belief.mean - c), P @ M)


def hinfinity_exists(belief: Belief, H: Array, R: Array, theta: float, S_bar: Array) -> bool:
    """P⁻¹ − θS̄ + HᵀR⁻¹H ≻ 0."""
    left = np.linalg.inv(belief.cov) - theta * S_bar + H.T @ np.linalg.inv(R) @ H
    return bool(np.linalg.eigvalsh(left).min() > 0)


def limited_memory(posteriors: Sequence[Belief], steps: Sequence[Step], N: int) -> Belief:
    """P_N = (P_k⁻¹ − P_{k|k−N}⁻¹)⁻¹ and its mean, by predicting anew from N steps ago.

    Args:
        posteriors: up to k, at least N + 1.
        steps: ``steps[i]`` led to ``posteriors[i]``.
        N: memory.
    """
    now, old = posteriors[-1], posteriors[-1 - N]
    for F, b, Q in steps[-N:]:
        old = kf_predict(old, F, b, Q)
    here, gone = np.linalg.inv(now.cov), np.linalg.inv(old.cov)
    P = np.linalg.inv(here - gone)
    return Belief(P @ (here @ now.mean - gone @ old.mean), P)


def last_samples_alone(
    F: Sequence[Array], H: Sequence[Array], R: Sequence[Array], z: Sequence[Array]
) -> Belief:
    """Weighted least squares on these samples and nothing else, without process noise.

    Args:
        F: (N) transitions; ``F[i]`` led to the state that sample i saw.
        H: (N) of the samples.
        R: (N) their noise covariances.
        z: (N) samples.
    """
    to_last = [np.eye(len(F[0]))]
    for later in reversed(F[1:]):
        to_last.insert(0, to_last[0] @ later)
    information, vector = np.zeros_like(F[0]), np.zeros(len(F[0]))
    for Phi, Hi, Ri, zi in zip(to_last, H, R, z, strict=True):
        seen = Hi @ np.linalg.inv(Phi)
        information += seen.T @ np.linalg.inv(Ri) @ seen
        vector += seen.T @ np.linalg.inv(Ri) @ zi
    P = np.linalg.inv(information)
    return Belief(P @ vector, P)


def strong_tracking_update(
    belief: Belief, H: Array, R: Array, z: Array, V: Array, softening: float, largest: float
) -> tuple[Belief, float]:
    """s = max(1, tr N / tr M) in units of R, then P + (s − 1) K S Kᵀ and the Kalman update.

    Args:
        belief: before the sample.
        H: (m, n).
        R: (m, m).
        z: (m,).
        V: (m,) mean of ν²/R, this sample's included.
        softening: β.
        largest: bound of s.
    """
    unit, M = np.diag(R), H @ belief.cov @ H.T
    s = float(np.clip(np.sum(V - softening) / np.sum(np.diag(M) / unit), 1, largest))
    S = M + R
    K = belief.cov @ H.T @ np.linalg.inv(S)
    inflated = Belief(belief.mean, belief.cov + (s - 1) * K @ S @ K.T)
    return kf_update(inflated, H, np.zeros(len(z)), R, z)[0], s


class AdaptiveWindow:
    """R̂ per sensor from the last L residuals of each: mean of ε² + (HPHᵀ), ε and P after the update."""

    def __init__(self, length: int, minimum: int, nominal: Array) -> None:
        self.length, self.minimum, self.nominal = length, minimum, nominal
        self.seen: list[list[float]] = [[] for _ in nominal]

    def variances(self) -> Array:
        """(m,) R̂ for the next sample."""
        learned = [np.mean(s[-self.length :]) if len(s) >= self.minimum else 1.0 for s in self.seen]
        return self.nominal * np.array(learned)

    def learn(self, posterior: Belief, H: Array, c: Array, z: Array) -> None:
        """Take one sample, seen from the posterior."""
        for i in np.flatnonzero(np.isfinite(z)):
            residual = z[i] - H[i] @ posterior.mean - c[i]
            self.seen[i].append((residual**2 + H[i] @ posterior.cov @ H[i]) / self.nominal[i])


def mamdani(rules: Sequence[tuple[Sequence[float], Sequence[float]]], e: float) -> float:
    """Minimum implication, maximum aggregation, centroid; sets are (left, peak, right)."""

    def membership(triangle: Sequence[float], x: float) -> float:
        left, peak, right = triangle
        if x <= left or x >= right:
            return 0.0
        return (x - left) / (peak - left) if x < peak else (right - x) / (right - peak)

    low, high = min(o[0] for _, o in rules), max(o[2] for _, o in rules)
    area = moment = 0.0
    for y in np.linspace(low, high, 4001):
        height = max(min(membership(given, e), membership(output, y)) for given, output in rules)
        area += height
        moment += height * y
    return moment / area
