"""A filter that is where no car and no road can be: it has gone astray, and begins anew."""

from __future__ import annotations

from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from roadstate.core.estimates import Validity
from roadstate.core.gaussian import Gaussian
from roadstate.filters import FilterState
from roadstate.filters.base import is_finite, select

T = TypeVar("T", bound=Any)

FASTEST = 150.0
"""m/s: no car is so fast."""
STEEPEST = 4.5
"""m/s² of gravity along it: no road is so steep."""
WRONG = 1.0
"""m/s by which a filter must be off to be told so by wheels and a speed signal."""
_ALIKE = (0.3, 0.03)  # m/s, and share of the speed, by which the two may then differ
_MAY_SLIP = 0.5  # m/s² from which on all wheels may spin or lock, and a signal that is the wheels' with them
_LARGEST = 1e9  # no figure of a car is so large in SI units, nor the 1σ of one of which nothing is known yet


def is_astray(
    gaussian: Gaussian, speed: Float[Array, ""], slope: Float[Array, ""] | float = 0.0
) -> Bool[Array, ""]:
    """Whether a filter tells what cannot be.

    Left there it may never come back: a sine is the same a turn further, an explicit step in a drag that
    grows with the square of the speed runs away beyond some 10⁵ m/s, and no sample mends an infinite
    covariance.

    Args:
        gaussian: what it holds.
        speed: of it, m/s.
        slope: of it, m/s²; of an angle that may go round, g times the angle.
    """
    # written so that NaN is astray
    possible = (jnp.abs(speed) < FASTEST) & (jnp.abs(slope) < STEEPEST)
    return ~(possible & is_finite(gaussian))


def outvoted(
    before: Float[Array, ""],
    signal: Float[Array, ""],
    rims: Float[Array, " 4"],
    told: Bool[Array, " 4"],
    rolls: Float[Array, ""],
    speed: Float[Array, ""],
    thrust: Float[Array, ""],
) -> Float[Array, ""]:
    """Samples of a speed signal, in a row, that the wheels confirm and the filter contradicts.

    Two that cannot know of each other are hardly wrong by the same, however sure the filter is.

    Args:
        before: of the sample before.
        signal: of the speed, m/s; NaN where none came.
        rims: (4,) of the wheels, m/s.
        told: (4,) which of them came.
        rolls: m/s that the wheels tell.
        speed: m/s that the filter tells.
        thrust: specific force along, m/s².
    """
    apart = jnp.max(jnp.where(told, jnp.abs(rims - rolls), 0.0))
    # a receiver does not tell forward from backward
    other = jnp.sign(speed) * jnp.abs(signal)
    heard = jnp.isfinite(other) & (jnp.sum(told) >= 2)
    alike = jnp.abs(rolls - other) < _ALIKE[0] + _ALIKE[1] * jnp.abs(other)
    slips = ((rolls - speed) * thrust > 0) & (jnp.abs(thrust) > _MAY_SLIP)
    wrong = alike & (apart < WRONG) & (jnp.abs(speed - rolls) > WRONG) & ~slips
    return jnp.where(heard, jnp.where(wrong, before + 1, 0.0), before)


def led_back(astray: Bool[Array, ""], prior: Gaussian, state: FilterState) -> FilterState:
    """The filter at its prior, with clear gates, where it has gone astray; else as it is."""
    rejected = jnp.where(astray, 0, state.rejected)
    return state._replace(gaussian=select(astray, prior, state.gaussian), rejected=rejected)


def are_possible(*figures: Any) -> Bool[Array, ""]:
    """Whether all numbers in these trees of arrays are some that a car may have, in SI units."""
    # written so that NaN is not
    return jnp.all(jnp.asarray([jnp.all(jnp.abs(f) < _LARGEST) for f in jax.tree.leaves(figures)]))


def unspoilt(new: T, first: T, *figures: Any) -> T:
    """The new state of an estimator; where not all ``figures`` are possible its first one, called diverged.

    Args:
        new, first: states, each a named tuple with a ``validity``.
        figures: trees of arrays, of the new one.
    """
    diverged = jnp.full_like(first.validity, int(Validity.DIVERGED))
    begun: T = first._replace(validity=diverged)
    return select(are_possible(*figures), new, begun)
