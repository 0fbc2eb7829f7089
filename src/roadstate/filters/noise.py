"""A model with another measurement noise, for filters that learn it."""

from __future__ import annotations

from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

from roadstate.core.gaussian import Gaussian
from roadstate.statespace import StateSpaceModel


class WithNoise(StateSpaceModel):
    """The same system with ``noise`` as the factor of R.

    Attributes:
        model: the system.
        noise: (m, m) factor of R to use in place of the model's.
    """

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    model: StateSpaceModel
    noise: Float[Array, "m m"]

    def __init__(self, model: StateSpaceModel, noise: Float[Array, "m m"]) -> None:
        self.states, self.sensors = model.states, model.sensors
        self.model, self.noise = model, noise

    def f(self, x: Float[Array, " n"], u: Any, dt: Float[Array, ""]) -> Float[Array, " n"]:
        """The system's f."""
        return self.model.f(x, u, dt)

    def h(self, x: Float[Array, " n"], u: Any) -> Float[Array, " m"]:
        """The system's h."""
        return self.model.h(x, u)

    def sqrt_Q(self, u: Any, dt: Float[Array, ""]) -> Float[Array, "n q"]:
        """The system's √Q."""
        return self.model.sqrt_Q(u, dt)

    def sqrt_R(self, u: Any) -> Float[Array, "m m"]:
        """The noise given."""
        return self.noise

    def prior(self) -> Gaussian:
        """The system's prior."""
        return self.model.prior()
