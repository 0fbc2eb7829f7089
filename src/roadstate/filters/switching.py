"""Systems that change their law: one of several models holds at a time, and jumps to another by chance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from roadstate.core.gaussian import Gaussian
from roadstate.dense import solve
from roadstate.linalg import product
from roadstate.statespace import StateSpaceModel

_DOUBLINGS = 10


class SwitchingModel(StateSpaceModel):
    """K models of one kind with different parameters, and a Markov chain that says which one holds.

    A filter that knows nothing of modes sees the first of them.

    Attributes:
        modes: the models as one, each leaf with a leading axis K.
        rates: (K, K) jumps per second from mode i (row) to j; the diagonal is not read.
        probability: (K,) of each mode before the first sample.
    """

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    modes: StateSpaceModel
    rates: Float[Array, "K K"]
    probability: Float[Array, " K"]

    @staticmethod
    def of(models: Sequence[StateSpaceModel], rates: Any, probability: Any = None) -> SwitchingModel:
        """Put models together.

        Args:
            models: K of one class, alike in structure and shapes; what differs are arrays.
            rates: (K, K) jumps per second from mode i to j, or one number for all pairs.
            probability: (K,) before the first sample; equal by default.

        Raises:
            ValueError: no models, models that are not alike, rates or probabilities that are none.
        """
        if not models:
            raise ValueError("a switching model needs at least one mode")
        shapes = [jax.tree.map(jnp.shape, eqx.filter(model, eqx.is_array)) for model in models]
        others = [eqx.filter(model, eqx.is_array, inverse=True) for model in models]
        if any(s != shapes[0] for s in shapes) or not all(eqx.tree_equal(o, others[0]) for o in others):
            raise ValueError("modes must be alike but for the values of their arrays")
        count = len(models)
        jumps = np.broadcast_to(np.asarray(rates, float), (count, count))
        weights = np.full(count, 1 / count) if probability is None else np.asarray(probability, float)
        if not np.all(np.isfinite(jumps) & (jumps >= 0)):
            raise ValueError("rates are jumps per second: finite and not negative")
        if weights.shape != (count,) or not (np.all(weights >= 0) and 0 < np.sum(weights) < np.inf):
            raise ValueError(f"probability must hold {count} numbers that are not negative, nor all zero")
        return _stacked(models, jumps, weights / np.sum(weights))

    @staticmethod
    def alone(model: StateSpaceModel) -> SwitchingModel:
        """A model that has one mode.

        Args:
            model: it.
        """
        return _stacked([model], np.zeros((1, 1)), np.ones(1))

    @property
    def count(self) -> int:
        """K."""
        return self.probability.shape[0]

    def transition(self, dt: Float[Array, ""]) -> Float[Array, "K K"]:
        """Π_ij, the probability of mode j after Δt in mode i: a stochastic matrix for any Δt.

        exp(GΔt) by (I − GΔt/2ˢ)⁻¹ doubled s = 10 times, on what it differs from I by, so that rare jumps keep
        their digits; relative error of a jump's probability below (jumps in Δt)/2000.

        Args:
            dt: in s.
        """
        K = self.count
        rates = self.rates * (1 - jnp.eye(K, dtype=self.rates.dtype))
        generator = (rates - jnp.diag(jnp.sum(rates, axis=1))) * (dt / 2**_DOUBLINGS)
        jump = solve(jnp.eye(K, dtype=generator.dtype) - generator, generator)
        for _ in range(_DOUBLINGS):
            jump = 2 * jump + product(jump, jump)
        whole: Float[Array, "K K"] = jnp.eye(K, dtype=jump.dtype) + jump
        return whole

    def mode(self, index: int) -> StateSpaceModel:
        """One of the models.

        Args:
            index: 0 to K − 1.
        """
        arrays, rest = eqx.partition(self.modes, eqx.is_array)
        one: StateSpaceModel = eqx.combine(jax.tree.map(lambda leaf: leaf[index], arrays), rest)
        return one

    @property
    def nonlinear(self) -> tuple[str, ...]:
        """Those of the modes."""
        return self.modes.nonlinear

    def f(self, x: Float[Array, " n"], u: Any, dt: Float[Array, ""]) -> Float[Array, " n"]:
        """The first mode's."""
        return self.mode(0).f(x, u, dt)

    def h(self, x: Float[Array, " n"], u: Any) -> Float[Array, " m"]:
        """The first mode's."""
        return self.mode(0).h(x, u)

    def sqrt_Q(self, u: Any, dt: Float[Array, ""]) -> Float[Array, "n q"]:
        """The first mode's."""
        return self.mode(0).sqrt_Q(u, dt)

    def sqrt_R(self, u: Any) -> Float[Array, "m m"]:
        """The first mode's."""
        return self.mode(0).sqrt_R(u)

    def prior(self) -> Gaussian:
        """The first mode's."""
        return self.mode(0).prior()


def _stacked(models: Sequence[StateSpaceModel], rates: Any, probability: Any) -> SwitchingModel:
    first, dtype = models[0], models[0].prior().mean.dtype
    arrays = [eqx.filter(model, eqx.is_array) for model in models]
    modes = eqx.combine(jax.tree.map(lambda *leaves: jnp.stack(leaves), *arrays), first)
    return SwitchingModel(
        states=first.states,
        sensors=first.sensors,
        modes=modes,
        rates=jnp.asarray(rates, dtype),
        probability=jnp.asarray(probability, dtype),
    )
