"""Small systems on which filters are tried."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from roadstate.core.gaussian import Gaussian
from roadstate.statespace import StateSpaceModel


class Linear(StateSpaceModel):
    """x⁺ = F x + G u Δt + w, z = H x + v, with any matrices; Δt scales F's generator and Q."""

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    A: jax.Array
    H: jax.Array
    q: jax.Array
    r: jax.Array
    mean: jax.Array
    spread: jax.Array

    def f(self, x: Any, u: Any, dt: Any) -> Any:
        return x + dt * (self.A @ x) + u * dt

    def h(self, x: Any, u: Any) -> Any:
        return self.H @ x

    def sqrt_Q(self, u: Any, dt: Any) -> Any:
        return self.q * jnp.sqrt(dt)

    def sqrt_R(self, u: Any) -> Any:
        return self.r

    def prior(self) -> Gaussian:
        return Gaussian(self.mean, self.spread)


def linear(seed: int = 0, n: int = 4, m: int = 3, dtype: Any = np.float64) -> Linear:
    """A random stable one, with correlated noises."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n)) - 3 * np.eye(n)
    arrays = (
        A,
        rng.normal(size=(m, n)),
        0.5 * rng.normal(size=(n, n)),
        np.linalg.cholesky(0.2 * np.eye(m) + 0.05),
        rng.normal(size=n),
        np.tril(rng.normal(size=(n, n))) + 2 * np.eye(n),
    )
    return Linear(
        tuple(f"x{i}" for i in range(n)),
        tuple(f"z{i}" for i in range(m)),
        *(jnp.asarray(a, dtype) for a in arrays),
    )


class Radar(StateSpaceModel):
    """A target moving with wandering velocity, seen by range and bearing: curved, but only mildly.

    x = [p_x, p_y, v_x, v_y] in m and m/s; the sensor stands at the origin.
    """

    states: tuple[str, ...] = eqx.field(default=("p_x", "p_y", "v_x", "v_y"), static=True)
    sensors: tuple[str, ...] = eqx.field(default=("range", "bearing"), static=True)
    range_std: jax.Array = eqx.field(default=1.0, converter=jnp.asarray)
    bearing_std: jax.Array = eqx.field(default=0.01, converter=jnp.asarray)
    accel: jax.Array = eqx.field(default=0.5, converter=jnp.asarray)
    dtype: Any = eqx.field(default=jnp.float64, static=True)

    def f(self, x: Any, u: Any, dt: Any) -> Any:
        return jnp.concatenate([x[:2] + dt * x[2:], x[2:]])

    def h(self, x: Any, u: Any) -> Any:
        return jnp.stack([jnp.hypot(x[0], x[1]), jnp.arctan2(x[1], x[0])])

    def sqrt_Q(self, u: Any, dt: Any) -> Any:
        cross = jnp.asarray([[1 / jnp.sqrt(3.0), 0], [jnp.sqrt(3.0) / 2, 0.5]], self.dtype)
        scale = self.accel * jnp.stack([dt**1.5, dt**0.5])
        return jnp.kron(scale[:, None] * cross, jnp.eye(2, dtype=self.dtype)).astype(self.dtype)

    def sqrt_R(self, u: Any) -> Any:
        return jnp.diag(jnp.stack([self.range_std, self.bearing_std])).astype(self.dtype)

    def prior(self) -> Gaussian:
        mean = jnp.asarray([60.0, 40.0, -1.0, 2.0], self.dtype)
        return Gaussian(mean, jnp.diag(jnp.asarray([5.0, 5.0, 2.0, 2.0], self.dtype)))


class Friction(StateSpaceModel):
    """Four friction coefficients that wander, seen by three sums of forces that they scale.

    The shape of papers 000, 003 and 004: three measurements cannot determine four states. ``u`` (3, 4) holds
    the normalised forces per unit mass.
    """

    states: tuple[str, ...] = eqx.field(default=("fl", "fr", "rl", "rr"), static=True)
    sensors: tuple[str, ...] = eqx.field(default=("a_x", "a_y", "yaw"), static=True)
    walk: jax.Array = eqx.field(default=1e-3, converter=jnp.asarray)
    noise: jax.Array = eqx.field(default=0.05, converter=jnp.asarray)
    spread: jax.Array = eqx.field(default=0.3, converter=jnp.asarray)
    dtype: Any = eqx.field(default=jnp.float64, static=True)

    def f(self, x: Any, u: Any, dt: Any) -> Any:
        return x

    def h(self, x: Any, u: Any) -> Any:
        return u @ x

    def sqrt_Q(self, u: Any, dt: Any) -> Any:
        return (self.walk * jnp.sqrt(dt) * jnp.eye(4)).astype(self.dtype)

    def sqrt_R(self, u: Any) -> Any:
        return (self.noise * jnp.eye(3)).astype(self.dtype)

    def prior(self) -> Gaussian:
        return Gaussian(jnp.full(4, 0.6, self.dtype), (self.spread * jnp.eye(4)).astype(self.dtype))


class Scalar(StateSpaceModel):
    """One state that wanders and is read directly, so that everything can be worked by hand."""

    states: tuple[str, ...] = eqx.field(default=("x",), static=True)
    sensors: tuple[str, ...] = eqx.field(default=("z",), static=True)
    q: jax.Array = eqx.field(default=0.1, converter=jnp.asarray)
    r: jax.Array = eqx.field(default=1.0, converter=jnp.asarray)
    mean: jax.Array = eqx.field(default=0.0, converter=jnp.asarray)
    spread: jax.Array = eqx.field(default=1.0, converter=jnp.asarray)

    def f(self, x: Any, u: Any, dt: Any) -> Any:
        return x

    def h(self, x: Any, u: Any) -> Any:
        return x

    def sqrt_Q(self, u: Any, dt: Any) -> Any:
        return (self.q * jnp.sqrt(dt))[None, None]

    def sqrt_R(self, u: Any) -> Any:
        return self.r[None, None]

    def prior(self) -> Gaussian:
        return Gaussian(self.mean[None], self.spread[None, None])


def simulate(
    model: StateSpaceModel, inputs: Any, dt: float, key: jax.Array, noise: Any = None
) -> tuple[jax.Array, jax.Array]:
    """Truth (T, n) and samples (T, m) of one run that starts from the prior.

    Args:
        model: the system.
        inputs: u at each step, leading axis T.
        dt: s.
        key: random key.
        noise: (T, m) factors on the standard deviation of the sensors' noise; ``None`` is 1.
    """
    steps = jax.tree.leaves(inputs)[0].shape[0]
    prior, m = model.prior(), len(model.sensors)
    start_key, process_key, sensor_key = jax.random.split(key, 3)
    start = prior.mean + prior.factor @ jax.random.normal(start_key, prior.mean.shape, prior.mean.dtype)
    factors = jnp.ones((steps, m)) if noise is None else noise
    step = jnp.asarray(dt, prior.mean.dtype)

    def advance(x: Any, row: Any) -> Any:
        u, process, sensor, factor = row
        root = model.sqrt_Q(u, step)
        x = model.f(x, u, step) + root @ jax.random.normal(process, root.shape[1:], x.dtype)
        v = model.sqrt_R(u) @ (factor.astype(x.dtype) * jax.random.normal(sensor, (m,), x.dtype))
        return x, (x, model.h(x, u) + v)

    keys = jax.random.split(process_key, steps), jax.random.split(sensor_key, steps)
    return jax.lax.scan(advance, start, (inputs, *keys, factors))[1]


def run(filter: Any, model: StateSpaceModel, inputs: Any, samples: Any, dt: float) -> Any:
    """Gaussians, infos and last state of a filter over samples (T, m)."""
    step = jnp.asarray(dt, model.prior().mean.dtype)

    def advance(state: Any, row: Any) -> Any:
        u, z = row
        state, info = filter.step(model, state, u, z, step)
        return state, (filter.posterior(state), info)

    state, (gaussians, infos) = jax.lax.scan(advance, filter.init(model), (inputs, samples))
    return gaussians, infos, state


def nees(gaussians: Any, truth: Any) -> Any:
    """(…) (x − x̂)ᵀ P⁻¹ (x − x̂) of Gaussians stacked along the leading axes."""
    error = truth - gaussians.mean
    whitened = jax.scipy.linalg.solve_triangular(gaussians.factor, error[..., None], lower=True)
    return jnp.sum(whitened[..., 0] ** 2, axis=-1)
