"""The extended Kalman filter and its iterated form, in square-root form."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from roadstate.core.gaussian import Gate, Gaussian, Info
from roadstate.filters.base import FilterState
from roadstate.filters.kf import KF, linearize
from roadstate.linalg import correct, product, solve_lower, tria
from roadstate.statespace import StateSpaceModel

_STEPS = (1.0, 0.5, 0.25, 0.125)
"""Fractions of a Gauss–Newton step that are tried; a full step can overshoot."""


class EKF(KF):
    """Extended Kalman filter: the Kalman filter of the model linearised at the current estimate.

    x̂⁻ = f(x̂), P⁻ = F P Fᵀ + Q with F = ∂f/∂x at x̂; K = P⁻HᵀS⁻¹, P = (I − KH)P⁻ with H = ∂h/∂x at x̂⁻
    (Simon, *Optimal State Estimation*, ch. 13; paper 000 eqs. 18–19 and 22–23). The Jacobians come from
    automatic differentiation. The steps are :class:`~roadstate.filters.kf.KF`'s own: only the claim differs,
    which for a curved f or h is first order.

    Attributes:
        gate: innovation gate, or ``None`` to take every sample.
    """

    name: ClassVar[str] = "ekf"

    def take(
        self,
        state: FilterState,
        z: Float[Array, " m"],
        z_hat: Float[Array, " m"],
        sensor_rows: Float[Array, "m n"],
        sqrt_R: Float[Array, "m m"],
    ) -> tuple[FilterState, Info]:
        """Condition on a linearised measurement that the caller has formed.

        Args:
            state: the Gaussian before the samples, with factor S.
            z: (m,) samples, NaN where missing.
            z_hat: (m,) what they were expected to be.
            sensor_rows: (m, n) H S.
            sqrt_R: (m, m) any factor of R.
        """
        return self._condition(state, z, z_hat, state.gaussian.factor, sensor_rows, sqrt_R)


def standard_normal(like: Gaussian) -> Gaussian:
    """N(0, I) of the size and dtype of ``like``."""
    return Gaussian(jnp.zeros_like(like.mean), jnp.eye(like.mean.shape[0], dtype=like.mean.dtype))


class _Iterate(NamedTuple):
    w: Float[Array, " n"]
    factor: Float[Array, "n n"]
    cost: Float[Array, ""]


class IteratedEKF(EKF):
    """Extended Kalman filter whose update is iterated: damped Gauss–Newton on the posterior's logarithm.

    The update minimises J(x) = ‖S⁻¹(x − x̂⁻)‖² + ‖√R⁻¹(z − h(x))‖², linearising h anew at each iterate
    (Bell & Cathey 1993; Bar-Shalom, Li & Kirubarajan, *Estimation with Applications to Tracking and
    Navigation*, ch. 10.5.2). It is solved for w in x = x̂⁻ + S w, where the prior is standard: no inverse of a
    covariance is taken, so directions without uncertainty do no harm. Of each step the best of a few
    fractions is taken, so J cannot grow. P belongs to the last linearisation; innovation, S and NIS of
    :class:`Info` are the EKF's, for they judge the prediction.

    Attributes:
        iterations: Gauss–Newton steps after the EKF's own; their number is fixed.
        gate: innovation gate, or ``None`` to take every sample.
    """

    name: ClassVar[str] = "iekf"
    iterations: int = eqx.field(default=3, static=True, kw_only=True)

    def update(
        self, model: StateSpaceModel, state: FilterState, u: Any, z: Float[Array, " m"]
    ) -> tuple[FilterState, Info]:
        """Measurement update."""
        first, info = super().update(model, state, u, z)
        prior, sqrt_R = state.gaussian, model.sqrt_R(u)
        used = jnp.isfinite(z) & (info.gate != Gate.REJECTED)
        cost = _cost(model, prior, u, z, used, sqrt_R)

        def iterate(_: int, now: _Iterate) -> _Iterate:
            z_hat, H = linearize(
                lambda x: model.h(x, u), prior.mean + product(prior.factor, now.w[:, None])[:, 0]
            )
            rows = product(H, prior.factor)
            innovation = z - z_hat + product(rows, now.w[:, None])[:, 0]
            identity = jnp.eye(prior.mean.shape[0], dtype=prior.mean.dtype)
            target = correct(identity, rows, sqrt_R, innovation, used)
            tried = now.w + jnp.asarray(_STEPS, now.w.dtype)[:, None] * (target.delta - now.w)
            costs = jax.vmap(cost)(tried)
            best = jnp.argmin(costs)
            better = costs[best] < now.cost
            return _Iterate(
                jnp.where(better, tried[best], now.w),
                target.factor,
                jnp.where(better, costs[best], now.cost),
            )

        origin = jnp.zeros_like(prior.mean)
        start = _Iterate(origin, jnp.zeros_like(prior.factor), cost(origin))
        last = jax.lax.fori_loop(0, self.iterations + 1, iterate, start)
        mean = prior.mean + product(prior.factor, last.w[:, None])[:, 0]
        factor = product(prior.factor, last.factor)
        sound = (
            info.ok & jnp.all(jnp.isfinite(mean)) & jnp.all(jnp.isfinite(factor)) & jnp.isfinite(last.cost)
        )
        gaussian = Gaussian(
            jnp.where(sound, mean, first.gaussian.mean), jnp.where(sound, factor, first.gaussian.factor)
        )
        return first._replace(gaussian=gaussian), info


def _cost(
    model: StateSpaceModel,
    prior: Gaussian,
    u: Any,
    z: Float[Array, " m"],
    used: Bool[Array, " m"],
    sqrt_R: Float[Array, "m m"],
) -> Callable[[Float[Array, " n"]], Float[Array, ""]]:
    """J(w) over the sensors used; infinite where it cannot be computed (a sensor without noise, say)."""
    kept = jnp.where(used[:, None], sqrt_R, 0)
    noise = tria(jnp.concatenate([kept, jnp.diag((~used).astype(sqrt_R.dtype))], axis=1))

    def cost(w: Float[Array, " n"]) -> Float[Array, ""]:
        x = prior.mean + product(prior.factor, w[:, None])[:, 0]
        whitened = solve_lower(noise, jnp.where(used, z - model.h(x, u), 0))
        total = jnp.sum(w**2) + jnp.sum(whitened**2)
        return jnp.where(jnp.isfinite(total), total, jnp.inf)

    return cost
