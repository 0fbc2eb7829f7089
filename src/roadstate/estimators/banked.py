"""What a bank that has been found may be taken for, and what a road that leans so does to tires' loads."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.core.constants import GRAVITY
from roadstate.linalg import rss

_PRESSED = 0.5  # share of its weight by which no bank presses a car more
_STEEPEST = 0.5  # sin² of how far a road may lean
_ROLLS = 0.08  # sine of a bank that may as well be how far the body rolls otherwise than its file says


def believed(bank: Float[Array, ""], else_is: Float[Array, ""] | float) -> Float[Array, ""]:
    """How far a bank that was found is the road's, from 0 to 1.

    Small ones are mostly something else, an accelerometer's offset or how the body rolls, steep ones hardly.

    Args:
        bank: its sine, or g times that.
        else_is: the same of one which is as likely something else as the road.
    """
    odds = (bank / else_is) ** 4
    return odds / (1 + odds)


def pressed(
    speed: Float[Array, ""], turning: Float[Array, ""], slope: Float[Array, " 2"], bank: Float[Array, " 2"]
) -> Float[Array, " 2"]:
    """By what share tires bear more on a road that leans than on a level one, and 1σ of it.

    Less of its weight presses a car against such a road, and what turns it, v r, presses it against one that
    leans towards the middle of the bend: N = m (g √(1 − sin² θ − sin² φ) − v r sin φ), with the slope θ, and
    φ to the left. In a bend the body rolls as well, and what it does so otherwise than foreseen passes for a
    bank: one of so much counts half, the rest of it as an error.

    Args:
        speed: m/s.
        turning: yaw rate, rad/s.
        slope: g times the sine of θ, and its 1σ, m/s².
        bank: g times the sine of φ, and its 1σ, m/s².
    """
    lever = speed * turning / GRAVITY
    leans = jnp.stack([slope, bank], axis=1) / GRAVITY
    upright = jnp.sqrt(1 - jnp.minimum(jnp.sum(leans[0] ** 2), _STEEPEST))
    sine = leans[0, 1]
    banks = sine * believed(sine, _ROLLS)
    share = jnp.clip(-lever * banks, -_PRESSED, _PRESSED) + upright - 1
    each = (leans[0] / upright + jnp.stack([jnp.zeros_like(lever), lever])) * leans[1]
    return jnp.stack([share, rss(each[0], each[1], lever * (sine - banks))])
