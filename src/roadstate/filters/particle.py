"""The bootstrap (SIR) particle filter."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from roadstate.core.gaussian import Gaussian, Info
from roadstate.filters.base import LOG_2PI, Filter, GateRule, examine
from roadstate.filters.draws import Draws
from roadstate.filters.jitter import Jitter
from roadstate.filters.resampling import RESAMPLING
from roadstate.filters.weighted import deviations, effective_number, gaussian, masked, normalized, told
from roadstate.linalg import solve_lower, tria
from roadstate.statespace import StateSpaceModel

_CHOICE, _JITTER = 1, 2
"""Streams of random numbers within a step; 0 is the process noise."""


class ParticleState(NamedTuple):
    """State of a :class:`ParticleFilter`.

    Attributes:
        particles: (n, N) one a column, so that each state of all particles lies together in memory.
        log_weights: (N,) normalised.
        draws: place in the random sequence.
        rejected: (m,) how many samples of each sensor the gate has refused in a row.
    """

    particles: Float[Array, "n N"]
    log_weights: Float[Array, " N"]
    draws: Draws
    rejected: Int[Array, " m"]


S = TypeVar("S")
T = TypeVar("T")


class SIR(Filter[S]):
    """What particle filters share that propose from the model and resample when weights degenerate.

    Attributes:
        particles: N.
        threshold: resample when N_eff = 1/Σw² falls below this share of N; 1 at every step, 0 never.
        resampling: one of :data:`~roadstate.filters.resampling.RESAMPLING`.
        seed: of the random numbers; an array (a leaf), so that runs can be batched over seeds.
        gate: innovation gate, on the first two moments of the predicted measurement, or ``None``.

    Raises:
        ValueError: a number of particles, threshold or scheme that is none.
    """

    particles: int = eqx.field(default=1000, static=True, kw_only=True)
    threshold: float = eqx.field(default=0.5, static=True, kw_only=True)
    resampling: str = eqx.field(default="systematic", static=True, kw_only=True)
    seed: Int[Array, ""] = eqx.field(default=0, converter=jnp.asarray, kw_only=True)
    gate: GateRule | None = eqx.field(default=None, kw_only=True)

    def __check_init__(self) -> None:
        """Refuse settings that cannot run."""
        if self.particles < 1:
            raise ValueError(f"at least one particle is needed, got {self.particles}")
        if not 0 <= self.threshold <= 1:
            raise ValueError(f"threshold is a share of the particles, 0 to 1, got {self.threshold}")
        if self.resampling not in RESAMPLING:
            raise ValueError(f"no resampling {self.resampling!r}; choose one of {', '.join(RESAMPLING)}")

    def _renew(
        self, particles: T, log_weights: Float[Array, " N"], draws: Draws, dt: Float[Array, ""]
    ) -> tuple[T, Float[Array, " N"]]:
        """Particles (last axis of each leaf) and weights, resampled if the weights have degenerated.

        Not in a step of no time, which has to change nothing.
        """
        log_weights, _ = normalized(log_weights)
        share = effective_number(log_weights) / self.particles

        def resampled() -> tuple[T, Float[Array, " N"]]:
            chosen = RESAMPLING[self.resampling](jnp.exp(log_weights), draws.stream(_CHOICE))
            new = jax.tree.map(lambda a: a[..., chosen], particles)
            new = self._apart(new, particles, log_weights, draws)
            return new, self._equal(log_weights.dtype)

        # equal weights have a share of 1 up to rounding, and need no resampling even at a threshold of 1
        degenerate = (share < self.threshold * (1 - 1e-5)) & (dt > 0)
        return cast(
            tuple[T, Float[Array, " N"]],
            jax.lax.cond(degenerate, resampled, lambda: (particles, log_weights)),
        )

    def _apart(self, chosen: Any, before: Any, log_weights: Float[Array, " N"], draws: Draws) -> Any:
        """What is done to particles just resampled."""
        return chosen

    def _equal(self, dtype: Any) -> Float[Array, " N"]:
        return jnp.full(self.particles, -jnp.log(float(self.particles)), dtype)


class ParticleFilter(SIR[ParticleState]):
    """SIR particle filter: the proposal is the model's own transition (paper 003 §4; Gordon et al. 1993).

    w ← w p(z|x) in the log domain, normalised; x̂ = Σ w x and P = Σ w (x − x̂)(x − x̂)ᵀ (paper 003 eqs. 44 to
    48, of which eq. 48 has lost both minus signs). Resampling waits for the next :meth:`predict`, so that
    estimates are of the weighted particles, without the noise that resampling adds. Every sensor needs
    noise. A particle that f or h sends to NaN or infinity gets no weight.

    The sampling error of an estimate is about σ/√N_eff, and the number of particles needed grows
    exponentially with the number of states that measurements determine; use
    :class:`~roadstate.filters.rao_blackwell.RaoBlackwellPF` where some states enter linearly.

    Attributes:
        particles, threshold, resampling, seed, gate: see :class:`SIR`.
        jitter: noise for particles just resampled, or ``None``.
    """

    name: ClassVar[str] = "particle"
    jitter: Jitter | None = eqx.field(default=None, kw_only=True)

    def init(self, model: StateSpaceModel) -> ParticleState:
        """Particles drawn from the model's prior."""
        prior, draws = model.prior(), Draws.seeded(self.seed)
        dtype = prior.mean.dtype
        normal = draws.normal((len(model.states), self.particles), dtype)
        return ParticleState(
            particles=prior.mean[:, None] + prior.factor @ normal,
            log_weights=self._equal(dtype),
            draws=draws,
            rejected=jnp.zeros(len(model.sensors), jnp.int32),
        )

    def predict(
        self, model: StateSpaceModel, state: ParticleState, u: Any, dt: Float[Array, ""]
    ) -> ParticleState:
        """Resample where needed, then draw each particle's next state."""
        draws = state.draws.next()
        particles, log_weights = self._renew(state.particles, state.log_weights, draws, dt)
        moved = jax.vmap(lambda x: model.f(x, u, dt), 1, 1)(particles)
        root = model.sqrt_Q(u, dt)
        moved = moved + root @ draws.normal((root.shape[1], self.particles), moved.dtype)
        alive = jnp.all(jnp.isfinite(moved), axis=0)
        return state._replace(
            particles=jnp.where(alive, moved, particles),
            log_weights=jnp.where(alive, log_weights, -jnp.inf),
            draws=draws,
        )

    def update(
        self, model: StateSpaceModel, state: ParticleState, u: Any, z: Float[Array, " m"]
    ) -> tuple[ParticleState, Info]:
        """Weigh the particles."""
        seen = jax.vmap(lambda x: model.h(x, u), 1, 1)(state.particles)
        alive = jnp.all(jnp.isfinite(seen), axis=0)
        seen = jnp.where(alive, seen, 0)
        before, _ = normalized(jnp.where(alive, state.log_weights, -jnp.inf))
        z_hat, spread = deviations(seen, before)
        sqrt_R = model.sqrt_R(u)
        factor = tria(jnp.concatenate([sqrt_R, spread], axis=1))
        innovation = jnp.where(jnp.isfinite(z), z - z_hat, jnp.nan)
        variance = jnp.sum(factor**2, axis=1)
        used, codes, rejected = examine(self.gate, innovation, variance, state.rejected)

        noise = masked(sqrt_R, used)
        residual = jnp.where(used, z, 0)[:, None] - jnp.where(used[:, None], seen, 0)
        whitened = jax.vmap(solve_lower, (None, 1), 1)(noise, residual)
        constant = jnp.sum(jnp.log(jnp.diagonal(noise))) + 0.5 * LOG_2PI * jnp.sum(used)
        weighed, log_likelihood = normalized(before - 0.5 * jnp.sum(whitened**2, axis=0))
        ok = jnp.isfinite(log_likelihood) & jnp.isfinite(constant)
        new = state._replace(log_weights=jnp.where(ok, weighed, state.log_weights), rejected=rejected)
        return new, told(innovation, factor, log_likelihood - constant, used, codes, ok)

    def posterior(self, state: ParticleState) -> Gaussian:
        """Weighted mean and covariance."""
        return gaussian(*deviations(state.particles, normalized(state.log_weights)[0]))

    def _apart(self, chosen: Any, before: Any, log_weights: Float[Array, " N"], draws: Draws) -> Any:
        if self.jitter is None:
            return chosen
        moments = gaussian(*deviations(before, log_weights))
        return self.jitter(chosen, moments, draws.stream(_JITTER).normal(chosen.shape, chosen.dtype))

    def _is_finite(self, state: ParticleState) -> Bool[Array, ""]:
        return jnp.any(state.log_weights > -jnp.inf)
