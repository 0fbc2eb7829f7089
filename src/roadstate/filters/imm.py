"""The interacting multiple model filter."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import logsumexp
from jaxtyping import Array, Bool, Float, Int

from roadstate.core.gaussian import Gate, Gaussian, Info
from roadstate.core.kernel import once
from roadstate.dense import cholesky
from roadstate.filters.base import Filter, FilterState, GateRule, GaussianFilter, examine
from roadstate.filters.switching import SwitchingModel
from roadstate.filters.ukf import UKF
from roadstate.filters.weighted import deviations, gaussian, normalized, told
from roadstate.linalg import product, root
from roadstate.statespace import StateSpaceModel


class IMMState(NamedTuple):
    """State of an :class:`IMM`.

    Attributes:
        modes: the filters' states, each leaf with a leading axis K.
        log_probability: (K,) of the modes, normalised.
        rejected: (m,) how many samples of each sensor the gate has refused in a row.
    """

    modes: FilterState
    log_probability: Float[Array, " K"]
    rejected: Int[Array, " m"]

    @property
    def probability(self) -> Float[Array, " K"]:
        """(K,) how likely each mode is now."""
        return jnp.exp(self.log_probability)


class IMM(Filter[IMMState]):
    """Interacting multiple model filter: one Gaussian filter for each mode of a switching model, mixed.

    With Π the chain's transition over Δt: c_j = Σ_i Π_ij p_i; filter j starts from the mixture of all, with
    weights Π_ij p_i/c_j, moves and takes the sample; p_j ∝ c_j N(ν_j; 0, S_j) (Blom & Bar-Shalom 1988;
    Bar-Shalom, Li & Kirubarajan, *Estimation with Applications to Tracking and Navigation*, ch. 11.6.6).
    Mixtures go into their factor as deviations, probabilities stay logarithms. :class:`Info` speaks of the
    mixture of predicted measurements: ν and S are its moments, the log-likelihood is exact for it.

    The model is a :class:`~roadstate.filters.switching.SwitchingModel`; of any other, this is the filter
    inside. The filters run as one under ``vmap``.

    Attributes:
        filter: of each mode, without a gate.
        gate: innovation gate, on the mixture, so that all modes are judged by the same sensors; or ``None``.

    Raises:
        ValueError: the filter inside has a gate of its own.
    """

    name: ClassVar[str] = "imm"
    filter: GaussianFilter = eqx.field(default=UKF(), kw_only=True)
    gate: GateRule | None = eqx.field(default=None, kw_only=True)

    def __check_init__(self) -> None:
        """Refuse gates that would let each mode be judged by other sensors."""
        if self.filter.gate is not None:
            raise ValueError("give the gate to the IMM, not to the filter inside")

    def init(self, model: StateSpaceModel) -> IMMState:
        """Each mode's prior."""
        switching = _switching(model)
        return IMMState(
            modes=eqx.filter_vmap(self.filter.init, axis_size=len(switching.probability))(switching.modes),
            log_probability=_log(switching.probability),
            rejected=jnp.zeros(len(model.sensors), jnp.int32),
        )

    def predict(self, model: StateSpaceModel, state: IMMState, u: Any, dt: Float[Array, ""]) -> IMMState:
        """Mix, then move each mode's filter."""
        switching = _switching(model)
        jumps, before = switching.transition(dt), state.log_probability
        joint = _log(jumps) + before[:, None]
        possible = jnp.any(joint > -jnp.inf, axis=0)
        # a mode that cannot be is left to itself
        joint = jnp.where(possible, joint, jnp.log(jnp.eye(len(before), dtype=joint.dtype)))
        after = logsumexp(joint, axis=0)
        weights = jnp.exp(joint - after)
        mixed = jax.vmap(_mixture, (None, 1))(state.modes.gaussian, weights)
        modes = eqx.filter_vmap(lambda mode, own: self.filter.predict(mode, own, u, dt))(
            switching.modes, state.modes._replace(gaussian=mixed)
        )
        log_probability, _ = normalized(jnp.where(possible, after, -jnp.inf))
        return state._replace(modes=modes, log_probability=log_probability)

    def update(
        self, model: StateSpaceModel, state: IMMState, u: Any, z: Float[Array, " m"]
    ) -> tuple[IMMState, Info]:
        """Update each mode's filter, and judge the modes by how well they foretold the samples."""
        switching = _switching(model)

        def each(samples: Float[Array, " m"]) -> tuple[FilterState, Info]:
            run = eqx.filter_vmap(lambda mode, own: self.filter.update(mode, own, u, samples))
            return cast(tuple[FilterState, Info], run(switching.modes, state.modes))

        modes, infos = each(z)
        present = jnp.isfinite(z)
        surprise = jnp.where(present, infos.innovation, 0)
        sound = jnp.all(jnp.isfinite(surprise), axis=1) & jnp.all(jnp.isfinite(infos.S), axis=(1, 2))
        # only as far out as its square can be told: beyond, modes would differ by rounding alone
        furthest = 1e-3 * float(np.finfo(surprise.dtype).max) ** 0.5
        surprise = jnp.clip(surprise, -furthest, furthest)
        before, _ = normalized(jnp.where(sound, state.log_probability, -jnp.inf))
        mean, between = deviations(jnp.where(sound[:, None], surprise, 0).T, before)
        spread = jnp.where(sound[:, None, None], infos.S, 0) * jnp.exp(before)[:, None, None]
        factor = _cholesky(jnp.sum(spread, axis=0) + product(between, between.T))
        innovation = jnp.where(present, mean, jnp.nan)
        used, codes, rejected = examine(self.gate, innovation, jnp.sum(factor**2, axis=1), state.rejected)
        if self.gate is not None:
            taken = jnp.where(used, z, jnp.nan)
            refused = jnp.any(codes == Gate.REJECTED)
            modes, infos = jax.lax.cond(refused, lambda: each(taken), lambda: (modes, infos))

        fine = sound & infos.ok & jnp.isfinite(infos.log_likelihood)
        weighed = before + jnp.where(fine, infos.log_likelihood, -jnp.inf)
        log_probability, log_likelihood = normalized(weighed)
        ok = jnp.isfinite(log_likelihood)
        new = IMMState(modes, jnp.where(ok, log_probability, state.log_probability), rejected)
        return new, told(innovation, factor, log_likelihood, used, codes, ok)

    def posterior(self, state: IMMState) -> Gaussian:
        """Mean and covariance of the mixture."""
        return _mixture(state.modes.gaussian, state.probability)

    def _is_finite(self, state: IMMState) -> Bool[Array, ""]:
        gaussians = state.modes.gaussian
        return jnp.all(jnp.isfinite(gaussians.mean)) & jnp.all(jnp.isfinite(gaussians.factor))


def _switching(model: StateSpaceModel) -> SwitchingModel:
    return model if isinstance(model, SwitchingModel) else SwitchingModel.alone(model)


def _log(probability: Array) -> Array:
    """Logarithm, with derivative 0 instead of infinity at 0."""
    positive = probability > 0
    return jnp.where(positive, jnp.log(jnp.where(positive, probability, 1)), -jnp.inf)


def _mixture(gaussians: Gaussian, weights: Float[Array, " K"]) -> Gaussian:
    """The Gaussian with a mixture's moments; leading axis K."""
    share = root(weights)
    mean = weights @ gaussians.mean
    between = (gaussians.mean - mean).T * share
    within = share[:, None, None] * gaussians.factor
    return gaussian(mean, once(jnp.concatenate([between, *within], axis=1)))


def _cholesky(S: Float[Array, "m m"]) -> Float[Array, "m m"]:
    """Factor of a covariance of sensors, whatever their units and however nearly alike they are."""
    std = jnp.sqrt(jnp.diagonal(S))
    ridge = 10 * float(np.finfo(S.dtype).eps) * jnp.eye(S.shape[0], dtype=S.dtype)
    factor: Float[Array, "m m"] = cholesky(S / (std[:, None] * std) + ridge)
    return std[:, None] * factor
