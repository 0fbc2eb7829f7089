"""Which frictions an estimator reports, what its state says of each, and how far to trust it."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from roadstate.core.channels import WHEELS
from roadstate.core.estimates import Validity
from roadstate.core.gaussian import Gaussian
from roadstate.estimators.signals import Held

ALL_WHEELS = (0, 1, 2, 3)
NORMAL_90 = 1.6449
"""Half the width of the two-sided 90 % interval of a normal distribution, in σ."""
USED_STD = 0.01
"""Of the friction used, from what the accelerometers' place and the air do."""
_USED_WANDER = 0.3  # 1/√s: how it wanders while not measured
_MOST = 1.5  # no road has more
_SILENT = 1.0  # s without what the contact is made of after which nothing is known
_KNOWN = 0.15  # 1σ over μ up to which friction counts as determined
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


def within_reason(
    mean: Float[Array, ""], spread: Float[Array, ""], least: Float[Array, ""] | float = 0.0
) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """A friction as it is told, with its 5 % and 95 % bounds: no road has less than nothing, or any more.

    A friction that wanders as the car drives on, as it does where nothing tells of it, knows no such limits.

    Args:
        mean, spread: of the friction, and 1σ.
        least: friction that there is at the least, ≥ 0.
    """
    value = jnp.clip(mean, least, _MOST)
    lower = jnp.minimum(jnp.maximum(mean - NORMAL_90 * spread, least), value)
    return value, lower, jnp.clip(mean + NORMAL_90 * spread, value, _MOST)


def used_std(used: Held) -> Float[Array, ""]:
    """1σ of the friction used, as old as it is."""
    return USED_STD + _USED_WANDER * jnp.sqrt(used.age)


def validity_of(
    mean: Float[Array, ""],
    spread: Float[Array, ""],
    *,
    stands: Bool[Array, ""],
    age: Float[Array, ""],
    ok: Bool[Array, ""],
) -> Int[Array, ""]:
    """How far to trust what is told of friction.

    Args:
        mean, spread: of the car's friction, and 1σ.
        stands: too slow for slips to say anything.
        age: s since all was there that the contact is made of.
        ok: whether the filters did not fail.
    """
    validity = jnp.where(spread < _KNOWN * mean, int(Validity.EXCITED), int(Validity.LOW_EXCITATION))
    validity = jnp.where(stands, int(Validity.STANDSTILL), validity)
    validity = jnp.where(age < _SILENT, validity, int(Validity.SENSOR_MISSING))
    return jnp.where(ok, validity, int(Validity.DIVERGED))
