"""What the joint estimator makes of a sample's channels before anything is estimated of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from jaxtyping import Array, Bool, Float

from roadstate.core.kernel import once
from roadstate.estimators.along import SPEED
from roadstate.estimators.base import Sample
from roadstate.estimators.direction import DirectionState
from roadstate.estimators.intake import ACCEL_X, Signals, SignalState
from roadstate.estimators.plausibility import Verdict
from roadstate.estimators.watch import WatchState

if TYPE_CHECKING:
    from roadstate.estimators.joint import Joint, JointState


class Reading(NamedTuple):
    """A sample's signals, and how far each is believed.

    Attributes:
        watch, held, direction: states of the parts that read them.
        sample: the channels, without those that are frozen.
        raw: signals with the signs of the car's motion and with even wheels, as they came otherwise.
        seen: the same, mended by the verdict, as from the centre of gravity.
        verdict: on the sensors, as of the sample before.
        way: by what an unsigned speed is to be multiplied; NaN where that is not known.
        rolls: mean speed of the wheels, m/s.
        slides: whether the car has been seen to slide.
    """

    watch: WatchState
    held: SignalState
    direction: DirectionState
    sample: Sample
    raw: Signals
    seen: Signals
    verdict: Verdict
    way: Float[Array, ""]
    rolls: Float[Array, ""]
    slides: Bool[Array, ""]


def read(joint: Joint, state: JointState, sample: Sample, dt: Float[Array, ""]) -> Reading:
    """Read the channels of a sample ``dt`` (s) after the last.

    Args:
        joint: the estimator.
        state: of it, before this sample.
        sample: all channels.
        dt: s.
    """
    speed = state.along.gaussian.mean[SPEED]
    watch = once(joint.watch.look(state.watch, sample, speed, dt))
    sample = joint.watch.without_frozen(watch, sample)
    held, raw = joint.signals.read(state.signals, sample, speed, dt)
    verdict, slides = joint.trust.verdict(state.trust), state.trust.slide.lasts > 0
    direction, raw, way = joint.direction.turn(
        state.direction, raw, sample, held.gear, state.along.gaussian, verdict.sign(ACCEL_X), dt
    )
    raw, verdict, way = once((joint.radii.even(state.radii, raw), verdict, way))
    seen = once(joint.signals.centred(joint.trust.mend(state.trust, verdict, raw, speed)))
    rolls = joint.inputs.rims.mean(seen)
    return Reading(watch, held, direction, sample, raw, seen, verdict, way, rolls, slides)
