"""The second of two stages: friction as the state, under tire forces that are known up to it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from roadstate.core.gaussian import Info
from roadstate.estimators.friction_states import FrictionStates
from roadstate.filters.base import FilterState
from roadstate.filters.marginal import MarginalUKF
from roadstate.filters.noise import WithNoise
from roadstate.linalg import product, root, rss, tria
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
        yaw_accel: rad/s², what is added to ṙ where r is integrated, and
        yaw_std: 1σ of white noise that would do as much harm to it as all that is wrong with the forces.
    """

    shares: Float[Array, "3 5"]
    distance: Float[Array, ""]
    sensor_std: Float[Array, " m"]
    lasting_std: Float[Array, " m"]
    excited: Bool[Array, " m"]
    yaw_accel: Float[Array, ""]
    yaw_std: Float[Array, ""]


class FrictionOfForces(FrictionStates):
    """Friction under forces that are known up to it: linear (paper 000 eqs. 1–3, 30, 31).

    R is white noise only, so that it can be learned; for the rest see :class:`LastingErrors`.

    Attributes as :class:`FrictionStates`.
    """

    @property
    def nonlinear(self) -> tuple[str, ...]:
        """None."""
        return ()

    def caused(self, x: Float[Array, " n"], u: ForcesInput) -> Float[Array, " 3"]:
        """a_x, a_y (specific forces) and ṙ."""
        return jnp.sum(u.shares[:, :4] * self.friction(x), axis=1) + u.shares[:, 4]

    def f(self, x: Float[Array, " n"], u: ForcesInput, dt: Float[Array, ""]) -> Float[Array, " n"]:
        """Friction stays; the yaw rate follows the forces."""
        ahead = super().f(x, u, dt)
        return ahead.at[-1].add(u.yaw_accel * dt) if "yaw_rate" in self.states else ahead

    def sqrt_Q(self, u: ForcesInput, dt: Float[Array, ""]) -> Float[Array, "n q"]:
        """Random walks along the way, and for the yaw rate what the forces get wrong."""
        return self.wander(u.distance, dt, rss(YAW_NOISE, u.yaw_std * root(dt)))

    def sqrt_R(self, u: ForcesInput) -> Float[Array, "m m"]:
        """White noise of the sensors."""
        return jnp.diag(u.sensor_std)


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
