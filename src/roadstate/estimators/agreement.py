"""What wheels tell of a car's speed as long as they have agreed on none."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

TOGETHER = (0.03, 0.3)
"""Share of the speed, and m/s, within which wheels agree."""
DEAD_BAND = 0.7
"""m/s: a slower wheel may read down to zero."""
BEARS = 0.03
"""Force over load from which on its sign is known."""
_PROVES = 0.05  # s for which all wheels agree until they are believed
_UNSURE = 0.1  # what each second counts for, s, for which all but one agree, or all while their tires bear
_TAKES = 0.01  # s of such until the speed of all but one is taken
_CREEP = 0.1  # m/s²: how fast what they told of the speed before is let go of
_LEAST_SLIP = (0.15, 0.015)  # m/s, and share of the speed: 1σ of what the wheel slips that slips least
_OUTDOES = (1.0, 2.0)  # m/s, and σ, by which such a wheel refutes what wheels told before
_PUZZLING = 0.2  # 1σ of that, as a share of what wheels are apart that do not race, either


def is_proven(proof: Float[Array, ""]) -> Bool[Array, ""]:
    """Whether wheels have agreed on a speed.

    Args:
        proof: s for which they have, see :func:`proves`.
    """
    return proof > _PROVES


def most(
    rim: Float[Array, " 4"], told: Bool[Array, " 4"], calm: Bool[Array, " 4"]
) -> tuple[Bool[Array, " 4"], Float[Array, ""]]:
    """Which wheels agree with all others but one, two at least, and the speed they tell.

    Args:
        rim: the car's speed as each wheel tells it, m/s.
        told: those that tell one.
        calm: those that do not race.
    """
    alike = jnp.abs(rim[:, None] - rim) < TOGETHER[0] * jnp.abs(rim) + TOGETHER[1]
    trusted = told & calm & (jnp.abs(rim) > DEAD_BAND)
    alike = alike & trusted & trusted[:, None]
    members = jnp.sum(alike, axis=1) >= jnp.maximum(jnp.sum(told) - 1, 2)
    return members, jnp.sum(jnp.where(members, rim, 0.0)) / jnp.maximum(jnp.sum(members), 1)


def is_sure(members: Bool[Array, " 4"], told: Bool[Array, " 4"], bears: Float[Array, ""]) -> Bool[Array, ""]:
    """Whether wheels do not agree by chance: all of them do, and no force makes them slip alike.

    Anti-lock brakes may let go of all wheels at once, which are of one mind then as they turn round.

    Args:
        members: from :func:`most`.
        told: the wheels that tell a speed.
        bears: force over load in the mean.
    """
    return jnp.all(members == told) & (jnp.abs(bears) <= BEARS)


def slips_least(
    rim: Float[Array, " 4"],
    told: Bool[Array, " 4"],
    bears: Float[Array, ""],
    before: Float[Array, ""],
    unsure: Float[Array, ""],
    dt: Float[Array, ""],
    leans: float = BEARS,
) -> Float[Array, ""]:
    """Speed of the wheel that slips least, now or lately, m/s; NaN where nothing has told it.

    It is the slowest of those that push the car, the fastest of those that slow it down; if neither, what
    those in the middle tell. Traction control and anti-lock brakes bring each wheel close to the car's speed
    several times a second, and hardly across it.

    Args:
        rim: the car's speed as each wheel tells it, m/s.
        told: those that count.
        bears: force over load in the mean.
        before: what came of this at the last sample, and the car's acceleration since; NaN if nothing, m/s.
        unsure: 1σ of that acceleration, m/s².
        dt: s since.
        leans: force over load from which on its sign is taken for known.
    """
    count, total = jnp.sum(told), jnp.sum(jnp.where(told, rim, 0.0))
    mean = jnp.where(count > 0, total / jnp.maximum(count, 1), jnp.nan)
    fastest, slowest = jnp.max(jnp.where(told, rim, -jnp.inf)), jnp.min(jnp.where(told, rim, jnp.inf))
    middle = jnp.where(count > 2, (total - fastest - slowest) / jnp.maximum(count - 2, 1), mean)
    creep = (_CREEP + 2 * unsure) * dt
    slowest, fastest = jnp.fmin(slowest, before + creep), jnp.fmax(fastest, before - creep)
    least = jnp.where(bears > leans, slowest, jnp.where(bears < -leans, fastest, middle))
    return jnp.where(jnp.isfinite(least), least, jnp.nan)


def agreed(
    least: Float[Array, ""],
    members: Bool[Array, " 4"],
    speed: Float[Array, ""],
    sure: Bool[Array, ""],
    proof: Float[Array, ""],
) -> Float[Array, ""]:
    """Speed to hold wheels against, m/s: that which most agree on, or else ``least``.

    Three of four may agree by chance for a moment while all race: they are taken once they have for longer.

    Args:
        least: from :func:`slips_least`.
        members, speed: from :func:`most`.
        sure: from :func:`is_sure`.
        proof: so far.
    """
    taken = jnp.any(members) & (sure | (proof >= _TAKES))
    return jnp.where(taken, speed, least)


def proves(
    proof: Float[Array, ""], members: Bool[Array, " 4"], sure: Bool[Array, ""], dt: Float[Array, ""]
) -> Float[Array, ""]:
    """s for which wheels have agreed on a speed, which stays once it is enough.

    Args:
        proof: so far.
        members: from :func:`most`.
        sure: from :func:`is_sure`.
        dt: s.
    """
    counts = jnp.where(sure, 1.0, _UNSURE)
    return jnp.where(is_proven(proof), proof, jnp.where(jnp.any(members), proof + counts * dt, 0.0))


def refutes(
    rolling: Float[Array, ""], bears: Float[Array, ""], speed: Float[Array, ""], spread: Float[Array, ""]
) -> Bool[Array, ""]:
    """Whether what wheels told of the speed was none: one turns faster though its tire slows the car down, or
    more slowly though it pushes it.

    Args:
        rolling: speed of the wheel that slips least, m/s.
        bears: force over load in the mean.
        speed: as known so far, m/s, and
        spread: its 1σ.
    """
    beyond = -jnp.sign(bears) * (rolling - speed)
    return (jnp.abs(bears) > BEARS) & (beyond > _OUTDOES[0] + _OUTDOES[1] * spread)


def least_slip(
    rim: Float[Array, " 4"], apart: Float[Array, ""], clear: Bool[Array, ""]
) -> Float[Array, " 4"]:
    """(4,) 1σ of the speed that each wheel tells by what the one slips that slips least, m/s.

    Args:
        rim: the car's speed as each wheel tells it, m/s.
        apart: what they are apart, m/s.
        clear: whether it is known why: one is wrong, or they race.
    """
    slip = _LEAST_SLIP[0] + _LEAST_SLIP[1] * jnp.abs(rim)
    return jnp.where(clear, slip, slip + _PUZZLING * apart)
