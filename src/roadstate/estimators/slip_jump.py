"""A wheel that slips more from one moment to the next while it bears the same force: the road has changed.

Where all wheels are driven or braked, nothing rolls freely, and what they all slip alike cannot be told from
an error of the speed; a stiffness that is a little off makes one axle slip more than the other, always. But
neither changes within half a second. As the front wheels come onto ice their slip doubles at a force that
stays, and the rear ones' does not until they follow: that no stiffness feigns, nor any error of the speed.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.estimators.friction_curve import elastic, theoretical_slip
from roadstate.estimators.mixture import tempered
from roadstate.estimators.sideways import SLOWEST, Touch

MEMORY = 0.5
"""s over which what a wheel slips is remembered."""
NOTHING = 10.0
"""In place of a memory where there is none yet."""
_NOISE = (4e-4, 0.011)  # 1σ of a slip's jump: by itself, and m/s over the speed
_FORCE = (0.25, 0.05)  # and shares of the slip that the force's change and the force itself make
_COUNTS = 2.25  # σ from which on a jump counts: errors have longer tails than a Gaussian
_LASTS = 0.2  # s for which an error lasts
_SHIFT = 0.002  # slip that all wheels may seem to lose at once: an error of the speed
_OFFSET = 0.004  # slip that a wheel may seem to have when it rolls
_MOST = 0.4  # part of an independent time that one sample counts at most: forces lag a little behind slips
_ANY = 1.0  # slip that stands for any
_USED = 0.8  # share of the friction from which on a force hardly tells the slip
_LARGEST = 0.04  # slip from which on a tire's force may fall
_STEEP = 1.5  # of a slip over its force: a tire that is used by half
_SELDOM = 0.02  # how often the road changes within the time that a jump lasts
_SURE = 12.0  # of the logarithm of a likelihood ratio, at the most
_CURVE = 1.35  # shape of a tire, to tell how steep its slip rises with its force


class Jump(NamedTuple):
    """Of the wheels, within :data:`MEMORY`.

    Attributes:
        slip: (4,) :func:`jumps`.
        force: (4,) by how much F_x/F_z has changed.
    """

    slip: Float[Array, " 4"]
    force: Float[Array, " 4"]


def unexplained(touch: Touch, stiffness: Float[Array, ""], memory: Float[Array, " 4"]) -> Float[Array, " 4"]:
    """What each wheel slips beyond what its force would make it if the tire were linear.

    Args:
        touch: of the tires on the road.
        stiffness: C_κ/F_z.
        memory: of the same, for a wheel whose slip or force nothing tells.
    """
    beyond = theoretical_slip(touch.slip) - touch.along / stiffness
    return jnp.where(jnp.isfinite(touch.along_std), beyond, memory)


def jumps(now: Float[Array, " 4"], memory: Float[Array, " 4"], touch: Touch) -> Float[Array, " 4"]:
    """By how much more of :func:`unexplained` each wheel has gained than the least but one of the four.

    As the speed follows wheels that slip more, the others seem to slip less.

    Args:
        now: :func:`unexplained`.
        memory: of it.
        touch: of the tires on the road.
    """
    forward = jnp.sign(jnp.sum(touch.along))
    # a wheel that comes back from spinning does not gain as the force turns
    before = jnp.maximum(forward * memory, jnp.abs(memory) - _OFFSET)
    gained = forward * now - before
    low, high = jnp.minimum(gained[:2], gained[2:]), jnp.maximum(gained[:2], gained[2:])
    return gained - jnp.maximum(jnp.minimum(jnp.max(low), jnp.min(high)), -_SHIFT)


def changed(
    jump: Jump,
    touch: Touch,
    stiffness: Float[Array, ""],
    friction: Float[Array, " J"],
    prior: Float[Array, " J"],
    step: Float[Array, ""],
) -> Float[Array, "4 J"]:
    """Probability that under each wheel the road changed in this step, to each friction, by the jump alone.

    While the road stays, and the force, a wheel gains nothing but errors, whatever the friction: what slips
    more than they explain has come onto another road, of which what was known before says nothing. Did the
    jump only refute what explains it worst, a friction that had been likely for long would win over those
    that the road may as well have changed to.

    Args:
        jump: of the wheels.
        touch: of the tires on the road.
        stiffness: C_κ/F_z.
        friction: hypotheses.
        prior: log probability of each, for a road that has just begun.
        step: s since the last sample.
    """
    force = jnp.abs(touch.along[:, None])
    more = (elastic(force, friction, jnp.asarray(_CURVE)) - force) / stiffness
    # near its friction a tire may slip by any amount
    more = jnp.where(force + 4 * touch.along_std[:, None] < _USED * friction, more, _ANY)
    more = jnp.concatenate([jnp.zeros_like(force), more], axis=1)  # first: where nothing has changed
    of_force = (_FORCE[0] * jump.force[:, None]) ** 2 + (_FORCE[1] * force) ** 2
    std = jnp.sqrt(_noise(touch) + _STEEP**2 * of_force / stiffness**2)
    away = (jump.slip[:, None] - more) / std
    fits = jnp.maximum(-0.5 * _beyond(away) ** 2, -_SURE)
    births = jnp.exp(prior + fits[:, 1:])
    every = jnp.sum(births, axis=1, keepdims=True)
    share = _SELDOM * every / (_SELDOM * every + jnp.exp(fits[:, :1]))
    told = jnp.isfinite(touch.along_std) & (jnp.abs(touch.slip) < _LARGEST)
    share = jnp.where(told[:, None] & (fits[:, :1] < 0), share, 0.0)
    return -jnp.expm1(jnp.log1p(-share) * jnp.minimum(step / _LASTS, 1.0)) * births / every


def _noise(touch: Touch) -> Float[Array, ""]:
    """Variance of a slip's jump where neither force nor friction changes."""
    return _NOISE[0] ** 2 + (_NOISE[1] / jnp.maximum(jnp.abs(touch.speed), SLOWEST)) ** 2


def _beyond(away: Float[Array, "4 J"]) -> Float[Array, "4 J"]:
    """Deviations in σ, each wheel's own or its axle's, as far as they exceed what errors do."""
    both = 2**0.5 * jnp.repeat(jnp.minimum(away[0::2], away[1::2]), 2, axis=0)
    return jnp.maximum(jnp.maximum(away, both) - _COUNTS, 0.0)


def evidence(
    jump: Jump,
    touch: Touch,
    aside: Float[Array, "4 J"],
    stiffness: Float[Array, ""],
    friction: Float[Array, " J"],
    bent: Float[Array, "4 J"],
    force_std: Float[Array, "4 1"],
    step: Float[Array, ""],
) -> Float[Array, "4 J"]:
    """Log-likelihood of the wheels' jumps under each friction: no wheel may slip more than its curve says.

    The slip that a force F_x/F_z = f makes on a friction μ is that of the tire's curve; beyond what it would
    be if it stayed linear lies what a wheel may gain by coming onto that road. A jump that exceeds it speaks
    against the friction; one that falls short, not for another: the road may have been so for long. Where f
    comes close to μ any slip may be. Of an axle's wheels together the lesser jump counts, for a road that
    changes under the axle (errors of the two are independent), or else each wheel's own.

    Args:
        jump: of the wheels.
        touch: of the tires on the road.
        aside: 1σ of a slip by the slip angle, under each hypothesis.
        stiffness: C_κ/F_z.
        friction: hypotheses.
        bent: C_κ σ/F_z of the slip σ that goes with the force by the tires' curve.
        force_std: 1σ of the force over load.
        step: s since the last sample.
    """
    force = jnp.abs(touch.along[:, None])
    bent = jnp.abs(bent)
    share = jnp.minimum(force / friction, _USED)
    steep = (1 + (bent / (friction * _CURVE)) ** 2) / jnp.sqrt(1 - share**2)  # of the slip over the force
    of_force = (_FORCE[0] * jump.force[:, None]) ** 2 + (_FORCE[1] * force) ** 2 + (force_std * steep) ** 2
    std = jnp.sqrt(_noise(touch) + of_force / stiffness**2 + aside**2)
    away = (jump.slip[:, None] - (bent - force) / stiffness) / std
    told = tempered(_beyond(away) ** 2, _LASTS / step, _MOST)
    tells = (force + 4 * force_std < _USED * friction) & (jnp.abs(touch.slip[:, None]) < _LARGEST)
    return jnp.where(tells, told, 0.0)
