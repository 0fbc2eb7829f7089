"""How the joint estimator finds out that it has been led astray, by a sensor or by itself, and comes back."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core.kernel import once
from roadstate.estimators.agreement import is_proven, refutes
from roadstate.estimators.along import SLOPE, SPEED
from roadstate.estimators.astray import WRONG, is_astray, outvoted
from roadstate.estimators.axle_forces import AxleForces
from roadstate.estimators.friction_bank import BankState
from roadstate.estimators.intake import REPEATS, SPIN
from roadstate.estimators.joint_motion import Along
from roadstate.estimators.joint_reading import Reading
from roadstate.estimators.pace import Pace
from roadstate.estimators.plausibility import PlausibilityState
from roadstate.estimators.redundancy import GROUP, YAW
from roadstate.estimators.roll import RollState
from roadstate.estimators.undulation import Undulation
from roadstate.filters import FilterState
from roadstate.filters.base import select

if TYPE_CHECKING:
    from roadstate.estimators.joint import Joint, JointState

_AFRESH = 0.4  # s until what is slowed has forgotten a sensor that lied
_CONFIRMED = 3.0  # samples of a speed signal, in a row, that wheels confirm and the filter contradicts
_ROLLED = 0.2  # s for which wheels that roll freely contradict it, which count as much as one of these


class Recovered(NamedTuple):
    """States, begun anew where they were wrong.

    Attributes:
        trust, along, undulation, pace, bank: the parts'.
        against, doubt: as :class:`~roadstate.estimators.joint.JointState`.
    """

    trust: PlausibilityState
    along: FilterState
    undulation: Undulation
    pace: Pace
    bank: BankState
    against: Float[Array, ""]
    doubt: Float[Array, ""]


def recover(
    joint: Joint,
    state: JointState,
    reading: Reading,
    moved: Along,
    balance: AxleForces,
    friction: tuple[Pace, BankState],
    roll: RollState,
    dt: Float[Array, ""],
) -> Recovered:
    """Judge the sensors by each other and the filter by them; give up what cannot be.

    Args:
        joint: the estimator.
        state: of it, before this sample.
        reading: of this sample.
        moved: of this sample.
        balance: forces of this instant, whatever is thought of the torques.
        friction: states of pace and bank after this sample.
        roll: after this sample.
        dt: s.
    """
    held, verdict, speed, gaussian = reading.held, reading.verdict, moved.speed, moved.filter.gaussian
    share = 1 + joint.along.rolling(gaussian, speed)[0]
    raw = reading.raw
    if "wheel_radius" in joint.along.states:
        raw = raw.scaled(jnp.ones(8).at[SPIN].set(share))
    heavier = 1 - joint.along.lightness(gaussian.mean)
    heavy = balance._replace(explained=balance.explained - heavier * joint.along.moved(moved.u))
    motion = speed, moved.sideslip[0], state.friction[1, 0]
    trust = joint.trust.test(state.trust, raw, heavy, moved.signal, *motion, held.repeats >= REPEATS, dt)
    trust, now = once((trust, joint.trust.verdict(trust)))
    found = (now.lies & (~verdict.lies)) | (now.swapped != verdict.swapped)
    # the car was taken to go backward as its wheels told
    turned = jnp.any((held.sense < 0) & (state.signals.sense == 0))
    turned = (turned | reading.direction.is_refuted(state.direction)) & (reading.rolls * speed < 0)
    trust = once(select(turned, joint.trust.init(), trust))
    has_moved = joint.radii.has_moved(moved.radii)
    caught = jnp.any(found) | turned | has_moved | joint.roll.contradicts(roll)
    rolls = jnp.where(jnp.any(reading.seen.is_fresh[SPIN]), share * moved.rims.rolling, speed)
    lost, against = _lost(joint, state, reading, moved, balance, share, rolls, dt)
    lost = lost | turned
    # what was learnt from a sensor that lies may be wrong
    spoilt = jnp.any(found & (GROUP != YAW)) | _freezes(joint, state, reading) | lost | has_moved
    begin = jnp.where(lost, rolls, speed)
    along = moved.filter._replace(gaussian=joint.along.doubt(gaussian, spoilt, begin))
    undulation = joint.along.undulation(state.along.gaussian, gaussian, moved.u, dt)
    undulation = select(spoilt, Undulation.none(), undulation)
    doubt = jnp.where(jnp.any(verdict.lies) | caught, _AFRESH, state.doubt - dt)
    afresh = (doubt > 0) | ~joint.bank.is_sound(friction[1])
    pace, bank = once(select(afresh, (Pace.start(), joint.bank.init()), friction))
    return Recovered(trust, along, undulation, pace, bank, jnp.where(lost, 0.0, against), doubt)


def _lost(
    joint: Joint,
    state: JointState,
    reading: Reading,
    moved: Along,
    balance: AxleForces,
    share: Array,
    rolls: Array,
    dt: Array,
) -> tuple[Bool[Array, ""], Float[Array, ""]]:
    """Whether the filter's speed cannot be, and for how long wheels have contradicted it.

    Args:
        joint, state, reading, moved, balance, dt: as :func:`recover`.
        share: of the radii in the file that wheels roll on.
        rolls: m/s that wheels tell so.
    """
    speed, gaussian, rims, against = moved.speed, moved.filter.gaussian, moved.rims, state.against
    if "speed" in joint.channels and any(joint.signals.has[SPIN]):
        rims_say = share * joint.inputs.rims.radius * reading.seen.value[SPIN], reading.seen.is_fresh[SPIN]
        told = reading.sample["speed"]
        against = outvoted(against, told, *rims_say, rolls, speed, balance.accel[0])
    contradicted = jnp.where(jnp.abs(rolls - speed) > WRONG, state.against + dt / _ROLLED, 0.0)
    against = jnp.where(rims.rolls, contradicted, against)
    astray = is_astray(gaussian, speed, gaussian.mean[SLOPE])
    spread, bears = gaussian.std[SPEED], jnp.mean(balance.over_load)
    refuted = ~is_proven(rims.proof) & refutes(rolls, bears, speed, spread)
    return (against >= _CONFIRMED) | astray | refuted, against


def _freezes(joint: Joint, state: JointState, reading: Reading) -> Bool[Array, ""]:
    """Whether just now all wheels turn out to repeat themselves, which made the slope seem steep."""
    frozen = reading.raw.is_faulty[SPIN] & (reading.held.repeats[SPIN] >= REPEATS)
    has = np.array(joint.signals.has[SPIN])
    before = jnp.max(jnp.where(has, state.fault_age[SPIN], 0.0)) > 0
    return jnp.all(frozen | ~has) & bool(has.any()) & ~before
