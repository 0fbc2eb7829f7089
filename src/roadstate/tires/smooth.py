"""Functions with a kink or a pole, made safe to differentiate."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from roadstate.core import numerics as numerics  # float64 before the first array

Numbers = Float[Array, "..."]
"""A floating-point array of any shape."""

# tan of the steepest slip angle told apart from a purely sideways slide; float32 can still resolve it.
_STEEPEST = 1.57


def safe_hypot(x: Numbers, y: Numbers) -> Numbers:
    """√(x² + y²) whose gradient at the origin is zero instead of NaN."""
    square = x * x + y * y
    positive = square > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1)), 0)


def soft_abs(x: Numbers, floor: ArrayLike) -> Numbers:
    """|x| where it exceeds ``floor``, a parabola from ``floor``/2 up to it below: never zero, and C¹.

    Made to divide by: a quotient over it is exact above the floor and bounded below it.
    """
    size = jnp.abs(x)
    return jnp.where(size > floor, size, 0.5 * (x * x / floor + floor))


def bounded_tan(angle: Numbers) -> Numbers:
    """tan of a slip angle (rad), kept finite and of the right sign at ±90° and beyond."""
    return jnp.tan(jnp.clip(angle, -_STEEPEST, _STEEPEST))
