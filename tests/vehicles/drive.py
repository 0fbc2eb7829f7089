"""Driving a vehicle model in tests."""

from __future__ import annotations

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from roadstate.core.channels import WHEELS
from roadstate.vehicles import Integrator, VehicleModel


@eqx.filter_jit
def simulate(
    model: VehicleModel, integrator: Integrator, x: jax.Array, inputs: jax.Array, dt: float | jax.Array
) -> jax.Array:
    """(N, n) states, each after the step under the same row of ``inputs`` (N, k)."""

    def advance(x: jax.Array, u: jax.Array) -> tuple[jax.Array, jax.Array]:
        x = integrator.step(model, x, u, jnp.asarray(dt))
        return x, x

    return jax.lax.scan(advance, x, inputs)[1]


def held(model: VehicleModel, steps: int, values: Mapping[str, float]) -> jax.Array:
    """(steps, k) inputs that do not change.

    A name without its wheel means all four; what is left out is 0.
    """
    rows = {}
    for name in model.inputs:
        family, _, end = name.rpartition("_")
        rows[name] = values.get(name, values.get(family, 0.0) if end in WHEELS else 0.0)
    return jnp.tile(model.input_vector(rows), (steps, 1))


def rolling(speed: float, radius: float) -> jax.Array:
    """State of a seven-DOF model that goes straight without slip."""
    return jnp.asarray(np.array([speed, 0, 0] + [speed / radius] * 4))
