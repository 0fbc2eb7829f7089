"""Systems to run filters on: linear time-varying ones, and one whose curvature is a parameter."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from roadstate.core.gaussian import Gaussian
from roadstate.statespace import StateSpaceModel


class Matrices(NamedTuple):
    """What :class:`TimeVarying` is at one step: x⁺ = F x + b Δt + G w √Δt, z = H x + c + L v."""

    F: Any
    b: Any
    G: Any
    H: Any
    c: Any
    L: Any


class TimeVarying(StateSpaceModel):
    """A linear system whose matrices come in as the input, step by step."""

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    start: Gaussian

    def f(self, x: Float[Array, " n"], u: Matrices, dt: Float[Array, ""]) -> Float[Array, " n"]:
        return u.F @ x + u.b * dt

    def h(self, x: Float[Array, " n"], u: Matrices) -> Float[Array, " m"]:
        return u.H @ x + u.c

    def sqrt_Q(self, u: Matrices, dt: Float[Array, ""]) -> Float[Array, "n q"]:
        return u.G * jnp.sqrt(dt)

    def sqrt_R(self, u: Matrices) -> Float[Array, "m m"]:
        return u.L

    def prior(self) -> Gaussian:
        return self.start


def named(prefix: str, count: int) -> tuple[str, ...]:
    return tuple(f"{prefix}{i}" for i in range(count))


def random_time_varying(seed: int, n: int, m: int, steps: int) -> tuple[TimeVarying, Matrices, np.ndarray]:
    """A model, its matrices along the steps (correlated noises), and its steps in s."""
    random = np.random.default_rng(seed)
    F = np.eye(n) + 0.2 * random.normal(size=(steps, n, n))
    F /= np.maximum(1, np.linalg.norm(F, 2, axis=(1, 2)))[:, None, None]
    u = Matrices(
        F,
        random.normal(size=(steps, n)),
        random.normal(size=(steps, n, n + 1)),
        random.normal(size=(steps, m, n)),
        random.normal(size=(steps, m)),
        random.normal(size=(steps, m, m)),
    )
    start = Gaussian(jnp.asarray(random.normal(size=n)), jnp.asarray(np.tril(random.normal(size=(n, n)))))
    return TimeVarying(named("x", n), named("z", m), start), u, random.uniform(0.1, 2, steps)


def bend(x: Any, u: Any, dt: Any, curvature: Any, xp: Any) -> Any:
    """A pushed pendulum whose damping drifts; without curvature a linear system."""
    angle, rate, damping = x[0], x[1], x[2]
    pull = angle + curvature * (xp.sin(angle) - angle)
    slope = -pull - 0.3 * rate - curvature * damping * rate + u
    return xp.stack([angle + rate * dt, rate + slope * dt, damping * (1 - 0.02 * dt)])


def look(x: Any, curvature: Any, xp: Any) -> Any:
    """Two correlated sensors."""
    return xp.stack([x[0] + curvature * 0.3 * x[1] ** 2, x[1] + 0.5 * x[2] + curvature * 0.2 * x[0] * x[2]])


class Bent(StateSpaceModel):
    """:func:`bend` seen through :func:`look`; its parameters are leaves."""

    states: tuple[str, ...] = eqx.field(default=("angle", "rate", "damping"), static=True)
    sensors: tuple[str, ...] = eqx.field(default=("angle", "rate"), static=True)
    curvature: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.asarray(0.0))
    process: Float[Array, " 3"] = eqx.field(default_factory=lambda: jnp.asarray([0.05, 0.2, 0.05]))
    noise: Float[Array, "2 2"] = eqx.field(default_factory=lambda: jnp.asarray([[0.1, 0.0], [0.05, 0.2]]))
    start: Gaussian = eqx.field(
        default_factory=lambda: Gaussian(
            jnp.asarray([0.5, -0.2, 0.3]),
            jnp.asarray([[0.4, 0, 0], [0.1, 0.5, 0], [0.0, -0.1, 0.3]]),
        )
    )

    def f(self, x: Float[Array, " 3"], u: Any, dt: Float[Array, ""]) -> Float[Array, " 3"]:
        return bend(x, u, dt, self.curvature, jnp)

    def h(self, x: Float[Array, " 3"], u: Any) -> Float[Array, " 2"]:
        return look(x, self.curvature, jnp)

    def sqrt_Q(self, u: Any, dt: Float[Array, ""]) -> Float[Array, "3 3"]:
        positive = dt > 0  # the root has no derivative at zero
        return jnp.diag(self.process * jnp.where(positive, jnp.sqrt(jnp.where(positive, dt, 1)), 0))

    def sqrt_R(self, u: Any) -> Float[Array, "2 2"]:
        return self.noise

    def prior(self) -> Gaussian:
        return self.start


def run(method: Any, model: Any, u: Any, z: Any, dt: Any) -> tuple[Any, Any, Any]:
    """States after each step, what each step told, and the last state."""

    def body(state: Any, row: Any) -> tuple[Any, Any]:
        new, info = method.step(model, state, *row)
        return new, (method.posterior(new), info)

    last, (posteriors, infos) = jax.lax.scan(body, method.init(model), (u, z, dt))
    return posteriors, infos, last


run_jit = eqx.filter_jit(run)


def simulate(model: Any, u: Any, dt: Any, key: Any) -> tuple[Any, Any]:
    """States (T, n) and measurements (T, m) drawn from the model itself, its prior included."""
    first, rest = jax.random.split(key)
    prior = model.prior()
    x = prior.mean + prior.factor @ jax.random.normal(first, prior.mean.shape)

    def body(x: Any, row: Any) -> tuple[Any, Any]:
        u, dt, key = row
        for_w, for_v = jax.random.split(key)
        root_Q, root_R = model.sqrt_Q(u, dt), model.sqrt_R(u)
        x = model.f(x, u, dt) + root_Q @ jax.random.normal(for_w, (root_Q.shape[1],))
        return x, (x, model.h(x, u) + root_R @ jax.random.normal(for_v, (root_R.shape[1],)))

    return jax.lax.scan(body, x, (u, dt, jax.random.split(rest, len(dt))))[1]
