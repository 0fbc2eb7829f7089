"""Tire forces that lag behind their slip: first order in the distance rolled."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import ArrayLike

from roadstate.tires.smooth import Numbers

# Relaxation length (m) below which the force follows at once.
_SHORTEST = 1e-6


def relaxation_rate(force: ArrayLike, steady: ArrayLike, speed: ArrayLike, length: ArrayLike) -> Numbers:
    """Ḟ from (σ/|v_x|)·Ḟ + F = F_steady, N/s (Pacejka, 3rd ed., §7.2).

    Args:
        force: F, N, any shape.
        steady: F_steady, N.
        speed: |v_x|, m/s; at standstill the force stays as it is.
        length: relaxation length σ, m, above zero.
    """
    return jnp.abs(speed) / jnp.maximum(length, _SHORTEST) * (jnp.asarray(steady) - force)


def relax(force: ArrayLike, steady: ArrayLike, speed: ArrayLike, length: ArrayLike, dt: ArrayLike) -> Numbers:
    """F after Δt with speed and F_steady held: exact, hence stable for any step and any length.

    Args:
        force: F, N, any shape.
        steady: F_steady, N.
        speed: |v_x|, m/s.
        length: relaxation length σ, m; 0 is a tire without lag (but not at standstill).
        dt: s.
    """
    target = jnp.asarray(steady)
    return target + (force - target) * jnp.exp(-jnp.abs(speed) * dt / jnp.maximum(length, _SHORTEST))
