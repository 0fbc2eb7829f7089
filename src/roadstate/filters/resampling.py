"""Resampling: which particles live on, and how often."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from roadstate.filters.draws import Draws

Resampling = Callable[[Float[Array, " N"], Draws], Int[Array, " N"]]
"""(N,) weights that sum to 1 and a source of random numbers → (N,) ancestors in rising order.

Every scheme is unbiased: particle i has N w_i offspring on average (compared by Douc, Cappé & Moulines 2005).
"""


def systematic(weights: Float[Array, " N"], draws: Draws) -> Int[Array, " N"]:
    """Points (i + U)/N with one U for all: each particle has ⌊N w⌋ or ⌈N w⌉ offspring (Kitagawa 1996).

    Args:
        weights: (N,) that sum to 1.
        draws: random numbers.
    """
    u = draws.uniform((), weights.dtype)
    sums, count = _scaled_sums(weights), weights.shape[0]
    # N − u itself may be rounded to N − 1
    return _ancestors(jnp.where(sums < count, jnp.ceil(sums - u), count))


def stratified(weights: Float[Array, " N"], draws: Draws) -> Int[Array, " N"]:
    """Points (i + U_i)/N (Kitagawa 1996).

    Args:
        weights: (N,) that sum to 1.
        draws: random numbers.
    """
    u = draws.uniform(weights.shape, weights.dtype)
    sums = _scaled_sums(weights)
    stratum = jnp.floor(sums)
    inside = u[jnp.minimum(stratum.astype(jnp.int32), weights.shape[0] - 1)] < sums - stratum
    return _ancestors(stratum + inside)


def multinomial(weights: Float[Array, " N"], draws: Draws) -> Int[Array, " N"]:
    """N independent draws (Gordon, Salmond & Smith 1993), already sorted: sums of exponential variables.

    Args:
        weights: (N,) that sum to 1.
        draws: random numbers.
    """
    count = weights.shape[0]
    return _ancestors(_below(_sums(weights), jnp.asarray(count), draws))


def residual(weights: Float[Array, " N"], draws: Draws) -> Int[Array, " N"]:
    """⌊N w⌋ offspring for sure, the rest drawn independently from what is left over (Liu & Chen 1998).

    Args:
        weights: (N,) that sum to 1.
        draws: random numbers.
    """
    count = weights.shape[0]
    certain = jnp.floor(weights * count).astype(jnp.int32)
    drawn = _below(_sums(weights * count - certain), count - jnp.sum(certain), draws)
    return _ancestors(jnp.cumsum(certain) + drawn)


RESAMPLING: dict[str, Resampling] = {
    "systematic": systematic,
    "stratified": stratified,
    "multinomial": multinomial,
    "residual": residual,
}
"""Every scheme by name."""


def _scaled_sums(weights: Float[Array, " N"]) -> Float[Array, " N"]:
    """N times the cumulative weights, N exactly from the last particle with any weight on."""
    sums = _sums(weights)
    return sums / sums[-1] * weights.shape[0]


def _sums(parts: Float[Array, " N"]) -> Float[Array, " N"]:
    """Cumulative sums that do not move where a part is zero.

    Those of a parallel sum do, by rounding, which would give particles without weight a share of their own.
    """
    return jnp.asarray(jax.lax.cummax(jnp.where(parts > 0, jnp.cumsum(parts), 0)))


def _below(sums: Float[Array, " N"], number: Int[Array, ""], draws: Draws) -> Int[Array, " N"]:
    """How many of ``number`` points, drawn independently from 0 to the last sum, lie below each sum."""
    waiting = jnp.cumsum(-jnp.log(draws.uniform((sums.shape[0] + 1,), sums.dtype)))
    points = jnp.where(jnp.arange(sums.shape[0]) < number, waiting[:-1] / waiting[number], jnp.inf)
    found = jnp.searchsorted(points * sums[-1], sums, method="scan_unrolled").astype(jnp.int32)
    # one that was rounded up to the end lies in the last part that there is
    return jnp.where(sums < sums[-1], found, number.astype(jnp.int32))


def _ancestors(ends: Array) -> Int[Array, " N"]:
    """Ancestor of each offspring, particle i having those from ends_{i−1} up to ends_i."""
    count = ends.shape[0]
    each = jnp.arange(count, dtype=ends.dtype)
    # unrolled: a scatter that counts is no faster, and not every XLA has a place for it within one kernel
    found = jnp.searchsorted(ends, each, side="right", method="scan_unrolled")
    return jnp.minimum(found, count - 1).astype(jnp.int32)
