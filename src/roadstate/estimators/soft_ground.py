"""Ground that holds back more than a road, or an accelerometer that errs more than its file says: either."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

FAR = (2.0, 3.0)
"""Of its file's 1σ by which a bias is as likely the ground's, and by which it surely may be."""
_KNOWN = 0.5  # of that 1σ: a bias that is known as well


def unsettled(bias: Float[Array, ""], std: Float[Array, ""], usual: Float[Array, ""]) -> Float[Array, ""]:
    """1σ of a bias that torques have told, since what they do not tell of may be the ground's, m/s².

    Snow, sand or gravel hold wheels back by some hundredths of g, and a tilted accelerometer reads as much:
    torques and accelerometer are as far apart, and only a slope that something else tells parts the two. As
    vehicle files have it the bias is the likelier one, up to where it would be a rare one; from there on it
    may be the one or the other, and so may the slope.

    Args:
        bias: of the accelerometer, as the filter has it, m/s².
        std: 1σ of that, m/s².
        usual: 1σ of a bias as the file has it, m/s².
    """
    times = jnp.abs(bias) / jnp.where(usual > 0, usual, jnp.inf)
    far = jnp.clip((times - FAR[0]) / (FAR[1] - FAR[0]), 0.0, 1.0)
    return jnp.where(std < _KNOWN * usual, far * jnp.abs(bias), 0.0)
