"""Bounds on states that a Gaussian filter knows nothing of."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core.gaussian import Gaussian, Info, Reason
from roadstate.filters.base import Filter
from roadstate.filters.ukf import UKF
from roadstate.linalg import tria
from roadstate.statespace import StateSpaceModel

S = TypeVar("S")

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(48)
_REACH = 8.5
"""Standard deviations beyond which a normal density counts as zero (1e-16 of its peak)."""
_DEEPEST = 3.0
"""A mean this many standard deviations outside or more is out by an error of the model, not by chance: the
tail it would be cut to is not believed to be as narrow as it gets."""


def truncated_moments(
    low: Float[Array, "*shape"], high: Float[Array, "*shape"]
) -> tuple[Float[Array, "*shape"], Float[Array, "*shape"]]:
    """Mean and variance of a standard normal variable that is known to lie in [low, high].

    By Gauss–Legendre quadrature over the part of the interval that has density, counted from its end
    nearest the peak: the usual differences of φ and Φ lose all digits in the tails and in narrow intervals.

    Args:
        low: may be −∞.
        high: above ``low``; may be +∞.
    """
    mirrored = low + high < 0
    near, far = jnp.where(mirrored, -high, low), jnp.where(mirrored, -low, high)
    near = jnp.maximum(near, -_REACH)
    # density falls by exp(−reach²/2) within this distance of max(near, 0)
    inside = jnp.maximum(near, 0)
    decay = _REACH**2 / (inside + jnp.sqrt(inside**2 + _REACH**2))
    width = jnp.minimum(far - near, inside - near + decay)
    nodes = jnp.asarray((_NODES + 1) / 2, width.dtype)
    distance = width[..., None] * nodes
    exponent = distance * (near[..., None] + distance / 2)
    mass = jnp.asarray(_WEIGHTS, width.dtype) * jnp.exp(-exponent)
    mass = mass / jnp.sum(mass, axis=-1, keepdims=True)
    mean = jnp.sum(mass * distance, axis=-1)
    variance = jnp.sum(mass * (distance - mean[..., None]) ** 2, axis=-1)
    mean = near + mean
    return jnp.where(mirrored, -mean, mean), variance


def truncate(gaussian: Gaussian, lower: Float[Array, " n"], upper: Float[Array, " n"]) -> Gaussian:
    """The Gaussian with the moments of ``gaussian`` cut off at bounds, one component after the other.

    For a component with standard deviation s and the unit vector r = S_iᵀ/s, the density's truncation moves
    the mean by S r m and leaves S(I + (√v − 1) r rᵀ) as the factor, m and v being the moments of the cut
    standard normal density: no difference of covariances is formed (Simon, *Optimal State Estimation*,
    ch. 7.5.4; Shimada et al. 1998). Exact for one bounded component; for several, each is cut with those
    before already Gaussian again.

    Args:
        gaussian: before the bounds.
        lower: (n,) least value of each component, −∞ for none.
        upper: (n,) largest value, +∞ for none.
    """

    def cut(now: tuple[Array, Array], bounds: tuple[Array, Array, Array]) -> tuple[tuple[Array, Array], None]:
        (mean, S), (low, high, i) = now, bounds
        variance = jnp.sum(S[i] ** 2)
        spread = variance > 0
        unit = jnp.sqrt(jnp.where(spread, variance, 1))
        a, b = _distance(low, mean[i], unit), _distance(high, mean[i], unit)
        outside = jnp.maximum(a - _DEEPEST, 0) - jnp.maximum(-b - _DEEPEST, 0)
        m, v = truncated_moments(a - outside, b - outside)
        acts = spread & ((a > -_REACH) | (b < _REACH))
        m, v = jnp.where(acts, m + outside, 0), jnp.where(acts, v, 1)
        r = S[i] / unit
        along = S @ r
        return (mean + along * m, S + jnp.outer(along * (jnp.sqrt(v) - 1), r)), None

    n = gaussian.mean.shape[0]
    (mean, S), _ = jax.lax.scan(cut, (gaussian.mean, gaussian.factor), (lower, upper, jnp.arange(n)))
    return Gaussian(jnp.clip(mean, lower, upper), tria(S))


def _distance(bound: Float[Array, ""], mean: Float[Array, ""], std: Float[Array, ""]) -> Float[Array, ""]:
    """In standard deviations; without a derivative where there is no bound."""
    there = jnp.isfinite(bound)
    return jnp.where(there, (jnp.where(there, bound, 0) - mean) / std, bound)


def project(gaussian: Gaussian, lower: Float[Array, " n"], upper: Float[Array, " n"]) -> Gaussian:
    """The Gaussian with its mean moved onto bounds where it lies outside; its covariance stays.

    Each component is moved along P's column, the nearest point in the metric of P⁻¹, so that correlated
    components move with it (Simon & Chia 2002). That the covariance stays is on the safe side: being
    within bounds is not a measurement, however often it is checked.

    Args:
        gaussian: before the bounds.
        lower: (n,) least value of each component, −∞ for none.
        upper: (n,) largest value, +∞ for none.
    """
    S = gaussian.factor

    def move(mean: Array, bounds: tuple[Array, Array, Array]) -> tuple[Array, None]:
        low, high, i = bounds
        variance = jnp.sum(S[i] ** 2)
        share = (jnp.clip(mean[i], low, high) - mean[i]) / jnp.where(variance > 0, variance, 1)
        return mean + S @ S[i] * share, None

    mean, _ = jax.lax.scan(move, gaussian.mean, (lower, upper, jnp.arange(gaussian.mean.shape[0])))
    return Gaussian(jnp.clip(mean, lower, upper), S)


class Bounded(Filter[Any]):
    """Any Gaussian filter, with bounds on states.

    What is reported is the filter's Gaussian cut off at the bounds (:func:`truncate`). What the filter runs
    on with is its own Gaussian, with the mean moved onto the bounds where it lay outside
    (:func:`project`, reported as :attr:`Reason.PROJECTED`) so that f and h are not evaluated where they mean
    nothing. A truncated Gaussian is never fed back: it would be truncated again at every step, and its
    covariance shrink towards nothing without a single sample.

    Attributes:
        filter: the Gaussian filter inside; it must hold the Gaussian it reports.
        lower: (n,) or scalar, least value of each state; −∞ for none.
        upper: (n,) or scalar, largest value; +∞ for none.
        feedback: whether the mean inside is moved onto the bounds.

    Raises:
        ValueError: a lower bound that is not below its upper.
    """

    name: ClassVar[str] = "bounded"
    filter: Filter[Any] = UKF()
    lower: Float[Array, "#n"] = eqx.field(default=-np.inf, converter=jnp.asarray)
    upper: Float[Array, "#n"] = eqx.field(default=np.inf, converter=jnp.asarray)
    feedback: bool = eqx.field(default=True, static=True)

    def __check_init__(self) -> None:
        """Refuse bounds that leave no room."""
        bounds = (self.lower, self.upper)
        if not any(isinstance(b, jax.core.Tracer) for b in bounds) and not np.all(self.lower < self.upper):
            raise ValueError(f"each lower bound must lie below its upper, got {self.lower} and {self.upper}")

    def init(self, model: StateSpaceModel) -> Any:
        """The state of the filter inside."""
        return self.filter.init(model)

    def predict(self, model: StateSpaceModel, state: Any, u: Any, dt: Float[Array, ""]) -> Any:
        """Time update."""
        return self._projected(self.filter.predict(model, state, u, dt))[0]

    def update(self, model: StateSpaceModel, state: Any, u: Any, z: Float[Array, " m"]) -> tuple[Any, Info]:
        """Measurement update."""
        state, info = self.filter.update(model, state, u, z)
        state, moved = self._projected(state)
        says = moved & info.ok & (info.reason != Reason.NO_MEASUREMENT)
        return state, replace(info, reason=jnp.where(says, Reason.PROJECTED, info.reason))

    def posterior(self, state: Any) -> Gaussian:
        """The Gaussian of the filter inside, cut off at the bounds."""
        gaussian = self.filter.posterior(state)
        return truncate(gaussian, *self._bounds(gaussian))

    def _is_finite(self, state: Any) -> Bool[Array, ""]:
        return self.filter._is_finite(state)

    def _projected(self, state: Any) -> tuple[Any, Array]:
        gaussian = self.filter.posterior(state)
        if not self.feedback:
            return state, jnp.zeros((), bool)
        lower, upper = self._bounds(gaussian)
        outside = jnp.any((gaussian.mean < lower) | (gaussian.mean > upper))
        return eqx.tree_at(self.filter.posterior, state, project(gaussian, lower, upper)), outside

    def _bounds(self, gaussian: Gaussian) -> tuple[Array, Array]:
        mean = gaussian.mean
        lower, upper = self.lower.astype(mean.dtype), self.upper.astype(mean.dtype)
        return jnp.broadcast_to(lower, mean.shape), jnp.broadcast_to(upper, mean.shape)
