"""The scaled unscented Kalman filter, in square-root form."""

from __future__ import annotations

from math import sqrt
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.core.gaussian import Gaussian, Info
from roadstate.filters.base import FilterState, GateRule, GaussianFilter, Moved
from roadstate.linalg import once, tria
from roadstate.statespace import StateSpaceModel


class _Moments(NamedTuple):
    """Mean of transformed points, and the columns whose outer products sum to their covariance.

    ``paired`` has a column for each of the 2n outer points (so that cross covariances can be formed with
    the points' own deviations), ``center`` the one column that the centre point adds.
    """

    mean: Float[Array, " m"]
    paired: Float[Array, "m k"]
    center: Float[Array, "m 1"]


class UKF(GaussianFilter):
    """Unscented Kalman filter with scaled sigma points.

    Points x̂, x̂ ± √(n+λ) S_i with λ = α²(n+κ) − n; weights w_m⁰ = λ/(n+λ), w_c⁰ = w_m⁰ + 1 − α² + β, all
    others 1/(2(n+λ)) (Wan & van der Merwe 2000; paper 002 eqs. 13–24, of which eq. 22 must read
    G = P_xz P_zz⁻¹). Sigma points are drawn anew before the measurement update (eq. 17).

    With d_i = z_i − z_0 and c = ẑ − z_0, the covariance Σ w_c (z_i − ẑ)(z_i − ẑ)ᵀ equals
    Σ_{i≥1} w_i d_i d_iᵀ + (β − α²) c cᵀ: a sum of squares whatever the sign of w_c⁰, free of the
    cancellation that a small α brings, and so fit for triangularisation.

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
        """f at the sigma points; the centre's column is uncorrelated with x."""
        u = once(u)
        points = self._points(gaussian)
        moments = self._moments(once(jax.vmap(lambda x: model.f(x, u, dt))(points)))
        noise = jnp.concatenate([moments.center, model.sqrt_Q(u, dt)], axis=1)
        return Moved(moments.mean, self._moments(points).paired, moments.paired, noise)

    def update(
        self, model: StateSpaceModel, state: FilterState, u: Any, z: Float[Array, " m"]
    ) -> tuple[FilterState, Info]:
        """Measurement update."""
        points = self._points(state.gaussian)
        state_rows = self._moments(points).paired
        seen = self._moments(jax.vmap(lambda x: model.h(x, u))(points))
        # the centre's column is uncorrelated with x: noise, as far as the update is concerned
        noise = tria(jnp.concatenate([model.sqrt_R(u), seen.center], axis=1))
        return self._condition(state, z, seen.mean, state_rows, seen.paired, noise)

    def _points(self, gaussian: Gaussian) -> Float[Array, "k n"]:
        n = gaussian.mean.shape[0]
        offsets = self.alpha * sqrt(n + self.kappa) * gaussian.factor.T
        return jnp.concatenate([gaussian.mean[None], gaussian.mean + offsets, gaussian.mean - offsets])

    def _moments(self, values: Float[Array, "k m"]) -> _Moments:
        n = (values.shape[0] - 1) // 2
        weight = 1 / (2 * self.alpha**2 * (n + self.kappa))
        from_center = values[1:] - values[0]
        shift = weight * jnp.sum(from_center, axis=0)
        if self.beta >= self.alpha**2:
            paired, share = from_center, self.beta - self.alpha**2
        else:  # α = 1, κ ≥ 0: every weight is positive as it stands
            paired, share = from_center - shift, self.kappa / (n + self.kappa) + self.beta
        center = sqrt(share) * shift
        return _Moments(values[0] + shift, sqrt(weight) * paired.T, center[:, None])
