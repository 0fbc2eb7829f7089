"""Which sensor lies: wrong signs, and readings that all others contradict."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core.kernel import once
from roadstate.estimators.axle_forces import AxleForces
from roadstate.estimators.intake import ACCEL_X, ACCEL_Y, SPIN, STALE, STEER, YAW_RATE, Signals
from roadstate.estimators.redundancy import DELAY, GROUP, TELLINGS, Redundancy, Slide, inner_mean
from roadstate.estimators.signals import Held

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_COUNT = len(TELLINGS)
_SMOOTHING = 0.15  # s
# s in which a slope's part is learnt, and m/s³, no faster than that: of accelerometer and torques that agree,
# up to a speed in m/s, above it the slower the faster (what a road's bends do to a car's weight is bounded);
# and of either alone, which may lie
_SLOPE = (1.5, 0.5, 10.0)
_ALONE = (5.0, 0.1)
# s in which a road's lean is learnt; m/s² of it for each metre, and (m/s²)² for each second, no faster; and
# m/s² at the most
_LEAN = (1.5, 0.05, 7.5, 3.0)
# s after a standstill for which it may be learnt faster, and m/s³
_PARKED = (4.0, 1.0)
_AFTERWARDS = 1.0  # s that a wheel which has spun or locked takes to roll freely
# m/s² by which each of two may differ from their mean for a slope, or a lean, to be learnt from them
_AGREE = 0.25
_GRADE = 0.8  # m/s²: what a slope that has just begun may do
_SETTLED = 0.5  # s for which a telling must have been there
_LASTING = 0.2  # s: errors that are independent are so far apart
_ALLOWED = 1.0  # squared deviations, over 2σ², that errors which last may make
_MOST = 4.0  # evidence that one such time can give
_LIES = 7.0  # evidence from which on a channel is left out
_SWAPPED = 14.0  # and from which on its sign is taken for swapped: odds of 10⁶
_ONE_SIDED = 4.0  # times as much, where bends of one side only, or no brake, have been seen
_TRUST = 10.0  # times as much, at most, is remembered in favour of a sign
_FORGETS = 0.5  # 1/s: evidence lost while nothing can be tested
# which tellings may have a swapped sign, and by how many others it takes to say so
_SIGNED = np.isin(TELLINGS, ("accel_x", "yaw_rate", "front_pair", "rear_pair", "accel_y", "steer"))
_JURY = np.where(np.isin(TELLINGS, ("accel_x",)), 1, 2)
_ACCUSED = ~np.isin(TELLINGS, ("front_pair", "rear_pair"))
_PAIRS = (TELLINGS.index("front_pair"), TELLINGS.index("rear_pair"))
TORQUE = TELLINGS.index("torque")
_WHEELS = TELLINGS.index("wheels_accel")
_ASIDE = TELLINGS.index("accel_y")
_ROWS = tuple(TELLINGS.index(name) for name in ("accel_x", "accel_y", "yaw_rate", "steer"))
_IS_WHEEL = np.array([name.startswith("wheel_") for name in TELLINGS])
# of each telling the row of :data:`~roadstate.estimators.intake.ROWS`; 8 for all wheels, 9 for none of these
_SOURCE = (ACCEL_X, 8, 9, YAW_RATE, 9, 9, ACCEL_Y, STEER, *range(SPIN.start, SPIN.stop), 9)
_CALLED = {
    "wheels_accel": "wheel speeds",
    "torque": "torques",
    "front_pair": "front wheels",
    "rear_pair": "rear wheels",
    **{name: f"wheel_speed_{name[-2:]}" for name in np.array(TELLINGS)[_IS_WHEEL]},
}
_OTHERS = (GROUP[:, None] == GROUP[None]) & ~np.eye(_COUNT, dtype=bool)


class PlausibilityState(NamedTuple):
    """State of :class:`Plausibility`.

    Attributes:
        since: (13,) s for which each of :data:`~roadstate.estimators.redundancy.TELLINGS` has been there.
        smooth: (13,) low-passed.
        slope: what a slope adds to the wheels' acceleration, m/s².
        lean: what a road's lean adds to v r, m/s².
        evidence: (4, 13) that a channel's sign is swapped, while the others say more than 0, and less; that
            it is not right; that it is not right with its sign swapped either.
        proven: (13,) whether its sign has ever been as sure to be right as it takes to be taken for swapped.
        reference: (13,) what the others say.
        effort: (4,) m/s², how hard drive and brakes have acted of late.
        excused: (4,) s for which each wheel may go on spinning or locked.
        slide: how far the car goes aside.
        speed: the speed signal.
    """

    since: Float[Array, " 13"]
    smooth: Float[Array, " 13"]
    slope: Float[Array, ""]
    lean: Float[Array, ""]
    evidence: Float[Array, "4 13"]
    proven: Bool[Array, " 13"]
    reference: Float[Array, " 13"]
    effort: Float[Array, " 4"]
    excused: Float[Array, " 4"]
    slide: Slide
    speed: Held


class Verdict(NamedTuple):
    """(13,) of each telling: its sign is swapped; it lies and cannot be used."""

    swapped: Bool[Array, " 13"]
    lies: Bool[Array, " 13"]

    def sign(self, row: int) -> Float[Array, ""]:
        """By what to multiply a row of :data:`~roadstate.estimators.intake.ROWS`, of the first four."""
        return jnp.where(self.swapped[_ROWS[row]], -1.0, 1.0)


class Plausibility(eqx.Module):
    """Sequential tests of each telling y against q, what the others of its group say (but for extremes).

    With e of variance σ², that of y and of q and of the others' disagreement, three hypotheses: y = q + e,
    y = −q + e, and neither. For swapped against right the evidence is the logarithm of the likelihood ratio,
    ((y − q)² − (y + q)²)/2σ² = −2 y q/σ² for each time in which errors become independent: a sequential
    probability ratio test (Wald 1945), applied where q exceeds σ. For neither it is
    (y − q)²/2σ² beyond what errors that last can make, summed up from zero (Page 1954, *Biometrika* 41).
    Evidence of one time is limited, so that no brief disturbance decides. An offset looks like a swapped sign
    as long as q has the other sign: so the test of the sign is one for each sign of q, and takes both, or
    much of one (not from a pair of wheels, where a soft tire makes a large offset). So does a road that leans
    into its bend more than the speed asks for: what a lean would explain tells nothing of the sign.

    A channel that repeats its last value to the bit does not gain credit by what it says. A channel can be
    accused where two others agree, the sign of the longitudinal accelerometer also by the wheels alone, whose
    acceleration a slope makes differ from it, slowly. A sign that has proved right for long takes as much
    more to be doubted, and is never put right: how a sensor is mounted does not change on the way, so it is
    one that lies, and may as well be right again.

    Attributes:
        redundancy: what tells the same.
    """

    redundancy: Redundancy

    def __init__(self, vehicle: Vehicle, available: Collection[str]) -> None:
        self.redundancy = Redundancy(vehicle, available)

    def init(self) -> PlausibilityState:
        """Nothing is known of any."""
        none = jnp.zeros(_COUNT)
        zero = jnp.zeros(())
        evidence, never, four = jnp.zeros((4, _COUNT)), none > 0, jnp.zeros(4)
        return PlausibilityState(
            none, none, zero, zero, evidence, never, none, four, four, Slide.none(), Held.empty()
        )

    def fault_names(self, named: Sequence[str | None]) -> tuple[str, ...]:
        """What :meth:`faults` tells of, as sentences.

        Args:
            named: channels of :data:`~roadstate.estimators.intake.ROWS`.
        """
        rows = {TELLINGS[place]: named[row] or TELLINGS[place] for row, place in enumerate(_ROWS)}
        names = {name: _CALLED.get(name) or rows.get(name, name) for name in TELLINGS}
        signed = [names[name] for name in np.array(TELLINGS)[_SIGNED]]
        accused = [names[name] for name in np.array(TELLINGS)[_ACCUSED]]
        return (
            *(
                f"{name}: left and right swapped, or yaw rate, lateral acceleration and steering all with "
                "the wrong sign (put right here); mend the mapping"
                if name.endswith(" wheels")
                else f"{name}: wrong sign (put right here); flip it in the mapping"
                for name in signed
            ),
            *(f"{name}: contradicts what others tell; left out" for name in accused),
        )

    def faults(self, verdict: Verdict) -> Bool[Array, " f"]:
        """Which of :meth:`fault_names` there are."""
        places = [jnp.asarray(np.flatnonzero(which)) for which in (_SIGNED, _ACCUSED)]
        return jnp.concatenate([verdict.swapped[places[0]], verdict.lies[places[1]]])

    def verdict(self, state: PlausibilityState) -> Verdict:
        """What is thought of each now."""
        plus, minus, right, swapped = state.evidence
        both, one = jnp.minimum(plus, minus) > _SWAPPED, jnp.maximum(plus, minus) > _ONE_SIDED * _SWAPPED
        one = one & (jnp.minimum(plus, minus) > -_SWAPPED) & jnp.asarray(_ACCUSED)
        is_swapped = (both | one) & (swapped < _LIES) & (~state.proven) & jnp.asarray(_SIGNED)
        return Verdict(is_swapped, (right > _LIES) & (~is_swapped) & jnp.asarray(_ACCUSED))

    def mend(
        self, state: PlausibilityState, verdict: Verdict, seen: Signals, speed: Float[Array, ""]
    ) -> Signals:
        """Signals with swapped signs put right, swapped sides too, and without those that lie.

        In place of an acceleration or yaw rate that lies or is missing comes what others say of it.
        """
        rows = jnp.asarray(_ROWS)
        sign = jnp.where(verdict.swapped[rows], -1.0, 1.0)
        sides = jnp.stack([verdict.swapped[p] for p in _PAIRS]).repeat(2)
        every = verdict.lies[_WHEELS]
        wheels = verdict.lies[TELLINGS.index("wheel_fl") : TELLINGS.index("wheel_rr") + 1] | every
        lies = jnp.concatenate([verdict.lies[rows], wheels])
        along = state.smooth[_WHEELS]
        across, turning = (state.reference[_ROWS[row]] for row in (ACCEL_Y, YAW_RATE))
        instead = jnp.concatenate([jnp.stack([along, across * speed, turning]), jnp.zeros(5)])
        replaced = (lies | (seen.age >= STALE)) & (np.arange(8) <= YAW_RATE)

        def put_right(values: Array, other: Array) -> Array:
            spin = values[SPIN]
            spin = jnp.where(sides, spin[jnp.asarray([1, 0, 3, 2])], spin)
            return jnp.where(replaced, other, jnp.concatenate([values[:4] * sign, spin]))

        return seen._replace(
            value=put_right(seen.value, instead),
            smooth=put_right(seen.smooth, instead),
            rate=put_right(seen.rate, jnp.zeros(8)),
            now=put_right(seen.now, instead),
            now_rate=put_right(seen.now_rate, jnp.zeros(8)),
            age=jnp.where(lies, jnp.maximum(seen.age, 2 * STALE), seen.age),
            is_fresh=seen.is_fresh & (~lies),
        )

    def test(
        self,
        state: PlausibilityState,
        seen: Signals,
        forces: AxleForces,
        signal: Float[Array, ""],
        speed: Float[Array, ""],
        velocity_y: Float[Array, ""],
        friction: Float[Array, ""],
        frozen: Bool[Array, " 8"],
        dt: Float[Array, ""],
    ) -> PlausibilityState:
        """Take what a sample, ``dt`` after the last, tells.

        Args:
            state: from :meth:`init` or the last call.
            seen: as the sensors say.
            forces: at this instant.
            signal: m/s, a speed signal's sample, signed; NaN where there is none.
            speed: m/s, the estimate.
            velocity_y: m/s, likewise.
            friction: of the road, likewise.
            frozen: (8,) which signals only repeat themselves.
            dt: s.
        """
        held = state.speed.take(signal, dt)
        last = TELLINGS.index("speed")
        rate = (held.value - state.smooth[last]) / _SMOOTHING
        effort = jnp.maximum(state.effort * jnp.exp(-dt / _AFTERWARDS), self.redundancy.effort(seen, forces))
        excused = self.redundancy.excused(state.excused, seen, forces, effort, speed, dt)
        motion = speed, velocity_y, friction
        told = self.redundancy.tell(seen, forces, held, rate, effort, excused, state.slide, *motion, dt)
        value, std = once((told.value, told.std))
        there = jnp.isfinite(std)
        since = jnp.where(there, state.since + dt, 0.0)
        begins = state.since <= 0
        value = jnp.where(there, value, 0.0)
        smooth = state.smooth - jnp.where(begins, -1.0, jnp.expm1(-dt / _SMOOTHING)) * (value - state.smooth)
        places = np.arange(_COUNT)
        pace = jnp.where(speed < 0, -1.0, 1.0) * jnp.maximum(jnp.abs(speed), 1.0)
        level = smooth + jnp.where(places == _WHEELS, state.slope, 0.0)
        y = level - jnp.where(places == _ASIDE, state.lean / pace, 0.0)
        moves = jnp.asarray(DELAY, value.dtype) * (value - smooth) / _SMOOTHING
        variance = jnp.where(there, std, 0.0) ** 2 + moves**2
        ready = there & (since > _SETTLED)
        felt, apart, few = inner_mean(y[::2][:2], ready[::2][:2])
        learns = ready[_WHEELS] & (few > 0) & (apart < _AGREE**2)
        more = jnp.where(learns, felt - y[_WHEELS], 0.0)
        both, steepens = few > 1, _SLOPE[1] * jnp.minimum(1.0, _SLOPE[2] / jnp.abs(pace))
        within, fastest = jnp.where(both, _SLOPE[0], _ALONE[0]), jnp.where(both, steepens, _ALONE[1])
        slope = _learnt(state.slope, more, within, fastest, dt)
        # wheels whose acceleration is wrong may agree with one another
        together = state.evidence[2, _WHEELS] > _LIES
        others = jnp.asarray(_OTHERS) & ready & (~(together & jnp.asarray(_IS_WHEEL)))
        level, y, variance, others = once((level, y, variance, others))
        reference, apart, count = inner_mean(jnp.broadcast_to(y, (_COUNT, _COUNT)), others)
        alike = ready[_ASIDE] & (count[_ASIDE] > 1) & (apart[_ASIDE] * pace**2 < _AGREE**2)
        # one that lies would teach its own offset
        alike = alike & (state.evidence[2, _ASIDE] < _LIES)
        beyond = jnp.where(alike, pace * (y[_ASIDE] - reference[_ASIDE]), 0.0)
        tips = jnp.minimum(_LEAN[1] * jnp.abs(pace), _LEAN[2] / jnp.abs(pace))
        tips = jnp.where(since[_ASIDE] < _PARKED[0], _PARKED[1], tips)
        lean = jnp.clip(_learnt(state.lean, beyond, _LEAN[0], tips, dt), -_LEAN[3], _LEAN[3])
        # as extremes do not count, one that is hardly sure makes the mean no worse than another would
        theirs = jnp.sum(jnp.where(others, jnp.sqrt(variance), 0.0), axis=1) / jnp.maximum(count, 1.0)
        total = jnp.maximum(variance + theirs**2 + apart, 1e-9)
        # a slope is no fault of the wheels
        steep = np.where(places == _WHEELS, _GRADE, 0.0)
        level_right, right = (0.5 * (x - reference) ** 2 / (total + steep**2) for x in (level, y))
        right = jnp.minimum(right, level_right)
        wrong = 0.5 * (level + reference) ** 2 / total
        told_by = ready & (count >= _JURY.astype(count.dtype))
        judged = ready & (count >= 2) & told.answers
        # a lean that looks like a swapped sign speaks neither for it nor against it
        ratio = jnp.where(level_right > wrong, jnp.maximum(right - wrong, 0.0), level_right - wrong)
        ratio = jnp.where(reference**2 > total, ratio, 0.0)  # small offsets must not add up
        over, under = jnp.where(reference > 0, ratio, 0.0), jnp.where(reference < 0, ratio, 0.0)
        # what fits a swapped sign counts only where the right one would not
        fits = jnp.where((wrong > _ALLOWED) | (right > _ALLOWED), wrong - _ALLOWED, 0.0)
        evidence = jnp.stack([over, under, right - _ALLOWED, fits])
        evidence = jnp.where(told_by, jnp.clip(evidence, -_MOST, _MOST), 0.0) * (dt / _LASTING)
        lies = jnp.where(judged, evidence[2], -_FORGETS * dt)
        repeats = jnp.append(frozen, jnp.stack([jnp.all(frozen[SPIN]), jnp.zeros((), bool)]))
        repeats = jnp.stack([repeats[source] for source in _SOURCE])
        evidence = evidence.at[2].set(jnp.where(repeats, jnp.maximum(lies, 0.0), lies))
        least = jnp.asarray([-_TRUST * _SWAPPED, -_TRUST * _SWAPPED, 0.0, 0.0])[:, None]
        most = jnp.asarray([(_ONE_SIDED + 1) * _SWAPPED] * 2 + [2 * _LIES] * 2)[:, None]
        raised = jnp.clip(state.evidence + evidence, least, most)
        proven = state.proven | (jnp.min(raised[:2], axis=0) < -_SWAPPED)
        return PlausibilityState(
            since, smooth, slope, lean, raised, proven, reference, effort, excused, told.slide, held
        )


def _learnt(
    value: Float[Array, ""],
    off: Float[Array, ""],
    within: Float[Array, ""] | float,
    fastest: Float[Array, ""],
    dt: Float[Array, ""],
) -> Float[Array, ""]:
    """A value that is ``off`` by so much, ``dt`` later: learnt within so many s, no faster than at a rate."""
    return value - jnp.expm1(-dt / within) * jnp.clip(off, -within * fastest, within * fastest)
