"""What a filter needs to know of a system, and nothing more."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

from roadstate.core.gaussian import Gaussian


class StateSpaceModel(eqx.Module):
    """A discrete-time stochastic system x⁺ = f(x, u, Δt) + w, z = h(x, u) + v.

    ``u`` is whatever pytree of known inputs the model reads. All methods are pure; Δt is in s and may
    change from step to step, also to zero, for which f must be the identity and Q vanish.

    Attributes:
        states: names of the rows of x.
        sensors: names of the rows of z.
    """

    states: eqx.AbstractVar[tuple[str, ...]]
    sensors: eqx.AbstractVar[tuple[str, ...]]

    @property
    def nonlinear(self) -> tuple[str, ...]:
        """States in which f or h is not affine while the others are held; by default all of them.

        f and h must be affine in the rest together, with coefficients that may depend on these. Filters that
        can treat the rest exactly save work by it; they do best where these states come first.
        """
        return self.states

    @abstractmethod
    def f(self, x: Float[Array, " n"], u: Any, dt: Float[Array, ""]) -> Float[Array, " n"]:
        """The state Δt later, without noise."""

    @abstractmethod
    def h(self, x: Float[Array, " n"], u: Any) -> Float[Array, " m"]:
        """What the sensors would read, without noise."""

    @abstractmethod
    def sqrt_Q(self, u: Any, dt: Float[Array, ""]) -> Float[Array, "n q"]:
        """A factor of the covariance of w over Δt: Q = √Q √Qᵀ; any number of columns."""

    @abstractmethod
    def sqrt_R(self, u: Any) -> Float[Array, "m m"]:
        """A factor of the covariance of v: R = √R √Rᵀ."""

    @abstractmethod
    def prior(self) -> Gaussian:
        """What is known of x before the first sample."""
