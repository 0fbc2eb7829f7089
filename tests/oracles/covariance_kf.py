"""Kalman and unscented Kalman filters as the textbooks print them: covariances, sums, inverses, loops."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass
class Belief:
    """Mean (n,) and covariance (n, n)."""

    mean: Array
    cov: Array


@dataclass
class Told:
    """What an update tells of the sensors present: innovation ν, its covariance S, νᵀS⁻¹ν, log p(z)."""

    innovation: Array
    S: Array
    nis: float
    log_likelihood: float


def kf_predict(belief: Belief, F: Array, b: Array, Q: Array) -> Belief:
    """x = F x + b, P = F P Fᵀ + Q."""
    return Belief(F @ belief.mean + b, F @ belief.cov @ F.T + Q)


def kf_update(belief: Belief, H: Array, c: Array, R: Array, z: Array) -> tuple[Belief, Told]:
    """K = P Hᵀ S⁻¹, x = x + K ν, P = (I − K H) P, over the rows of z that are numbers."""
    there = np.isfinite(z)
    H, z_hat, R, z = H[there], (H @ belief.mean + c)[there], R[np.ix_(there, there)], z[there]
    P = belief.cov
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    told = tell(z - z_hat, S)
    return Belief(belief.mean + K @ told.innovation, P - K @ H @ P), told


def tell(innovation: Array, S: Array) -> Told:
    """NIS and log-likelihood of an innovation."""
    nis = float(innovation @ np.linalg.inv(S) @ innovation)
    log_det = np.log(np.linalg.det(S)) if len(S) else 0.0
    return Told(innovation, S, nis, -0.5 * (nis + log_det + len(S) * np.log(2 * np.pi)))


@dataclass
class Unscented:
    """Scaled sigma points and their weights (Wan & van der Merwe 2000), as printed.

    With a small α the centre's weight is about −α⁻² and the sums lose that many digits.
    """

    alpha: float
    beta: float
    kappa: float

    def points(self, belief: Belief) -> Array:
        """(2n + 1, n): x̂, x̂ + columns, x̂ − columns of √((n+λ) P)."""
        n = len(belief.mean)
        lam = self.alpha**2 * (n + self.kappa) - n
        root = np.linalg.cholesky((n + lam) * belief.cov)
        rows = [belief.mean]
        rows += [belief.mean + root[:, i] for i in range(n)]
        rows += [belief.mean - root[:, i] for i in range(n)]
        return np.array(rows)

    def weights(self, n: int) -> tuple[Array, Array]:
        """w_m and w_c, (2n + 1,) each."""
        lam = self.alpha**2 * (n + self.kappa) - n
        mean = np.full(2 * n + 1, 1 / (2 * (n + lam)))
        mean[0] = lam / (n + lam)
        cov = mean.copy()
        cov[0] += 1 - self.alpha**2 + self.beta
        return mean, cov

    def predict(self, belief: Belief, f: Callable[[Array], Array], Q: Array) -> Belief:
        """Mean and covariance of the points moved by f, plus Q."""
        w_m, w_c = self.weights(len(belief.mean))
        moved = np.array([f(x) for x in self.points(belief)])
        mean = sum(w * y for w, y in zip(w_m, moved, strict=True))
        cov = sum(w * np.outer(y - mean, y - mean) for w, y in zip(w_c, moved, strict=True))
        return Belief(mean, cov + Q)

    def update(self, belief: Belief, h: Callable[[Array], Array], R: Array, z: Array) -> tuple[Belief, Told]:
        """G = P_xz P_zz⁻¹ with points drawn anew, over the rows of z that are numbers."""
        there = np.isfinite(z)
        w_m, w_c = self.weights(len(belief.mean))
        points = self.points(belief)
        seen = np.array([h(x)[there] for x in points])
        z_hat = sum(w * y for w, y in zip(w_m, seen, strict=True))
        S = R[np.ix_(there, there)] + sum(
            w * np.outer(y - z_hat, y - z_hat) for w, y in zip(w_c, seen, strict=True)
        )
        P_xz = sum(
            w * np.outer(x - belief.mean, y - z_hat) for w, x, y in zip(w_c, points, seen, strict=True)
        )
        told = tell(z[there] - z_hat, S)
        G = P_xz @ np.linalg.inv(S)
        return Belief(belief.mean + G @ told.innovation, belief.cov - G @ S @ G.T), told
