"""The Rao–Blackwellised particle filter: particles where there is curvature, a Kalman filter in each."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from roadstate.core.gaussian import Gaussian, Info
from roadstate.filters.base import LOG_2PI, examine
from roadstate.filters.draws import Draws
from roadstate.filters.particle import SIR
from roadstate.filters.weighted import deviations, gaussian, normalized, told
from roadstate.linalg import correct, tria
from roadstate.statespace import StateSpaceModel


class RaoBlackwellState(NamedTuple):
    """State of a :class:`RaoBlackwellPF`: a sampled, b Gaussian given a.

    Attributes:
        sampled: (n_a, N) a, one particle a column.
        mean: (n_b, N) mean of b in each particle.
        factor: (n_b, n_b, N) its covariance's factor.
        log_weights: (N,) normalised.
        draws: place in the random sequence.
        rejected: (m,) how many samples of each sensor the gate has refused in a row.
        order: (n,) rows of x as [a, b].
    """

    sampled: Float[Array, "n_a N"]
    mean: Float[Array, "n_b N"]
    factor: Float[Array, "n_b n_b N"]
    log_weights: Float[Array, " N"]
    draws: Draws
    rejected: Int[Array, " m"]
    order: Int[Array, " n"]


class RaoBlackwellPF(SIR[RaoBlackwellState]):
    """Particle filter over the states that enter nonlinearly, with an exact Kalman filter for the rest.

    x = (a, b), f and h affine in b given a; ``model.nonlinear`` names a. Each particle holds a sample of a
    and N(b̂, S_b S_bᵀ). In the time update the deviations [∂f/∂b S_b, √Q] are triangularised with a on top,
    [[L_aa, 0], [L_ba, L_bb]]: a is drawn by L_aa ε, and what that draw says of b is L_ba ε, L_bb its new
    factor (Schön, Gustafsson & Nordlund 2005, whose "extra measurement" this is). Weights are the Kalman
    filters' likelihoods. For the same error it needs fewer particles than
    :class:`~roadstate.filters.particle.ParticleFilter`, by as much as b would have spread them.

    Without any nonlinear state all particles are the Kalman filter; with no other it is the particle filter.

    Attributes:
        particles, threshold, resampling, seed, gate: see :class:`~roadstate.filters.particle.SIR`.
    """

    name: ClassVar[str] = "rao-blackwell"
    particles: int = eqx.field(default=200, static=True, kw_only=True)

    def init(self, model: StateSpaceModel) -> RaoBlackwellState:
        """Particles drawn from the model's prior of a, each with the prior of b given it."""
        prior, draws, order = model.prior(), Draws.seeded(self.seed), _order(model)
        dtype, count = prior.mean.dtype, len(model.nonlinear)
        L = tria(prior.factor[order])
        moved = L[:, :count] @ draws.normal((count, self.particles), dtype)
        start = prior.mean[order][:, None] + moved
        shape = (*L[count:, count:].shape, self.particles)
        return RaoBlackwellState(
            sampled=start[:count],
            mean=start[count:],
            factor=jnp.broadcast_to(L[count:, count:, None], shape),
            log_weights=self._equal(dtype),
            draws=draws,
            rejected=jnp.zeros(len(model.sensors), jnp.int32),
            order=jnp.asarray(order),
        )

    def predict(
        self, model: StateSpaceModel, state: RaoBlackwellState, u: Any, dt: Float[Array, ""]
    ) -> RaoBlackwellState:
        """Resample where needed, then draw each particle's next a and move its Gaussian."""
        draws, order = state.draws.next(), _order(model)
        held = state.sampled, state.mean, state.factor
        kept, log_weights = self._renew(held, state.log_weights, draws, dt)
        count, root = kept[0].shape[0], model.sqrt_Q(u, dt)[order]
        root = jnp.pad(root, ((0, 0), (0, max(0, count - root.shape[1]))))  # √Q may have fewer columns than a

        def move(a: Array, b: Array, S: Array, normal: Array) -> tuple[Array, Array, Array]:
            value, rows = _along(lambda x: model.f(x, u, dt), order, a, b, S)
            L = tria(jnp.concatenate([rows[order], root], axis=1))
            new = value[order] + L[:, :count] @ normal
            return new[:count], new[count:], L[count:, count:]

        normal = draws.normal((count, self.particles), log_weights.dtype)
        moved = jax.vmap(move, -1, -1)(*kept, normal)
        alive = jnp.ones(self.particles, bool)
        for part in moved:
            alive &= jnp.all(jnp.isfinite(part), axis=tuple(range(part.ndim - 1)))
        sampled, mean, factor = (jnp.where(alive, new, old) for new, old in zip(moved, kept, strict=True))
        log_weights = jnp.where(alive, log_weights, -jnp.inf)
        return state._replace(sampled=sampled, mean=mean, factor=factor, log_weights=log_weights, draws=draws)

    def update(
        self, model: StateSpaceModel, state: RaoBlackwellState, u: Any, z: Float[Array, " m"]
    ) -> tuple[RaoBlackwellState, Info]:
        """Update each particle's Gaussian, and weigh it by how well it foretold the samples."""
        order, sqrt_R = _order(model), model.sqrt_R(u)
        held = state.sampled, state.mean, state.factor

        def look(a: Array, b: Array, S: Array) -> tuple[Array, Array]:
            return _along(lambda x: model.h(x, u), order, a, b, S)

        seen, rows = jax.vmap(look, -1, -1)(*held)
        alive = jnp.all(jnp.isfinite(seen), axis=0) & jnp.all(jnp.isfinite(rows), axis=(0, 1))
        seen, rows = jnp.where(alive, seen, 0), jnp.where(alive, rows, 0)
        before, _ = normalized(jnp.where(alive, state.log_weights, -jnp.inf))
        z_hat, spread = deviations(seen, before)
        within = _side_by_side(rows * jnp.exp(0.5 * before))
        factor = tria(jnp.concatenate([sqrt_R, spread, within], axis=1))
        innovation = jnp.where(jnp.isfinite(z), z - z_hat, jnp.nan)
        variance = jnp.sum(factor**2, axis=1)
        used, codes, rejected = examine(self.gate, innovation, variance, state.rejected)

        def condition(b: Array, S: Array, z_hat: Array, rows: Array) -> tuple[Array, Array, Array]:
            result = correct(S, rows, sqrt_R, z - z_hat, used)
            return b + result.delta, result.factor, -0.5 * (result.nis + result.log_det)

        mean, new_factor, log_likelihoods = jax.vmap(condition, -1, -1)(state.mean, state.factor, seen, rows)
        log_weights, log_likelihood = normalized(before + log_likelihoods)
        ok = jnp.isfinite(log_likelihood)
        new = state._replace(
            mean=jnp.where(ok & alive, mean, state.mean),
            factor=jnp.where(ok & alive, new_factor, state.factor),
            log_weights=jnp.where(ok, log_weights, state.log_weights),
            rejected=rejected,
        )
        constant = 0.5 * LOG_2PI * jnp.sum(used)
        return new, told(innovation, factor, log_likelihood - constant, used, codes, ok)

    def posterior(self, state: RaoBlackwellState) -> Gaussian:
        """Mean and covariance of the mixture."""
        log_weights, _ = normalized(state.log_weights)
        mean, between = deviations(jnp.concatenate([state.sampled, state.mean]), log_weights)
        within = _side_by_side(state.factor * jnp.exp(0.5 * log_weights))
        within = jnp.pad(within, ((state.sampled.shape[0], 0), (0, 0)))
        back = jnp.argsort(state.order)
        return gaussian(mean[back], jnp.concatenate([between, within], axis=1)[back])

    def _is_finite(self, state: RaoBlackwellState) -> Bool[Array, ""]:
        return jnp.any(state.log_weights > -jnp.inf)


def _order(model: StateSpaceModel) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Rows of x, the nonlinear ones first."""
    first = [model.states.index(name) for name in model.nonlinear]
    return np.array(first + [i for i in range(len(model.states)) if i not in first], np.int64)


def _side_by_side(matrices: Float[Array, "m k N"]) -> Float[Array, "m columns"]:
    m, k, count = matrices.shape
    return matrices.reshape(m, k * count)


def _along(
    function: Any, order: Any, a: Float[Array, " n_a"], b: Float[Array, " n_b"], S: Float[Array, "n_b n_b"]
) -> tuple[Float[Array, " m"], Float[Array, "m n_b"]]:
    """The function's value at (a, b), and what it makes of the columns of S."""
    back = np.argsort(order)
    value, slope = jax.linearize(lambda b: function(jnp.concatenate([a, b])[back]), b)
    return value, jax.vmap(slope, 1, 1)(S)
