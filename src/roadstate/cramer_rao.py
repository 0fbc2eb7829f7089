"""The posterior Cramér–Rao bound: how well any estimator could know the states along a drive."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core.numerics import jit_loop
from roadstate.dense import solve_lower
from roadstate.filters.weighted import masked
from roadstate.linalg import correct, product, tria
from roadstate.statespace import StateSpaceModel

_GROUND = 64.0
"""Noise in a direction counts as none below this many rounding errors of the largest."""


class CramerRaoBound(NamedTuple):
    """Least covariance of the error at each sample.

    Attributes:
        factor: (T, n, n) lower-triangular factors.
    """

    factor: Float[Array, "T n n"]

    @property
    def std(self) -> Float[Array, "T n"]:
        """(T, n) least standard deviation of each state."""
        return jnp.sqrt(jnp.sum(self.factor**2, axis=-1))


def cramer_rao_bound(
    model: StateSpaceModel,
    states: Float[Array, "T n"] | Float[Array, "M T n"],
    inputs: Any,
    dt: Float[Array, " T"],
    *,
    present: Bool[Array, "T m"] | None = None,
) -> CramerRaoBound:
    """Posterior Cramér–Rao bound along a drive (Tichavský, Muravchik & Nehorai 1998).

    For additive Gaussian noises the recursion is J⁺ = Q⁻¹ + E[HᵀR⁻¹H] − Q⁻¹F̄ (J + E[FᵀQ⁻¹F])⁻¹ F̄ᵀQ⁻¹ with
    F, H the Jacobians at the true states. With V = E[(F − F̄)ᵀQ⁻¹(F − F̄)] that equals

        P⁻ = F̄ (P⁻¹ + V)⁻¹ F̄ᵀ + Q,   P = (P⁻⁻¹ + E[HᵀR⁻¹H])⁻¹,

    which needs no inverse of Q and is run in square-root form. For one drive V = 0, and the bound is the
    covariance of an extended Kalman filter that linearises at the truth (Taylor 1979). From several drives
    expectations are means. Directions in which a step has no noise add nothing to V: where F varies in one of
    them the result is somewhat above the bound.

    The prior is the model's. F of the first step is taken at the first sample's state.

    Args:
        model: of n states and m sensors.
        states: (T, n) true states of the drive, or (M, T, n) of M drives with the same inputs.
        inputs: u of each sample, a pytree with leading axis T, or ``None``.
        dt: (T,) s since the sample before.
        present: (T, m) which samples there are; all by default.
    """
    truth = jnp.asarray(states)
    truth = truth[None] if truth.ndim == 2 else truth
    there = jnp.ones((truth.shape[1], len(model.sensors)), bool) if present is None else jnp.asarray(present)
    return CramerRaoBound(cast(Array, _bound(model, truth, inputs, jnp.asarray(dt), there)))


@jit_loop
def _bound(model: StateSpaceModel, truth: Array, inputs: Any, dt: Array, present: Array) -> Any:
    def step(S: Array, row: Any) -> tuple[Array, Array]:
        before, now, u, step_dt, used = row
        F = jax.vmap(jax.jacfwd(lambda x: model.f(x, u, step_dt)))(before)
        root = model.sqrt_Q(u, step_dt)
        mean_F = jnp.mean(F, axis=0)
        if len(F) > 1:
            S = _inform(S, _whiten_within(root, F - mean_F))
        S = tria(jnp.concatenate([product(mean_F, S), root], axis=1))
        H = jax.vmap(jax.jacfwd(lambda x: model.h(x, u)))(now)
        S = _inform(S, _whiten(masked(model.sqrt_R(u), used), jnp.where(used[:, None], H, 0)))
        return S, S

    by_time = jnp.swapaxes(truth, 0, 1)
    before = jnp.concatenate([by_time[:1], by_time[:-1]])
    return jax.lax.scan(step, model.prior().factor, (before, by_time, inputs, dt, present))[1]


def _whiten(L: Float[Array, "m m"], rows: Float[Array, "M m n"]) -> Float[Array, "M m n"]:
    """L⁻¹ of each of M sets of rows."""
    return jax.vmap(lambda r: solve_lower(L, r))(rows)


def _whiten_within(root: Float[Array, "n q"], rows: Float[Array, "M n k"]) -> Float[Array, "M r k"]:
    """Rows over the noise of their direction, in the directions that have any."""
    size = jnp.sqrt(jnp.sum(root**2, axis=1, keepdims=True))  # states differ in unit, so in scale
    size = jnp.where(size > 0, size, 1)
    U, s, _ = jnp.linalg.svd(root / size, full_matrices=False)
    ground = _GROUND * float(np.finfo(root.dtype).eps)
    inverse = jnp.where(s > ground, 1 / jnp.where(s > ground, s, 1), 0)
    return inverse[:, None] * (U.T @ (rows / size))


def _inform(S: Float[Array, "n n"], rows: Float[Array, "M m n"]) -> Float[Array, "n n"]:
    """Factor of (P⁻¹ + mean of rowsᵀ rows)⁻¹."""
    n = S.shape[0]
    whole = rows.reshape(-1, n) / jnp.sqrt(jnp.asarray(rows.shape[0], S.dtype))
    # no more than n rows hold all that more of them tell
    Y = whole if len(whole) <= n else tria(whole.T).T
    identity = jnp.eye(len(Y), dtype=S.dtype)
    return correct(S, product(Y, S), identity, jnp.zeros(len(Y), S.dtype), jnp.ones(len(Y), bool)).factor
