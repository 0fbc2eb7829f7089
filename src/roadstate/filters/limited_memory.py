"""The limited-memory adaptive extended Kalman filter."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from roadstate.core.gaussian import Gaussian, Info, Reason
from roadstate.core.kernel import once
from roadstate.filters.averages import AverageState
from roadstate.filters.base import Filter, FilterState, GateRule, examine
from roadstate.filters.ekf import EKF
from roadstate.filters.fading import StrongTracking, removable
from roadstate.filters.fuzzy import FuzzyNoise, FuzzyState
from roadstate.filters.kf import linearize
from roadstate.filters.spectral import spectral
from roadstate.filters.transitions import SlidingPrediction, SlidingState, Transition, select
from roadstate.linalg import product, root, solve_lower, tria
from roadstate.statespace import StateSpaceModel


class LimitedMemoryState(NamedTuple):
    """State of :class:`LimitedMemoryEKF`; ``None`` stands where an idea is switched off.

    Attributes:
        kalman: x̂_k, P_k of the filter that runs through, and its gates.
        limited: x̂_N, P_N: what the last N samples alone say.
        pending: the steps predicted since the last sample, as one.
        window: the pure prediction from N samples ago.
        innovations: what the fading factor knows of the innovations.
        fuzzy: what the fuzzy R has learned.
        fading: s of the last update.
    """

    kalman: FilterState
    limited: Gaussian
    pending: Transition
    window: SlidingState | None
    innovations: AverageState | None
    fuzzy: FuzzyState | None
    fading: Float[Array, ""]


class LimitedMemoryEKF(Filter[LimitedMemoryState]):
    """Limited-memory adaptive extended Kalman filter, LM-AEKF (paper 004 §3).

    Three ideas, each of which can be left out:

    * Limited memory: with x̂_{k|k−N}, P_{k|k−N} the pure prediction from the posterior N samples ago,
      P_N = (P_k⁻¹ − P_{k|k−N}⁻¹)⁻¹ and x̂_N = P_N(P_k⁻¹x̂_k − P_{k|k−N}⁻¹x̂_{k|k−N}) hold what the last N
      samples say without those before (Jazwinski, *Stochastic Processes and Filtering Theory*, ch. 9.8;
      exact for Q = 0 and a linear model; with fading the inflation counts as process noise). x̂_N, P_N is
      the posterior reported; the filter itself runs on with x̂_k, P_k. Up to k = N both are the EKF's.
    * A fading factor s ≥ 1 on P⁻: :class:`~roadstate.filters.fading.StrongTracking`.
    * Fuzzy R: :class:`~roadstate.filters.fuzzy.FuzzyNoise`, by the innovations before fading, lest each
      idea explain away what the other should see.

    In square-root form: with P_k = S Sᵀ and A = S_{k|k−N}⁻¹ S, P_N = S(I − AᵀA)⁻¹Sᵀ. An eigenvalue λ of AᵀA
    is the old samples' share of what is known in a direction. Where the new samples' share 1 − λ falls below
    ``least_share``, only the fraction φ = (1 − λ)/least_share of the old information is removed, and none
    where the difference has lost definiteness (λ ≥ 1): there the EKF's posterior stands, and the update says
    :attr:`Reason.MEMORY_KEPT`. So P_N is positive definite, no larger than P_k/least_share, and continuous.

    Steps between updates are linearised where the EKF linearised them, at its posteriors.

    Attributes:
        memory: N, at least 2; ``None`` for all. It counts updates that had a sample of any sensor.
        fading: the fading factor, or ``None``.
        fuzzy: the fuzzy R, or ``None``.
        least_share: share of the information that recent samples must have for the old to be forgotten.
        gate: innovation gate, or ``None`` to take every sample.
    """

    name: ClassVar[str] = "lm-aekf"
    memory: int | None = eqx.field(default=50, static=True, kw_only=True)
    fading: StrongTracking | None = eqx.field(default=StrongTracking(), kw_only=True)
    fuzzy: FuzzyNoise | None = eqx.field(default=FuzzyNoise(), kw_only=True)
    least_share: float = eqx.field(default=1e-4, static=True, kw_only=True)
    gate: GateRule | None = eqx.field(default=None, kw_only=True)

    def init(self, model: StateSpaceModel) -> LimitedMemoryState:
        """The model's prior, nothing learned."""
        kalman = EKF(gate=self.gate).init(model)
        prior, m = kalman.gaussian, len(model.sensors)
        dtype = prior.mean.dtype
        return LimitedMemoryState(
            kalman=kalman,
            limited=prior,
            pending=Transition.identity(prior),
            window=None if self.memory is None else SlidingPrediction(self.memory).init(prior),
            innovations=None if self.fading is None else self.fading.init(m, dtype),
            fuzzy=None if self.fuzzy is None else self.fuzzy.init(m, dtype),
            fading=jnp.ones((), dtype),
        )

    def predict(
        self, model: StateSpaceModel, state: LimitedMemoryState, u: Any, dt: Float[Array, ""]
    ) -> LimitedMemoryState:
        """Time update."""
        gaussian = state.kalman.gaussian
        u = once(u)
        moved, F = once(linearize(lambda x: model.f(x, u, dt), gaussian.mean))
        offset = moved - product(F, gaussian.mean[:, None])[:, 0]
        step = Transition(F, offset, _square(once(model.sqrt_Q(u, dt))))
        factor = step.predict(gaussian).factor
        return state._replace(
            kalman=state.kalman._replace(gaussian=Gaussian(moved, factor)),
            limited=step.predict(state.limited),
            pending=state.pending.then(step),
        )

    def update(
        self, model: StateSpaceModel, state: LimitedMemoryState, u: Any, z: Float[Array, " m"]
    ) -> tuple[LimitedMemoryState, Info]:
        """Measurement update."""
        return self._update_if(jnp.asarray(True), model, state, u, z)

    def _update_if(
        self,
        sound: Bool[Array, ""],
        model: StateSpaceModel,
        state: LimitedMemoryState,
        u: Any,
        z: Float[Array, " m"],
    ) -> tuple[LimitedMemoryState, Info]:
        # to choose between two states afterwards would be to copy the window's stacks whole, at each step
        prior, rejected = state.kalman.gaussian, state.kalman.rejected
        z_hat, H = linearize(lambda x: model.h(x, u), prior.mean)
        rows = product(H, prior.factor)
        nominal = model.sqrt_R(u)
        noise = nominal
        if self.fuzzy is not None and state.fuzzy is not None:
            noise = jnp.sqrt(self.fuzzy.scale(state.fuzzy))[:, None] * nominal

        explained, variance = jnp.sum(rows**2, axis=1), jnp.sum(noise**2, axis=1)
        innovation = jnp.where(jnp.isfinite(z), z - z_hat, jnp.nan)
        # by the gate of P⁻ as it is: what it refuses must not inflate P⁻ until it passes
        believed, _, _ = examine(self.gate, innovation, explained + variance, rejected)
        unit = jnp.sum(nominal**2, axis=1)
        unit = jnp.where(unit > 0, unit, 1)
        innovation = jnp.where(believed, innovation, 0) / jnp.sqrt(unit)
        explained, variance = explained / unit, variance / unit

        s, innovations, step = state.fading, state.innovations, state.pending
        if self.fading is not None and innovations is not None:
            innovations = self.fading.learn(innovations, innovation**2, believed & sound)
            s = self.fading.factor(innovations, explained, variance, believed)
            fade = root(s - 1) * removable(prior.factor, rows, noise, believed)
            prior = Gaussian(prior.mean, tria(jnp.concatenate([prior.factor, fade], axis=1)))
            step = step._replace(noise=tria(jnp.concatenate([step.noise, fade], axis=1)))
        kalman, info = EKF(gate=self.gate).take(
            FilterState(prior, rejected), z, z_hat, product(H, prior.factor), noise
        )
        fuzzy = state.fuzzy
        if self.fuzzy is not None and fuzzy is not None:
            heard = believed & info.ok & sound
            fuzzy = self.fuzzy.learn(fuzzy, innovation, explained + variance, heard)

        kalman, s = select(sound, (kalman, s), (state.kalman, state.fading))
        limited, pending, window = kalman.gaussian, state.pending, state.window
        if self.memory is not None and window is not None:
            sliding, taken = SlidingPrediction(self.memory), (info.reason == Reason.OK) & sound
            window, old = sliding.push(window, step, kalman.gaussian, taken)
            limited, kept = self._forget(kalman.gaussian, old, sliding.full(window))
            limited = select(taken, limited, state.limited)
            info = replace(info, reason=jnp.where(taken & kept, Reason.MEMORY_KEPT, info.reason))
            pending = select(taken, Transition.identity(prior), pending)
        return LimitedMemoryState(kalman, limited, pending, window, innovations, fuzzy, s), info

    def posterior(self, state: LimitedMemoryState) -> Gaussian:
        """x̂_N, P_N: what the last N samples say; the EKF's without a limited memory."""
        return state.limited

    def _is_finite(self, state: LimitedMemoryState) -> Bool[Array, ""]:
        gaussian = state.kalman.gaussian
        return jnp.all(jnp.isfinite(gaussian.mean)) & jnp.all(jnp.isfinite(gaussian.factor))

    def _forget(
        self, now: Gaussian, old: Gaussian, active: Bool[Array, ""]
    ) -> tuple[Gaussian, Bool[Array, ""]]:
        """Remove the information ``old`` from ``now``; say whether some of it had to be kept."""
        diagonal = jnp.diagonal(old.factor)
        # a component known exactly stays so: the solve below leaves its row alone
        sqrt_old = jnp.where(jnp.eye(diagonal.size, dtype=bool) & (diagonal <= 0), 1, old.factor)
        A = jax.vmap(solve_lower, (None, 1), 1)(sqrt_old, now.factor)
        apart = solve_lower(sqrt_old, now.mean - old.mean)
        W = product(A.T, A)
        sound = active & jnp.all(jnp.isfinite(W)) & jnp.all(jnp.isfinite(apart))
        W, apart = jnp.where(sound, W, 0), jnp.where(sound, apart, 0)
        (gain, inflation), old_share = spectral(self._removal, W)
        shift = product(now.factor, product(gain, product(A.T, apart[:, None])))[:, 0]
        kept = active & ~(sound & (1 - jnp.max(old_share) >= self.least_share))
        return Gaussian(now.mean + shift, tria(product(now.factor, inflation))), kept

    def _removal(self, share: Float[Array, " n"]) -> Float[Array, "2 n"]:
        """For the old samples' share of the information: what to do to mean and factor."""
        fraction = jnp.clip((1 - share) / self.least_share, 0, 1)
        left = 1 - fraction * share
        return jnp.stack([fraction / left, 1 / jnp.sqrt(left)])


def _square(sqrt_Q: Float[Array, "n q"]) -> Float[Array, "n n"]:
    """A factor of the same matrix with n columns."""
    n, columns = sqrt_Q.shape
    if columns > n:
        return tria(sqrt_Q)
    return jnp.pad(sqrt_Q, ((0, 0), (0, n - columns)))
