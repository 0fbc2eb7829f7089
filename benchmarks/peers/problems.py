"""What every implementation is asked to do: a system, its noises, a start and one log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from roadstate.core.gaussian import Gaussian
from roadstate.statespace import StateSpaceModel

Array = NDArray[np.float64]
Method = Literal["kf", "ukf", "pf"]


@dataclass(frozen=True)
class Problem:
    """A discrete-time system with additive noises and one log of it.

    Attributes:
        name: as in the tables.
        method: what is to be run: a Kalman filter, an unscented one (α = 1, β = 2, κ = 0) or a SIR particle
            filter (systematic resampling at each step).
        f: ``f(xp, x, u, dt)`` (n,), with ``xp`` NumPy or its like in JAX.
        h: ``h(xp, x, u)`` (m,).
        q: (n,) standard deviations of the process noise over one step.
        r: (m,) standard deviations of the sensors' noise.
        mean: (n,) prior mean.
        std: (n,) prior standard deviations.
        inputs: (T, k) u.
        samples: (T, m) z.
        dt: s.
        linear: (n,) states that enter f and h with constant coefficients.
        particles: of a particle filter.
    """

    name: str
    method: Method
    f: Callable[..., Any]
    h: Callable[..., Any]
    q: Array
    r: Array
    mean: Array
    std: Array
    inputs: Array
    samples: Array
    dt: float
    linear: tuple[int, ...] = field(default=())
    particles: int = 0

    @property
    def steps(self) -> int:
        """T."""
        return len(self.samples)

    def first(self, steps: int) -> Problem:
        """The same with only the first samples."""
        from dataclasses import replace

        return replace(self, inputs=self.inputs[:steps], samples=self.samples[:steps])


class Plain(StateSpaceModel):
    """A :class:`Problem` as roadstate sees it."""

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    linear: tuple[int, ...] = eqx.field(static=True)
    problem_f: Callable[..., Any] = eqx.field(static=True)
    problem_h: Callable[..., Any] = eqx.field(static=True)
    q: Any
    r: Any
    mean: Any
    std: Any

    @property
    def nonlinear(self) -> tuple[str, ...]:
        """All states but those that the problem calls linear."""
        return tuple(name for i, name in enumerate(self.states) if i not in self.linear)

    def f(self, x: Any, u: Any, dt: Any) -> Any:
        """The state Δt later."""
        return self.problem_f(jnp, x, u, dt)

    def h(self, x: Any, u: Any) -> Any:
        """What the sensors read."""
        return self.problem_h(jnp, x, u)

    def sqrt_Q(self, u: Any, dt: Any) -> Any:
        """√Q of one step: the noise of these benchmarks does not scale with Δt."""
        return jnp.diag(self.q)

    def sqrt_R(self, u: Any) -> Any:
        """√R."""
        return jnp.diag(self.r)

    def prior(self) -> Gaussian:
        """The start."""
        return Gaussian(self.mean, jnp.diag(self.std))


def model(problem: Problem, dtype: Any = None) -> Plain:
    """The problem's system as a roadstate model."""
    return Plain(
        tuple(f"x{i}" for i in range(len(problem.q))),
        tuple(f"z{i}" for i in range(len(problem.r))),
        problem.linear,
        problem.f,
        problem.h,
        *(jnp.asarray(a, dtype) for a in (problem.q, problem.r, problem.mean, problem.std)),
    )
