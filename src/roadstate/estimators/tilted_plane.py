"""Ground that does not go along with a turn: yards, parking spaces, forecourts."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.estimators.banked import believed
from roadstate.linalg import root, rss

_PLANE = 0.5  # what is known of whether slow turns are on a plane, where that is 1 and a road's bend is 0
_ROADS = (4.0, 6.0)  # m/s: up to there a turn may be on either, from there on it is on a road
_OFFSET = 1.96  # σ of the lateral accelerometer's offset: a slope to the left of so much may as well be one
_TURN_TIME = 2.0  # s for which a turn on the spot lasts


def tilting(
    speed: Float[Array, ""], turning: Float[Array, ""], bank: Float[Array, " 2"], offset: Float[Array, ""]
) -> Float[Array, " 2"]:
    """How fast the slope ahead changes as a car turns where it is, m/s³, and 1σ of that, which lasts.

    A road's slope goes along with its bends. On a plane of gradient p on which a car heads by ψ off the way
    up, its slopes ahead and to the left are p cos ψ and −p sin ψ: the one to the left comes ahead at the yaw
    rate. Of which kind the ground is shows in how slowly the car goes, and no better. What leans
    little is mostly an offset of the accelerometer, which does not come ahead; the slope may err by as much.

    Args:
        speed: m/s.
        turning: yaw rate, rad/s.
        bank: g times the sine of the slope to the left, and its 1σ, m/s².
        offset: 1σ of the lateral accelerometer's, as a new one may have it, m/s².
    """
    plane = _PLANE * jnp.clip((_ROADS[1] - jnp.abs(speed)) / (_ROADS[1] - _ROADS[0]), 0.0, 1.0)
    mean, std = bank
    likely = believed(mean, _OFFSET * offset) * mean
    return plane * jnp.stack([turning * likely, jnp.abs(turning) * rss(mean, std)])


def wander(tilt: Float[Array, " 2"], dt: Float[Array, ""]) -> Float[Array, ""]:
    """1σ of white steps as far as an error of :func:`tilting` goes in a turn, m/s²."""
    return tilt[1] * root(2 * _TURN_TIME * dt)
