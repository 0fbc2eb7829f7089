"""Friction as the state: what models of friction share, whatever the forces come from."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from roadstate.core.gaussian import Gaussian
from roadstate.linalg import root, rss, tria
from roadstate.statespace import StateSpaceModel

_STIFFNESS = 0.1  # 1σ of a tire's stiffness, as a share of it
_FAINTEST = 0.05  # of a force's elasticity in friction; below it nothing is learned anyway
_TINY = 1e-6


class FrictionStates(StateSpaceModel):
    """x = [μ of each group (, r)]; z of a_x, a_y, ṙ and r. (Papers 000, 003 and 004.)

    The peak friction of the groups shares a part of its prior and of its random walk along the way, so that
    what one axle feels says something of the other. With ``yaw_rate`` among the states, r is integrated from
    the model's ṙ and measured as it is, instead of ṙ being had by differences.

    Attributes:
        states: names of the rows of x: the groups', and perhaps ``yaw_rate``.
        sensors: of ``accel_x``, ``accel_y``, ``yaw_accel``, ``yaw_rate``.
        of_wheel: for each wheel its group.
        mean: prior mean of μ.
        std: (2,) 1σ of the prior: what all groups share, and each group's own.
        walk: (2,) 1σ of the random walk over 1 m, likewise.
        step_std: (2,) 1σ of the random walk over one step, whatever its length (the papers' Q), likewise.
    """

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    of_wheel: tuple[int, ...] = eqx.field(static=True)
    mean: Float[Array, ""]
    std: Float[Array, " 2"]
    walk: Float[Array, " 2"]
    step_std: Float[Array, " 2"]

    @abstractmethod
    def caused(self, x: Float[Array, " n"], u: Any) -> Float[Array, " 3"]:
        """a_x, a_y (specific forces, m/s²) and ṙ (rad/s²)."""

    @property
    def groups(self) -> int:
        """How many frictions there are."""
        return len(self.states) - self.states.count("yaw_rate")

    def friction(self, x: Float[Array, "*k"]) -> Float[Array, " 4"]:
        """μ under each wheel (or what else belongs to groups)."""
        return x[np.asarray(self.of_wheel)]

    def f(self, x: Float[Array, " n"], u: Any, dt: Float[Array, ""]) -> Float[Array, " n"]:
        """Friction stays; the yaw rate follows the forces."""
        return x.at[-1].add(self.caused(x, u)[2] * dt) if "yaw_rate" in self.states else x

    def h(self, x: Float[Array, " n"], u: Any) -> Float[Array, " m"]:
        """What the sensors would read."""
        caused = self.caused(x, u)
        by_name = {"accel_x": caused[0], "accel_y": caused[1], "yaw_accel": caused[2], "yaw_rate": x[-1]}
        return jnp.stack([by_name[sensor] for sensor in self.sensors])

    def prior(self) -> Gaussian:
        """The same mean for all groups; no yaw rate."""
        mean = jnp.zeros(len(self.states), self.std.dtype).at[: self.groups].set(self.mean)
        return Gaussian(mean, tria(self._spread(self.std, jnp.ones((), self.std.dtype))))

    def wander(
        self,
        distance: Float[Array, ""],
        dt: Float[Array, ""],
        yaw_noise: Float[Array, ""] | float,
        jump: Float[Array, ""] | float = 0.0,
    ) -> Float[Array, "n q"]:
        """A factor of Q: shared and own random walks; nothing in a step of no time.

        Args:
            distance: travelled, m.
            dt: s.
            yaw_noise: rad/s/√s, 1σ of what the model's ṙ gets wrong, as white noise.
            jump: 1σ of a change of all frictions, over and above the random walk.
        """
        moves = jnp.where(dt > 0, 1.0, 0.0)
        size = rss(self.walk * root(jnp.abs(distance)), self.step_std * moves)
        size = size.at[0].set(rss(size[0], jump * moves))
        return self._spread(size, yaw_noise * root(dt))

    def _spread(self, size: Float[Array, " 2"], yaw: Float[Array, ""]) -> Float[Array, "n q"]:
        k, n = self.groups, len(self.states)
        shared = jnp.zeros(n, size.dtype).at[:k].set(size[0])
        own = jnp.zeros(n, size.dtype).at[:k].set(size[1])
        own = own if n == k else own.at[-1].set(yaw)
        return jnp.concatenate([shared[:, None], jnp.diag(own)], axis=1)

    def tire_error(
        self,
        ratio: Float[Array, ""],
        used: Float[Array, " 4"],
        load: Float[Array, " 4"],
        *,
        is_proportional: bool,
        mean: Float[Array, ""] | None = None,
    ) -> Float[Array, ""]:
        """1σ of the friction that a tire of other stiffness would feign, as a share of it.

        Below the limit a real tire's force depends on its stiffness, not on friction, and a tire model in
        which the one is proportional to the other takes a stiffness for a friction. With ψ the elasticity of
        a brush tire's force in friction (0 for a small slip, 1 when sliding), what is wrong with the
        stiffness makes (1 − ψ)/ψ times as much wrong with the friction. Wrong is the stiffness by its
        tolerance, and by staying what it is where friction is another; no more than the prior, though.
        (Pacejka, *Tire and Vehicle Dynamics*, §3.2.)

        Args:
            ratio: friction over that at which the stiffnesses were found.
            used: (4,) force over μ F_z, of each wheel.
            load: (4,) of the wheels that count, N; 0 leaves one out.
            is_proportional: whether the tire model's force is proportional to friction.
            mean: of what friction the prior is a share at most; default the prior's mean.
        """
        used = jnp.clip(used, 0.0, 1.0)
        theta = 1 - jnp.cbrt(1 - used + _TINY)
        psi = jnp.clip(1 - 3 * theta * (1 - theta) ** 2 / (used + _TINY), 0.0, 1.0)
        off = jnp.sqrt(_STIFFNESS**2 + ((1 - ratio) ** 2 if is_proportional else 0.0))
        error = off * (1 - psi) / (psi + _FAINTEST)
        weight = load * used**2 + _TINY
        most = jnp.sqrt(jnp.sum(self.std**2)) / (self.mean if mean is None else mean)
        return jnp.minimum(jnp.sum(weight * error) / jnp.sum(weight), most)


def share_learned(
    before: Gaussian, after: Gaussian, walk: Float[Array, "n q"], weights: Float[Array, " n"]
) -> Float[Array, ""]:
    """How much of what is known of weightsᵀx the last step has added: 0 for none of it, 1 for all.

    Args:
        before, after: the step.
        walk: factor of its Q.
        weights: (n,).
    """

    def variance(factor: Float[Array, "n k"]) -> Float[Array, ""]:
        return jnp.sum((weights @ factor) ** 2)

    foreseen = variance(before.factor) + variance(walk) + _TINY**2
    return jnp.clip(1 - variance(after.factor) / foreseen, 0.0, 1.0)
