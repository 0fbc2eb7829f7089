"""A wheel that slips more from one moment to the next while it bears the same force: the road has changed.

Where all wheels are driven or braked, nothing rolls freely, and what they all slip alike cannot be told from
an error of the speed; a stiffness that is a little off makes one axle slip more than the other, always. But
neither changes within half a second. As the front wheels come onto ice their slip doubles at a force that
stays, and the rear ones' does not until they follow: that no stiffness feigns, nor any error of the speed.

But a wheel that runs over a bump slips for a moment as if it were on ice. So a jump has three explanations,
each a mode of a bank of hypotheses (interacting multiple models; Bar-Shalom, Li & Kirubarajan, *Estimation
with Applications to Tracking and Navigation*, ch. 11.6): errors, as long as the road stays; a road that has
begun, on which the jump must be what its friction makes of the force, and last; or a bump, in which a wheel
slips by anything, and soon does not.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from roadstate.core.kernel import once
from roadstate.estimators.friction_curve import theoretical_slip
from roadstate.estimators.sideways import SLIP_ERROR, SLOWEST, Touch

MEMORY = 0.5
"""s over which what a wheel slips is remembered."""
NOTHING = 10.0
"""In place of a memory where there is none yet."""
STAYS, BEGAN, SHAKEN = range(3)
"""Modes: the road stays; it has just begun; a bump shakes the wheel."""
MODES = 3
BEARS = 0.04
"""Force over load below which a wheel slips on no road: what jumps then is shaken by a bump."""
SLIDES = 0.03
"""Slip from which on a tire slides, and its force may fall."""
_NEW = 0.8  # s for which a road counts as one that has just begun
_BUMP = (0.08, 0.15)  # bumps per s, and s for which one lasts
_WIDER = 20.0  # nats per s by which a bump explains a jump worse than the road does: it might be any
_SHAKES = 0.05  # slip that bumps make: more of it is less likely one's
_NOISE = (4e-4, 0.011)  # 1σ of a slip's jump: by itself, and m/s over the speed
_SWIFT = 0.8  # share of what a slip is uncertain by as it changes: a bump's does, for as long as it lasts
_WHITE = 1.5  # of the variance of white noise in a slip, what a jump has: the others' is in it, too
_FORCE = (0.25, 0.05)  # and shares of the slip that the force's change and the force itself make
_COUNTS = 2.25  # σ from which on a jump counts: errors have longer tails than a Gaussian
_LASTS = 0.2  # s for which an error lasts
_ONSET = 4.0  # squared deviations, over σ², that no lasting error explains
_MOST = 0.4  # part of an independent time that one sample counts at most: forces lag a little behind slips
_SHIFT = 0.002  # slip that all wheels may seem to lose at once: an error of the speed
_OFFSET = 0.004  # slip that a wheel may seem to have when it rolls
_ANY = 1.0  # slip that stands for any
_USED = (0.8, 0.5)  # share of the friction from which on a force hardly tells the slip: and once it slides
_LARGEST = 0.1  # slip from which on a jump tells nothing
_GREW = 0.15  # share of a force by which it has grown when it may have come to its limit by that
_KEEPS = 0.6  # of a jump onto a new road is left to see after a while
_SHORT = 1.5  # σ by which it may fall short of that
_STEEP = 1.5  # of a slip over its force: a tire that is used by half
_CURVE = 1.35  # shape of a tire, to tell how steep its slip rises with its force
_STEEPEST = 0.9  # share of the friction up to which it does


class Jump(NamedTuple):
    """Of the wheels, within :data:`MEMORY`.

    Attributes:
        slip: (4,) :func:`jumps`.
        force: (4,) by how much |F_x|/F_z has grown.
        before: (4,) what each wheel slipped beyond its force.
    """

    slip: Float[Array, " 4"]
    force: Float[Array, " 4"]
    before: Float[Array, " 4"]


class Told(NamedTuple):
    """What the wheels' jumps tell.

    Attributes:
        likelihood: (3, 4, J) its logarithm in each mode, under each friction.
        tells: (4,) whether a wheel tells anything.
    """

    likelihood: Float[Array, "3 4 J"]
    tells: Bool[Array, " 4"]


def unexplained(touch: Touch, stiffness: Float[Array, ""]) -> Float[Array, " 4"]:
    """What each wheel slips beyond what its force would make it if the tire were linear.

    Args:
        touch: of the tires on the road.
        stiffness: C_κ/F_z.
    """
    return theoretical_slip(touch.slip) - touch.along / stiffness


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


def moved(
    p: Float[Array, "3 k J"], born: Float[Array, "#k J"], step: Float[Array, ""]
) -> Float[Array, "3 k J"]:
    """Weights of the modes a step later.

    Args:
        p: of the modes, for k parts of the car and J frictions.
        born: share of each part's weight that came to a road which has just begun, by its friction.
        step: s.
    """
    settles, ends = -jnp.expm1(-step / _NEW), -jnp.expm1(-step / _BUMP[1])
    bump = -jnp.expm1(-step * _BUMP[0]) * p[STAYS]
    fresh = jnp.sum(p, axis=(0, 2))[:, None] * born
    left = 1 - jnp.sum(born, axis=1, keepdims=True)
    return jnp.stack(
        [
            left * (p[STAYS] - bump + settles * p[BEGAN] + ends * p[SHAKEN]),
            left * (1 - settles) * p[BEGAN] + fresh,
            left * ((1 - ends) * p[SHAKEN] + bump),
        ]
    )


def evidence(
    jump: Jump,
    touch: Touch,
    aside: Float[Array, "4 J"],
    stiffness: Float[Array, ""],
    friction: Float[Array, "4 J"],
    bent: Float[Array, "4 J"],
    force_std: Float[Array, "4 1"],
    step: Float[Array, ""],
) -> Told:
    """Log-likelihood of the wheels' jumps in each mode, under each friction.

    While the road stays, and the force, a wheel gains nothing but errors, whatever the friction; as the force
    grows it gains what the curve tells, and near the limit any. On a road that has begun it gains by how much
    the slip of that road's curve exceeds a line's; less only if it had slipped before. One that falls short
    speaks against nothing on a road that stays: it may have been so for long.

    Args:
        jump: of the wheels.
        touch: of the tires on the road.
        aside: 1σ of a slip by the slip angle, under each hypothesis.
        stiffness: C_κ/F_z.
        friction: of each wheel's tire under each hypothesis.
        bent: C_κ σ/F_z of the slip σ that goes with the force by the tires' curve.
        force_std: 1σ of the force over load.
        step: s since the last sample.
    """
    force, bent = jnp.abs(touch.along[:, None]), jnp.abs(bent)
    slipped = jnp.abs(touch.slip[:, None])
    slides = (slipped > SLIDES) & (force + 4 * force_std > _USED[1] * friction)
    near = slides | (force + 4 * touch.along_std[:, None] > _USED[0] * friction)
    more = jnp.where(near, force, bent - force) / stiffness
    share = jnp.minimum(force / friction, _STEEPEST)
    steep = (1 + (bent / (friction * _CURVE)) ** 2) / jnp.sqrt(1 - share**2)  # of the slip over the force
    of_change = (_FORCE[0] * jump.force[:, None]) ** 2 + (_FORCE[1] * force) ** 2
    noise = _noise(touch) + aside**2
    std = jnp.sqrt(noise + _STEEP**2 * of_change / stiffness**2)
    std_began = jnp.sqrt(noise + (of_change + (force_std * steep) ** 2) / stiffness**2)
    slip, before = jump.slip[:, None], jnp.abs(jump.before[:, None])
    # of what a tire slips beyond a line, a force that has grown has made the greater part
    grew = jnp.clip(jump.force[:, None] / jnp.maximum(force, BEARS), 0.0, 1.0)
    limit = (grew > _GREW) & (force + 4 * force_std > _USED[0] * friction)
    may = jnp.where(limit | (slides & (before > SLIDES)), _ANY, (1 - (1 - grew) ** 2) * more)
    bears = jnp.sign(jnp.sum(touch.along)) * touch.along[:, None] > BEARS
    tells = jnp.isfinite(force_std) & bears & (slipped < _LARGEST)
    tells = tells & (jnp.abs(touch.speed) > 0.5 * SLOWEST)
    more, std, std_began, may = once((more, std, std_began, may))
    stays = once(_likelihood(_beyond((slip - may) / std), tells, step))
    short = jnp.maximum((_KEEPS * more - before - slip) / std - _SHORT, 0.0)
    exceeds = jnp.where(near, 0.0, _beyond((slip - more) / std_began))
    began = once(_likelihood(jnp.maximum(exceeds, short), tells, step))
    shaken = -_WIDER * step * (1 + (slipped / _SHAKES) ** 4)
    return Told(jnp.stack([stays, began, jnp.maximum(stays, shaken)]), tells[:, 0])


def _likelihood(far: Array, tells: Array, step: Array) -> Float[Array, "4 J"]:
    """Of deviations in σ, with the tails of Student's t; one that is too large to last counts sooner."""
    square = far**2
    counts = jnp.minimum((1 + (square / _ONSET) ** 2) * step / _LASTS, _MOST)
    return jnp.where(tells, -2.5 * jnp.log1p(square / 4) * counts, 0.0)


def _noise(touch: Touch) -> Float[Array, "4 1"]:
    """Variance of a slip's jump where neither force nor friction changes."""
    lasting = _NOISE[0] ** 2 + (_NOISE[1] / jnp.maximum(jnp.abs(touch.speed), SLOWEST)) ** 2
    swift = jnp.maximum(touch.slip_std**2 - SLIP_ERROR**2, 0.0)
    return lasting + (_SWIFT**2 * swift + _WHITE * touch.slip_noise**2)[:, None]


def _beyond(away: Float[Array, "4 J"]) -> Float[Array, "4 J"]:
    """Deviations in σ, each wheel's own or its axle's, as far as they exceed what errors do."""
    both = 2**0.5 * jnp.repeat(jnp.minimum(away[0::2], away[1::2]), 2, axis=0)
    return jnp.maximum(jnp.maximum(away, both) - _COUNTS, 0.0)
