"""The extended H∞ filter, in square-root form."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.core.gaussian import Gaussian, Info, Reason
from roadstate.filters.base import Filter, FilterState, GateRule
from roadstate.filters.ekf import EKF, standard_normal
from roadstate.filters.kf import linearize
from roadstate.filters.spectral import spectral
from roadstate.linalg import product, solve_lower, tria
from roadstate.statespace import StateSpaceModel


class HInfinityState(NamedTuple):
    """State of :class:`ExtendedHInfinity`.

    Attributes:
        kalman: x̂, a factor of P and the gates.
        theta: the θ that the last update used; 0 where it had no sample.
    """

    kalman: FilterState
    theta: Float[Array, ""]


class ExtendedHInfinity(Filter[HInfinityState]):
    """Extended H∞ filter: bounds the energy gain from all disturbances to the estimation error by 1/θ.

    M = (I − θS̄P⁻ + HᵀR⁻¹HP⁻)⁻¹, K = P⁻MHᵀR⁻¹, P⁺ = P⁻M with S̄ = LᵀL (Simon, *Optimal State Estimation*,
    ch. 11.3; paper 000 §2.3, where eq. 25 lacks the inverse, eq. 26 must read P⁻ and γ stands for θ = 1/γ²).
    It needs P⁻⁻¹ − θS̄ + HᵀR⁻¹H ≻ 0.

    In square-root form, the extended Kalman update comes first, P = S Sᵀ. From P⁺⁻¹ = P⁻¹ − θS̄ follows
    P⁺ = S(I − θW)⁻¹Sᵀ with W = SᵀS̄S, so the eigenvalues λ of W show what θ is possible: θλ < 1. Where θ
    is too large it is reduced, for this sample and this eigenvector only, so that λ/(1 − θλ) does not pass
    ``ceiling/θ`` unless λ, the Kalman filter's, does already; the update says :attr:`Reason.THETA_REDUCED`.
    (Stopping at a fixed margin below 1/λ would multiply the covariance of a state that is not observed by
    the same factor at each sample, without end.) θ counts at each sample that is taken, not while samples
    are missing.

    P⁺ is a bound, not the covariance of the error: it is larger than the Kalman filter's. The bound on the
    gain holds as long as θ was never reduced.

    Attributes:
        theta: θ ≥ 0, in 1/(unit of L x)²; 0 is the EKF.
        weight: L, what the error is weighted with, (k, n) or (n,) for a diagonal; ``None`` is the identity.
        ceiling: largest eigenvalue of θ L P⁺ Lᵀ that θ may cause. Up to 1 no update makes an error larger;
            above, near θλ = 1, the gain overshoots: with 5, a harmless two-state system amplified
            disturbances by 10⁵.
        gate: innovation gate, or ``None`` to take every sample.
    """

    name: ClassVar[str] = "h-infinity"
    theta: Float[Array, ""] = eqx.field(default=0.1, kw_only=True, converter=jnp.asarray)
    weight: Float[Array, "k n"] | Float[Array, " n"] | None = eqx.field(default=None, kw_only=True)
    ceiling: float = eqx.field(default=1.0, static=True, kw_only=True)
    gate: GateRule | None = eqx.field(default=None, kw_only=True)

    def init(self, model: StateSpaceModel) -> HInfinityState:
        """The model's prior, with clear gates."""
        kalman = EKF(gate=self.gate).init(model)
        return HInfinityState(kalman, jnp.zeros((), kalman.gaussian.mean.dtype))

    def predict(
        self, model: StateSpaceModel, state: HInfinityState, u: Any, dt: Float[Array, ""]
    ) -> HInfinityState:
        """Time update: the EKF's."""
        return state._replace(kalman=EKF(gate=self.gate).predict(model, state.kalman, u, dt))

    def update(
        self, model: StateSpaceModel, state: HInfinityState, u: Any, z: Float[Array, " m"]
    ) -> tuple[HInfinityState, Info]:
        """Measurement update."""
        prior, rejected = state.kalman.gaussian, state.kalman.rejected
        z_hat, H = linearize(lambda x: model.h(x, u), prior.mean)
        # in the coordinates w of x = x̂⁻ + S⁻w, whose posterior factor always has an inverse
        whitened = FilterState(standard_normal(prior), rejected)
        sensor_rows = product(H, prior.factor)
        whitened, info = EKF(gate=self.gate).take(whitened, z, z_hat, sensor_rows, model.sqrt_R(u))
        w, factor = whitened.gaussian.mean, whitened.gaussian.factor
        S = product(prior.factor, factor)

        weighted = self._weigh(S)
        theta = jnp.where(info.reason == Reason.NO_MEASUREMENT, 0, self.theta.astype(S.dtype))
        (root,), eigenvalues = spectral(self._root_inflation, product(weighted.T, weighted), theta)
        along = product(root, product(root, solve_lower(factor, w)[:, None]))
        mean = prior.mean + product(S, along)[:, 0]
        posterior = tria(product(S, root))

        finite = info.ok & jnp.all(jnp.isfinite(mean)) & jnp.all(jnp.isfinite(posterior))
        gaussian = Gaussian(jnp.where(finite, mean, prior.mean), jnp.where(finite, posterior, prior.factor))
        least = self._possible(jnp.max(eigenvalues), theta)
        reason = jnp.where(least < theta, Reason.THETA_REDUCED, info.reason)
        reason = jnp.where(finite, reason, Reason.NOT_FINITE)
        kalman = FilterState(gaussian, whitened.rejected)
        return HInfinityState(kalman, least), replace(info, ok=finite, reason=reason)

    def posterior(self, state: HInfinityState) -> Gaussian:
        """x̂ and the bound P⁺."""
        return state.kalman.gaussian

    def _weigh(self, S: Float[Array, "n n"]) -> Float[Array, "k n"]:
        if self.weight is None:
            return S
        weight = self.weight.astype(S.dtype)
        return weight[:, None] * S if weight.ndim == 1 else product(weight, S)

    def _possible(self, eigenvalues: Float[Array, "*k"], theta: Float[Array, ""]) -> Float[Array, "*k"]:
        """θ, or what of it each eigenvalue of W leaves room for."""
        positive = eigenvalues > 0
        room = 1 / jnp.where(positive, eigenvalues, 1) - theta / self.ceiling
        return jnp.where(positive, jnp.clip(room, 0, theta), theta)

    def _root_inflation(
        self, eigenvalues: Float[Array, " n"], theta: Float[Array, ""]
    ) -> Float[Array, "1 n"]:
        possible = self._possible(eigenvalues, theta)
        return 1 / jnp.sqrt(1 - possible * jnp.clip(eigenvalues, 0))[None]
