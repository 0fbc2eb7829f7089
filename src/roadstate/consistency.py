"""Is a filter's uncertainty honest? Errors and innovations against what their covariances promise.

For a filter whose model is the world's: NEES ~ χ²(n), NIS ~ χ²(m), innovations white (Bar-Shalom, Li &
Kirubarajan, *Estimation with Applications to Tracking and Navigation*, ch. 5.4).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import gammainc, gammaincc, gammaln, ndtri
from numpy.typing import ArrayLike, NDArray

from roadstate.core import numerics as numerics  # float64 before the first array

Array = NDArray[np.float64]

_NEWTON = 40


class BandTest(NamedTuple):
    """A statistic and the band in which it lies with the chosen probability if all is as promised.

    Attributes:
        value: the statistic; 1 is expected of means over their degrees of freedom.
        low: lower end of the band.
        high: upper end of the band.
    """

    value: Array
    low: Array
    high: Array

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Whether the statistic lies in its band."""
        return np.asarray((self.low <= self.value) & (self.value <= self.high))


def nees(error: ArrayLike, factor: ArrayLike, rows: Sequence[int] | None = None) -> Array:
    """Normalised estimation error squared eᵀP⁻¹e.

    Args:
        error: (…, n) estimate − truth.
        factor: (…, n, n) any factor S of the covariance P = S Sᵀ.
        rows: the states to judge (their marginal distribution); all by default.

    Returns:
        (…) about the number of states; infinite for an error in a direction of no uncertainty.
    """
    e, S = np.asarray(error, float), np.asarray(factor, float)
    if rows is not None:
        e, S = e[..., list(rows)], S[..., list(rows), :]
    upper = np.linalg.qr(np.swapaxes(S, -1, -2), mode="r")
    return _squared_length(np.swapaxes(upper, -1, -2), e)


def nis(innovation: ArrayLike, S: ArrayLike) -> tuple[Array, NDArray[np.int64]]:
    """Normalised innovation squared νᵀS⁻¹ν over the sensors that have a sample.

    Args:
        innovation: (T, m) z − ẑ, NaN where missing.
        S: (T, m, m) its covariance.

    Returns:
        (T,) the NIS, 0 without a sample, and (T,) its degrees of freedom.
    """
    v = np.asarray(innovation, float)
    present = np.isfinite(v)
    both = present[..., :, None] & present[..., None, :]
    cov = np.where(both, np.asarray(S, float), np.eye(v.shape[-1]))
    squared = _squared_length(np.linalg.cholesky(cov), np.where(present, v, 0.0))
    return squared, np.sum(present, axis=-1)


def nees_test(values: ArrayLike, dof: int, *, confidence: float = 0.95) -> BandTest:
    """Mean NEES over independent runs, over its degrees of freedom; a test at each instant.

    Instants of one run are not independent, so a mean over time has no such band: count how many instants
    lie in theirs, about ``confidence`` of all.

    Args:
        values: (M,) or (M, T) NEES of M runs.
        dof: number of states n.
        confidence: probability of the band.
    """
    runs = np.asarray(values, float)
    return _mean_test(np.sum(runs, axis=0), np.full(runs.shape[1:], float(dof * len(runs))), confidence)


def nis_test(values: ArrayLike, dof: ArrayLike, *, confidence: float = 0.95) -> BandTest:
    """Mean NIS over its degrees of freedom, over one or several runs: innovations are independent in time.

    Args:
        values: NIS of any shape.
        dof: sensors used, of the same shape; samples with none do not count.
        confidence: probability of the band.

    Raises:
        ValueError: no sample at all.
    """
    degrees = np.broadcast_to(np.asarray(dof, float), np.shape(values))
    used = (degrees > 0) & np.isfinite(values)
    total = np.sum(np.where(used, values, 0.0))
    return _mean_test(total, np.sum(np.where(used, degrees, 0.0)), confidence)


def coverage_test(
    error: ArrayLike, std: ArrayLike, *, level: float = 0.95, confidence: float = 0.95
) -> BandTest:
    """Share of errors within the interval that should hold ``level`` of them.

    Args:
        error: (M, …) estimate − truth in M independent samples; NaN does not count.
        std: of the same shape, 1σ promised.
        level: probability of the promised interval, ±1.96σ for 0.95.
        confidence: probability of the band, which is that of a binomial share, by its normal approximation.
    """
    e, sigma = np.broadcast_arrays(np.asarray(error, float), np.asarray(std, float))
    there = np.isfinite(e) & np.isfinite(sigma)
    count = np.sum(there, axis=0).astype(float)
    hit = np.sum(there & (np.abs(e) <= normal_quantile(0.5 + level / 2) * sigma), axis=0)
    half = normal_quantile(0.5 + confidence / 2) * np.sqrt(level * (1 - level) / count)
    return BandTest(hit / count, np.maximum(level - half, 0.0), np.minimum(level + half, 1.0))


class Whiteness(NamedTuple):
    """Autocorrelation of innovations, L lags of m sensors.

    Attributes:
        correlation: (L, m) at lags 1 to L.
        bound: (L, m) which it stays within with the chosen probability if the innovations are white.
        portmanteau: (m,) Σ (pairs) ρ² over the lags, χ²(L) if they are white.
        limit: the quantile of χ²(L) that it then stays below.
    """

    correlation: Array
    bound: Array
    portmanteau: Array
    limit: float

    @property
    def share_outside(self) -> Array:
        """(m,) share of the lags whose correlation leaves its bound."""
        return np.asarray(np.mean(np.abs(self.correlation) > self.bound, axis=0))


def whiteness(
    innovation: ArrayLike, std: ArrayLike, *, lags: int = 20, confidence: float = 0.95
) -> Whiteness:
    """Are innovations uncorrelated in time? ρ(l) = Σ ν_k ν_{k+l}/√(Σν_k² Σν_{k+l}²), of the normalised ones.

    The sums are over pairs of which neither is missing; the bound is z/√(pairs). The portmanteau statistic
    is Box and Pierce's, with the pairs for the samples.

    Args:
        innovation: (T, m) or (T,), NaN where missing.
        std: of the same shape, √S_jj.
        lags: L.
        confidence: probability of bounds and limit.

    Raises:
        ValueError: no lag, or as many as samples.
    """
    values = np.asarray(innovation, float) / np.asarray(std, float)
    values = values[:, None] if values.ndim == 1 else values
    if not 0 < lags < len(values):
        raise ValueError(f"lags must lie between 1 and the number of samples, {len(values)}, got {lags}")
    correlation, pairs = np.empty((lags, values.shape[1])), np.empty((lags, values.shape[1]))
    for lag in range(1, lags + 1):
        early, late = values[:-lag], values[lag:]
        there = np.isfinite(early) & np.isfinite(late)
        early, late = np.where(there, early, 0.0), np.where(there, late, 0.0)
        size = np.sqrt(np.sum(early**2, axis=0) * np.sum(late**2, axis=0))
        both = np.sum(early * late, axis=0)
        correlation[lag - 1] = np.divide(both, size, out=np.zeros_like(both), where=size > 0)
        pairs[lag - 1] = np.sum(there, axis=0)
    return Whiteness(
        correlation=correlation,
        bound=normal_quantile(0.5 + confidence / 2) / np.sqrt(np.maximum(pairs, 1)),
        portmanteau=np.sum(pairs * correlation**2, axis=0),
        limit=float(chi2_quantile(confidence, lags)),
    )


def chi2_quantile(probability: ArrayLike, dof: ArrayLike) -> Array:
    """Quantiles of χ², by Newton's method on the incomplete gamma function, in the nearer tail.

    Starts from Wilson and Hilferty's cube, or from the leading term of the series where that is larger.

    Args:
        probability: in [0, 1).
        dof: degrees of freedom, positive; broadcasts.

    Raises:
        ValueError: a probability or a number of degrees outside of its range.
    """
    p, k = np.broadcast_arrays(np.asarray(probability, float), np.asarray(dof, float))
    if not np.all((p >= 0) & (p < 1)):
        raise ValueError("a probability lies in [0, 1)")
    if not np.all((k > 0) & np.isfinite(k)):
        raise ValueError("degrees of freedom are positive and finite")
    a, upper, spread = jnp.asarray(k / 2), p > 0.5, 2 / (9 * k)
    z = np.asarray(ndtri(jnp.asarray(np.maximum(p, 1e-300))))
    cube = k * np.maximum(1 - spread + z * np.sqrt(spread), 0.0) ** 3
    with np.errstate(divide="ignore"):
        small = 2 * np.exp((np.log(p) + np.asarray(gammaln(a + 1))) / np.asarray(a))
    x = np.maximum(cube, small)
    for _ in range(_NEWTON):
        half = jnp.asarray(x / 2)
        ahead = np.where(upper, np.asarray(gammaincc(a, half)) - (1 - p), p - np.asarray(gammainc(a, half)))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            log_density = (k / 2 - 1) * np.log(x / 2) - x / 2 - np.asarray(gammaln(a)) - np.log(2)
            step = np.where(ahead == 0, 0.0, ahead / np.exp(log_density))
        new = np.clip(x + step, 0.1 * x, 10 * x)
        done = bool(np.all(np.abs(new - x) <= 1e-12 * x))
        x = new
        if done:
            break
    return np.asarray(np.where(p > 0, x, 0.0))


def normal_quantile(probability: ArrayLike) -> Any:
    """Quantiles of the standard normal distribution.

    Args:
        probability: in (0, 1).
    """
    return np.asarray(ndtri(jnp.asarray(probability, jnp.result_type(float))))


def _mean_test(total: Any, degrees: Any, confidence: float) -> BandTest:
    if not np.all(degrees > 0):
        raise ValueError("no sample to judge by")
    tail = (1 - confidence) / 2
    low, high = (chi2_quantile(q, degrees) / degrees for q in (tail, 1 - tail))
    return BandTest(np.asarray(total / degrees), low, high)


def _squared_length(L: Array, v: Array) -> Array:
    """|L⁻¹v|² for lower-triangular L, row by row, so that a zero pivot tells only of its own row."""
    whitened: list[Array] = []
    for i in range(v.shape[-1]):
        rest = v[..., i] - sum((L[..., i, j] * w for j, w in enumerate(whitened)), np.zeros(v.shape[:-1]))
        with np.errstate(divide="ignore", invalid="ignore"):
            whitened.append(np.where(rest == 0, 0.0, rest / L[..., i, i]))
    return np.asarray(sum((w**2 for w in whitened), np.zeros(v.shape[:-1])))
