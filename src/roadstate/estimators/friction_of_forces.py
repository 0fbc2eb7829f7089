"""The second of two stages: friction as the state, under tire forces that are known up to it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core.gaussian import Gaussian, Info
from roadstate.filters.base import FilterState
from roadstate.filters.marginal import MarginalUKF
from roadstate.filters.noise import WithNoise
from roadstate.linalg import product, root, tria
from roadstate.statespace import StateSpaceModel

YAW_NOISE = 0.05
"""rad/s/√s: what forces do not tell of ṙ."""


class ForcesInput(NamedTuple):
    """What the second stage's model is told.

    Attributes:
        shares: (3, 5) what each wheel adds to a_x, a_y, ṙ per μ, and last what is there without friction.
        distance: travelled since the last sample, m.
        sensor_std: (m,) 1σ of a sample's white noise.
        lasting_std: (m,) 1σ of white noise that would do as much harm as the errors that last.
        excited: (m,) whether a sensor's forces stand out of their own noise.
    """

    shares: Float[Array, "3 5"]
    distance: Float[Array, ""]
    sensor_std: Float[Array, " m"]
    lasting_std: Float[Array, " m"]
    excited: Bool[Array, " m"]


class FrictionOfForces(StateSpaceModel):
    """x = [μ of each group (, r)]; z of a_x, a_y, ṙ or r: linear (paper 000 eqs. 1–3, 30, 31).

    R is white noise only, so that it can be learned; for the rest see :class:`LastingErrors`.

    Attributes:
        states: names of the rows of x.
        sensors: of ``accel_x``, ``accel_y``, ``yaw_accel``, ``yaw_rate``.
        of_wheel: for each wheel its group.
        mean: prior mean of μ.
        std: (2,) 1σ of the prior: what all groups share, and each group's own.
        walk: (2,) 1σ of the random walk over 1 m, likewise.
        step_std: 1σ of each group's own random walk over one step.
    """

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    of_wheel: tuple[int, ...] = eqx.field(static=True)
    mean: Float[Array, ""]
    std: Float[Array, " 2"]
    walk: Float[Array, " 2"]
    step_std: Float[Array, ""]

    @property
    def nonlinear(self) -> tuple[str, ...]:
        """None."""
        return ()

    @property
    def groups(self) -> int:
        """How many frictions there are."""
        return max(self.of_wheel) + 1

    def friction(self, x: Float[Array, "*k"]) -> Float[Array, " 4"]:
        """μ under each wheel (or what else belongs to groups)."""
        return x[np.asarray(self.of_wheel)]

    def caused(self, x: Float[Array, " n"], u: ForcesInput) -> Float[Array, " 3"]:
        """a_x, a_y (specific forces) and ṙ."""
        return jnp.sum(u.shares[:, :4] * self.friction(x), axis=1) + u.shares[:, 4]

    def f(self, x: Float[Array, " n"], u: ForcesInput, dt: Float[Array, ""]) -> Float[Array, " n"]:
        """Friction stays; the yaw rate follows the forces."""
        return x.at[-1].add(self.caused(x, u)[2] * dt) if "yaw_rate" in self.states else x

    def h(self, x: Float[Array, " n"], u: ForcesInput) -> Float[Array, " m"]:
        """What the sensors would read."""
        caused = self.caused(x, u)
        by_name = {"accel_x": caused[0], "accel_y": caused[1], "yaw_accel": caused[2], "yaw_rate": x[-1]}
        return jnp.stack([by_name[sensor] for sensor in self.sensors])

    def sqrt_Q(self, u: ForcesInput, dt: Float[Array, ""]) -> Float[Array, "n q"]:
        """Shared and own random walks along the way."""
        way = root(jnp.abs(u.distance))
        own = root((self.walk[1] * way) ** 2 + jnp.where(dt > 0, self.step_std**2, 0.0))
        return self._spread(self.walk[0] * way, own, YAW_NOISE * root(dt))

    def sqrt_R(self, u: ForcesInput) -> Float[Array, "m m"]:
        """White noise of the sensors."""
        return jnp.diag(u.sensor_std)

    def prior(self) -> Gaussian:
        """The same mean for all groups, no yaw rate."""
        mean = jnp.zeros(len(self.states), self.std.dtype).at[: self.groups].set(self.mean)
        return Gaussian(mean, tria(self._spread(self.std[0], self.std[1], jnp.ones((), self.std.dtype))))

    def _spread(self, shared: Array, own: Array, yaw: Array) -> Float[Array, "n q"]:
        k, n = self.groups, len(self.states)
        diagonal = jnp.broadcast_to(own, (k,))
        diagonal = jnp.append(diagonal, yaw) if n > k else diagonal
        column = jnp.zeros(n, diagonal.dtype).at[:k].set(shared)
        return jnp.concatenate([column[:, None], jnp.diag(diagonal)], axis=1)


class LastingErrors(MarginalUKF):
    """The filter under errors that are not white: R is what the model says, and ``u.lasting_std`` on top.

    An error of 1σ = s that lasts for a time τ does as much harm as white noise of s √(2τ/Δt). To the outside,
    S is the white noise alone, since that is by what one innovation differs from the next: what lasts, and
    what the state is off by, shifts many alike. So a filter around this one that takes variances about their
    mean can learn R.
    """

    name: ClassVar[str] = "ukf-lasting-errors"

    def update(
        self, model: StateSpaceModel, state: FilterState, u: Any, z: Float[Array, " m"]
    ) -> tuple[FilterState, Info]:
        """Measurement update."""
        white = model.sqrt_R(u)
        noise = tria(jnp.concatenate([white, jnp.diag(u.lasting_std)], axis=1))
        new, info = super().update(WithNoise(model, noise), state, u, z)
        return new, replace(info, S=product(white, white.T))
