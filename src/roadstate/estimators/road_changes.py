"""How a road's friction goes on as a car drives: it drifts, and changes altogether, seldom or often.

A road that has changed twice within a few metres will do so again: ice in the shade of trees, wet leaves,
mended asphalt. How often a road changes is therefore a hypothesis of its own, weighed by how soon after each
other changes come (change points at an unknown rate: Wilson, Nassar & Gold, *Neural Computation* 22(9),
2010). What was found on one patch is then soon forgotten, and the bounds say so.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.core.kernel import once
from roadstate.estimators import slip_jump
from roadstate.estimators.mixture import padded

KINDS = 2
"""Of roads: one that seldom changes, and one that often does."""
_CHANGES = (1 / 400.0, 1 / 12.0)  # 1/m: how often the friction of either changes altogether
_OFTEN = 0.01  # share of roads that often do
_ENDS = 1 / 150.0  # 1/m: how soon one that does is over
_DRIFT = 0.1**2 / 300.0  # 1/m: variance of ln μ that is added by driving on


def first(prior: Float[Array, " J"]) -> Float[Array, "2 J"]:
    """Weights of the kinds and J frictions, before anything is known but the frictions' ``prior``."""
    return jnp.asarray([1 - _OFTEN, _OFTEN])[:, None] * prior


def moved(
    p: Float[Array, "2 3 k J"],
    prior: Float[Array, " J"],
    spacing: float,
    distance: Float[Array, ""],
    step: Float[Array, ""],
) -> tuple[Float[Array, "2 3 k J"], Float[Array, "k J"]]:
    """Weights a step later, and how much of them came to a road that has just begun.

    Args:
        p: of the kinds, the modes of :mod:`~roadstate.estimators.slip_jump`, k parts of the car and J
            frictions.
        prior: of the frictions of a road that begins.
        spacing: of ln μ from one friction to the next.
        distance: driven, m.
        step: s.
    """
    share = jnp.minimum(0.5 * _DRIFT * distance / spacing**2, 0.25)
    edge = padded(p)
    p = p + share * (edge[..., 2:] - 2 * p + edge[..., :-2])
    ends = -jnp.expm1(-_ENDS * distance)
    to_often = ends * (_OFTEN / (1 - _OFTEN) * p[0] - p[1])
    p = once(jnp.stack([p[0] - to_often, p[1] + to_often]))
    born = -jnp.expm1(-jnp.asarray(_CHANGES, p.dtype) * distance)[:, None, None] * prior
    begun = jnp.sum(jnp.sum(p, axis=(1, 3))[:, :, None] * born, axis=0)
    return jax.vmap(slip_jump.moved, (0, 0, None))(p, born, step), begun
