"""Tires that touch the road as told."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import ArrayLike

from roadstate.estimators.sideways import Touch


def straight_on(along: ArrayLike = 0.0, slip: ArrayLike = 0.0, *, speed: float = 15.0) -> Touch:
    """Straight ahead and level, with the four wheels' F_x/F_z and slips; all else is zero, and known."""
    zero, two, four = jnp.zeros(()), jnp.zeros(2), jnp.ones(4)
    return Touch(
        speed=zero + speed, accel_y=zero, yaw_rate=zero, yaw_accel=zero, lateral=zero, angle=two, across=two,
        along=jnp.asarray(along) * four, slip=jnp.asarray(slip) * four, slip_std=0.002 * four,
        slip_noise=0.0 * four, slip_shared=zero + 0.002, across_std=two, along_std=0.0 * four,
        split_std=0.0 * four, shaken=two, load=four, lag=zero + 0.05, banking=jnp.asarray([0.0, jnp.inf]),
        spins=zero > 0,
    )  # fmt: skip
