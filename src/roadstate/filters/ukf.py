"""The scaled unscented Kalman filter, in square-root form."""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.core.gaussian import Gaussian, Info
from roadstate.core.kernel import once
from roadstate.filters.base import FilterState, GateRule, GaussianFilter, Moved
from roadstate.linalg import beside
from roadstate.statespace import StateSpaceModel


class Pairs(NamedTuple):
    """What y makes of pairs of points x̂ ± c S_i: Cov(x, y) = S odd, Cov(y) = oddᵀ odd + evenᵀ even.

    Attributes:
        mean: of y.
        odd: (l, …) what changes sign across the centre: all that is correlated with x = x̂ + S w.
        even: (l, …) what does not, and vanishes where there is no curvature.
    """

    mean: Array
    odd: Float[Array, "l ..."]
    even: Float[Array, "l ..."]


class UKF(GaussianFilter):
    """Unscented Kalman filter with scaled sigma points.

    Points x̂, x̂ ± √(n+λ) S_i with λ = α²(n+κ) − n; weights w_m⁰ = λ/(n+λ), w_c⁰ = w_m⁰ + 1 − α² + β, all
    others 1/(2(n+λ)) (Wan & van der Merwe 2000; paper 002 eqs. 13–24, of which eq. 22 must read
    G = P_xz P_zz⁻¹). Sigma points are drawn anew before the measurement update (eq. 17).

    With d± the deviations of a pair of points from the centre's image, and c the mean less that image, the
    covariance equals Σ w (d₊d₊ᵀ + d₋d₋ᵀ) + (β − α²) c cᵀ: free of the cancellation that a small α brings. Its
    columns (d₊ − d₋)√(w/2) are all that is correlated with x, so that P_xz = S · odd with S as it stands;
    c is a multiple of the sum of the others, (d₊ + d₋)√(w/2), and is put into them: E(I + g 11ᵀ) with
    (1 + g n)² = 1 + 2wn(β − α²), which is positive for all parameters accepted here.

    Attributes:
        alpha: spread of the points around the mean, 0 < α ≤ 1.
        beta: prior knowledge of the distribution; 2 suits a Gaussian. α = 1, β = κ = 0 is the cubature rule.
        kappa: secondary spread; n + κ must be positive.
        gate: innovation gate, or ``None`` to take every sample.

    Raises:
        ValueError: parameters for which the covariance need not be positive (β < 0, or β < α² with κ < 0 or
            α < 1); in :meth:`init`, n + κ ≤ 0.
    """

    name: ClassVar[str] = "ukf"
    alpha: float = eqx.field(default=1.0, static=True, kw_only=True)
    beta: float = eqx.field(default=2.0, static=True, kw_only=True)
    kappa: float = eqx.field(default=0.0, static=True, kw_only=True)
    gate: GateRule | None = eqx.field(default=None, kw_only=True)

    def __check_init__(self) -> None:
        """Refuse parameters that can yield an indefinite covariance."""
        if not 0 < self.alpha <= 1:
            raise ValueError(f"alpha must lie in (0, 1], got {self.alpha}")
        if not self.beta >= 0:
            raise ValueError(f"beta must not be negative, got {self.beta}; 2 suits a Gaussian")
        if self.beta < self.alpha**2 and (self.kappa < 0 or self.alpha < 1):
            raise ValueError("beta < alpha² can give an indefinite covariance here; choose beta = 2")

    def init(self, model: StateSpaceModel) -> FilterState:
        """The model's prior, with clear gates."""
        n = len(model.states)
        if not n + self.kappa > 0:
            raise ValueError(f"kappa must exceed -{n} with {n} states, got {self.kappa}")
        return super().init(model)

    def move(self, model: StateSpaceModel, gaussian: Gaussian, u: Any, dt: Float[Array, ""]) -> Moved:
        """f at the sigma points; what the even parts hold is uncorrelated with x."""
        u = once(u)
        seen = self._image_of(lambda x: model.f(x, u, dt), gaussian)
        return Moved(seen.mean, gaussian.factor, seen.odd.T, (seen.even.T, model.sqrt_Q(u, dt)))

    def update(
        self, model: StateSpaceModel, state: FilterState, u: Any, z: Float[Array, " m"]
    ) -> tuple[FilterState, Info]:
        """Measurement update."""
        seen = self._image_of(lambda x: model.h(x, u), state.gaussian)
        # even parts are uncorrelated with x: noise, as far as the update is concerned
        noise = beside(model.sqrt_R(u), seen.even.T)
        return self._condition(state, z, seen.mean, state.gaussian.factor, seen.odd.T, noise)

    def _image_of(
        self, function: Callable[[Float[Array, " n"]], Float[Array, " m"]], gaussian: Gaussian
    ) -> Pairs:
        spread = self.alpha * sqrt(gaussian.mean.shape[0] + self.kappa)
        return self._pairs(once(jax.vmap(function)(self._points(gaussian))), spread)

    def _points(self, gaussian: Gaussian) -> Float[Array, "k n"]:
        n = gaussian.mean.shape[0]
        offsets = self.alpha * sqrt(n + self.kappa) * gaussian.factor
        mean = gaussian.mean[:, None]
        return beside(mean, mean + offsets, mean - offsets).T

    def _pairs(self, values: Float[Array, "p ..."], spread: float) -> Pairs:
        """Moments of values at the centre, at the points on one side, and at those opposite.

        Args:
            values: (2l + 1, …).
            spread: c.
        """
        count = (values.shape[0] - 1) // 2
        if not count:
            return Pairs(values[0], values[1:], values[1:])
        weight = 1 / (2 * spread**2)
        ahead, behind = once((values[1 : count + 1] - values[0], values[count + 1 :] - values[0]))
        both = once(ahead + behind)
        total = jnp.sum(both, axis=0)
        share = sqrt(1 + 2 * weight * count * (self.beta - self.alpha**2))
        scale = sqrt(weight / 2)
        even = scale * (both + (share - 1) / count * total)
        return Pairs(values[0] + weight * total, scale * (ahead - behind), even)
