"""Which frictions an estimator reports, and what its state says of each."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from roadstate.core.channels import WHEELS
from roadstate.core.gaussian import Gaussian

ALL_WHEELS = (0, 1, 2, 3)
_GROUPS = {"front": (0, 1), "rear": (2, 3), "left": (0, 2), "right": (1, 3)}


def reported(of_wheel: tuple[int, ...]) -> tuple[tuple[str, tuple[int, ...]], ...]:
    """Quantities with their wheels: the car's, and those that the grouping tells apart.

    Args:
        of_wheel: for each wheel its group.
    """
    found: list[tuple[str, tuple[int, ...]]] = [("friction_peak", ALL_WHEELS)]
    count = len(set(of_wheel))
    if count > 1:
        found += [
            (f"friction_peak_{name}", wheels)
            for name, wheels in _GROUPS.items()
            if count == len(WHEELS) or len({of_wheel[w] for w in wheels}) == 1
        ]
    if count == len(WHEELS):
        found += [(f"friction_peak_{name}", (i,)) for i, name in enumerate(WHEELS)]
    return tuple(found)


def mean_weights(of_wheel: tuple[int, ...], wheels: tuple[int, ...], like: Array) -> Float[Array, " n"]:
    """What the mean friction of some wheels takes of each state.

    Args:
        of_wheel: for each wheel the state that is its friction.
        wheels: over which the mean is.
        like: (n,) of the states, for size and precision.
    """
    weights = np.zeros(like.shape[0])
    for wheel in wheels:
        weights[of_wheel[wheel]] += 1 / len(wheels)
    return jnp.asarray(weights, like.dtype)


def mean_friction(
    gaussian: Gaussian, of_wheel: tuple[int, ...], wheels: tuple[int, ...]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Mean friction of some wheels, and its 1σ; arguments as of :func:`mean_weights`."""
    row = mean_weights(of_wheel, wheels, gaussian.mean)
    return row @ gaussian.mean, jnp.sqrt(jnp.sum((row @ gaussian.factor) ** 2))
