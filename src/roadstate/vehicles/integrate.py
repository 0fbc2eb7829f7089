"""One step of a vehicle model in time, with the inputs held."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar, Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.dense import solve
from roadstate.vehicles.model import Stiff, soft_sign


class Dynamics(Protocol):
    """What can be integrated: a vehicle model, or a part of its states."""

    def derivative(self, x: Float[Array, " n"], u: Any) -> Float[Array, " n"]:
        """ẋ."""

    def stiff(self, x: Float[Array, " n"], u: Any) -> Stiff:
        """ẋ, dry friction, damping matrix."""


class Integrator(eqx.Module):
    """``step(model, x, u, dt)``: pure; with dt = 0 the state comes back as it was.

    Attributes:
        order: of convergence, where the model is smooth.
    """

    name: ClassVar[str]
    order: ClassVar[int]

    @abstractmethod
    def step(
        self, model: Dynamics, x: Float[Array, " n"], u: Any, dt: Float[Array, ""]
    ) -> Float[Array, " n"]:
        """The state ``dt`` seconds later."""


class Euler(Integrator):
    """x + Δt ẋ, as in the papers; with tires in the model unstable below some m/s."""

    name = "euler"
    order = 1

    def step(
        self, model: Dynamics, x: Float[Array, " n"], u: Any, dt: Float[Array, ""]
    ) -> Float[Array, " n"]:
        """As :meth:`Integrator.step`."""
        return x + dt * model.derivative(x, u)


class RK4(Integrator):
    """The classical Runge–Kutta scheme of fourth order; stable for |λ|Δt < 2.8 only."""

    name = "rk4"
    order = 4

    def step(
        self, model: Dynamics, x: Float[Array, " n"], u: Any, dt: Float[Array, ""]
    ) -> Float[Array, " n"]:
        """As :meth:`Integrator.step`."""
        k1 = model.derivative(x, u)
        k2 = model.derivative(x + 0.5 * dt * k1, u)
        k3 = model.derivative(x + 0.5 * dt * k2, u)
        k4 = model.derivative(x + dt * k3, u)
        return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


class LinearlyImplicit(Integrator):
    """Stable for wheels and body at any speed and any step, standstill and locked wheels included.

    A linearly implicit Euler step and one correction towards the trapezoidal rule:
    (I − ΔtA) k = g(x), x₁ = x + Δt k, (I − ΔtA)² d = ½(g(x) + g(x₁)) − k, x⁺ = x₁ + Δt d.
    Expansion gives x⁺ = x + Δt g + ½Δt² g'g + O(Δt³) for any A (a W-method: Steihaug & Wolfbrandt,
    *Math. Comp.* 33, 1979); with A = g' = λ and z = λΔt it multiplies by 1/(1 − z) − ½z²/(1 − z)³, which lies
    in (0, 1) for every z < 0. A is the model's damping, the tire force over its sliding velocity: even where
    the force is saturated, and stiffer near rolling, the sliding shrinks by (1 − 2z)/(1 − z)³ and keeps its
    sign, so that no wheel is thrown back and forth about rolling. (The better-known ROS2 throws them, at
    walking pace.) Where a wheel is spun up or locked within a few steps the scheme lags by about one.

    Dry friction keeps the direction it has at the start of the step; a state that would pass through zero
    against it stops there, and one at rest stays while the rest of ẋ is less than it. So wheels lock,
    exactly, and are released.
    """

    name = "linearly_implicit"
    order = 2

    def step(
        self, model: Dynamics, x: Float[Array, " n"], u: Any, dt: Float[Array, ""]
    ) -> Float[Array, " n"]:
        """As :meth:`Integrator.step`."""
        first = model.stiff(x, u)
        moving = first.derivative + first.dry * soft_sign(x)
        held = (x == 0) & (first.dry > 0) & (jnp.abs(moving) <= first.dry)
        direction = jnp.where(x != 0, jnp.sign(x), jnp.sign(moving))
        start = jnp.where(held, 0, moving - first.dry * direction)
        matrix = jnp.eye(x.shape[0], dtype=x.dtype) - dt * jnp.where(held[:, None], 0, first.damping)
        k = solve(matrix, start[:, None])[:, 0]
        ahead = x + dt * k
        second = model.stiff(ahead, u)
        end = second.derivative + second.dry * (soft_sign(ahead) - direction)
        lacking = 0.5 * (start + jnp.where(held, 0, end)) - k
        moved = ahead + dt * solve(matrix, solve(matrix, lacking[:, None]))[:, 0]
        return jnp.where((first.dry > 0) & (moved * x < 0), 0, moved)


class SubSteps(Integrator):
    """Another integrator, several times over a fraction of Δt.

    Attributes:
        inner: the integrator.
        count: how many steps.
    """

    name = "substeps"
    order = 0
    inner: Integrator
    count: int = eqx.field(static=True)

    def __check_init__(self) -> None:
        """Refuse a count below one."""
        if self.count < 1:
            raise ValueError(f"count must be at least 1, got {self.count}")

    def step(
        self, model: Dynamics, x: Float[Array, " n"], u: Any, dt: Float[Array, ""]
    ) -> Float[Array, " n"]:
        """As :meth:`Integrator.step`."""
        short = dt / self.count

        def one(state: Float[Array, " n"], _: None) -> tuple[Float[Array, " n"], None]:
            return self.inner.step(model, state, u, short), None

        return jax.lax.scan(one, x, None, length=self.count)[0]
