"""Two systems like those the filters are for: a curved one, and one that cannot be seen as a whole."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from roadstate.core.gaussian import Gaussian
from roadstate.statespace import StateSpaceModel


class Radar(StateSpaceModel):
    """A target with wandering velocity, seen by range and bearing from the origin: mildly curved.

    x = [p_x, p_y, v_x, v_y] in m and m/s; its parameters are leaves, so that a world can differ from a model.
    """

    states: tuple[str, ...] = eqx.field(default=("p_x", "p_y", "v_x", "v_y"), static=True)
    sensors: tuple[str, ...] = eqx.field(default=("range", "bearing"), static=True)
    range_std: Any = eqx.field(default=1.0, converter=jnp.asarray)
    bearing_std: Any = eqx.field(default=0.01, converter=jnp.asarray)
    accel: Any = eqx.field(default=0.5, converter=jnp.asarray)
    mean: Any = eqx.field(default=(60.0, 40.0, -1.0, 2.0), converter=jnp.asarray)
    std: Any = eqx.field(default=(5.0, 5.0, 2.0, 2.0), converter=jnp.asarray)

    def f(self, x: Any, u: Any, dt: Any) -> Any:
        return jnp.concatenate([x[:2] + dt * x[2:], x[2:]])

    def h(self, x: Any, u: Any) -> Any:
        return jnp.stack([jnp.hypot(x[0], x[1]), jnp.arctan2(x[1], x[0])])

    def sqrt_Q(self, u: Any, dt: Any) -> Any:
        root = jnp.sqrt(dt)
        along = jnp.stack([root**3 / np.sqrt(3.0), jnp.zeros_like(root)])
        across = jnp.stack([root * np.sqrt(3.0) / 2, root / 2])
        return self.accel * jnp.kron(jnp.stack([along, across]), jnp.eye(2, dtype=root.dtype))

    def sqrt_R(self, u: Any) -> Any:
        return jnp.diag(jnp.stack([self.range_std, self.bearing_std]))

    def prior(self) -> Gaussian:
        return Gaussian(self.mean, jnp.diag(self.std))


class Friction(StateSpaceModel):
    """Four friction coefficients that wander, seen through three sums of the forces that they scale.

    The shape of papers 000, 003 and 004: z = u x, where u (3, 4) holds normalised forces by mass and inertia.
    Three measurements cannot determine four states.
    """

    states: tuple[str, ...] = eqx.field(default=("fl", "fr", "rl", "rr"), static=True)
    sensors: tuple[str, ...] = eqx.field(default=("a_x", "a_y", "yaw"), static=True)
    walk: Any = eqx.field(default=1e-3, converter=jnp.asarray)
    noise: Any = eqx.field(default=0.05, converter=jnp.asarray)
    spread: Any = eqx.field(default=0.3, converter=jnp.asarray)

    def f(self, x: Any, u: Any, dt: Any) -> Any:
        return x

    def h(self, x: Any, u: Any) -> Any:
        return u @ x

    def sqrt_Q(self, u: Any, dt: Any) -> Any:
        return self.walk * jnp.sqrt(dt) * jnp.eye(4, dtype=dt.dtype)

    def sqrt_R(self, u: Any) -> Any:
        return self.noise * jnp.eye(3, dtype=self.noise.dtype)

    def prior(self) -> Gaussian:
        dtype = self.spread.dtype
        return Gaussian(jnp.full(4, 0.6, dtype), self.spread * jnp.eye(4, dtype=dtype))

    def excited(self, x: Any, u: Any) -> Any:
        """Whether there is any force to speak of."""
        return jnp.max(jnp.abs(u)) > 0.1


def drive(steps: int, dt: float, steering: float) -> np.ndarray:
    """(T, 3, 4) inputs of :class:`Friction`: braking that swells and fades, steering from side to side."""
    t = np.arange(steps) * dt
    brakes, steers = 0.6 + 0.3 * np.sin(t), steering * np.sin(0.8 * np.pi * t)
    u = np.zeros((steps, 3, 4))
    u[:, 0] = brakes[:, None] * [2.2, 2.2, 1.8, 1.8]
    u[:, 1] = steers[:, None] * [2.2, 2.2, 1.8, 1.8]
    u[:, 2] = steers[:, None] * [1.1, 1.1, -1.2, -1.2] + brakes[:, None] * [-0.8, 0.8, -0.7, 0.7]
    return u
