"""Which channels have fallen silent, which are frozen, and which have samples that cannot be true."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from roadstate.core.channels import RATES, SPECIFIC_FORCES
from roadstate.estimators.base import Sample

_SILENT = 0.25  # s without a sample, besides twice the longest usual gap
_PAUSE = (0.2, 20.0)  # s, and intervals of the fastest channel: the most that a step of the log counts for
_FORGETS = 60.0  # s after which a long gap is no longer usual
_LATEST = 1.0  # s: a longer silence is no jump of a clock, and what comes after it is in time
_ALARM = 0.5  # s for which a spike is told
# s that equal samples, which err alike, count for at the most, and after which that they came is forgotten
_REPEATS, _REFRESHED = 0.5, 0.5
_LEAST_STEP = 1e-3  # s
_COARSEST = 1.5  # of a channel's unit: the largest step in which it may come
# by how much no channel changes from sample to sample, to be back at the next, if they are s apart at most
_SPIKES = {
    "accel_?": (8.0, 0.03),
    "*_rate": (0.4, 0.03),
    "steer": (0.1, 0.03),
    "steering_wheel": (0.8, 0.03),
    "wheel_speed_*": (12.0, 0.03),
    "*_torque_*": (600.0, 0.03),
    "engine_torque": (200.0, 0.03),
    "brake_pressure_*": (5e6, 0.03),
    "engine_speed": (200.0, 0.03),
    "speed": (4.0, 0.25),
    "altitude": (25.0, 0.25),
    "vertical_speed": (3.0, 0.25),
}
# channels whose noise changes nearly every sample, if they come often: samples in a row that are equal, on
# average, at the most; s between samples; and s for which that must have been so
_NOISY = {*SPECIFIC_FORCES, *RATES}
_EQUAL, _OFTEN, _KNOWN = 2.5, 0.03, 5.0
_FROZEN = (40.0, 5.0)  # equal samples in a row, and times the most before, from which on such a one is frozen
_DRIVES = 3.0  # m/s: of a car that stands still, sensors with coarse steps may well say the same
# m/s by which the car's speed changes by more than a step until a speed that repeats is stuck: one that
# moves, and one that may well stand, for of slow motion many a signal says 0
_STUCK, _STANDS = (0.3, 1.0), 1.0


class WatchState(NamedTuple):
    """State of :class:`Watch`.

    Attributes:
        last, before: (n,) the latest sample of each channel and the one before it.
        age, interval: (n,) s since the latest, and between the two; huge before the first.
        gap: (n,) s, the longest usual interval; 0 before there is one.
        alarm: (n,) s for which a spike will still be told.
        late: (n,) s by which a channel may be late since it was silent as long, as when its clock has jumped.
        repeated: (n,) s for which the latest sample has repeated the one before it.
        repeats: (n,) s, the longest of that of late.
        step: (n,) the least by which two samples in a row differed; infinite before any did.
        began: (n,) m/s, the car's speed when the latest sample first came.
        equal, most: (n,) equal samples in a row while the car drives: the latest ones, and the most before.
        rows, samples: (n,) how many such rows there were, of one sample or more, and samples in them all.
    """

    last: Float[Array, " n"]
    before: Float[Array, " n"]
    age: Float[Array, " n"]
    interval: Float[Array, " n"]
    gap: Float[Array, " n"]
    alarm: Float[Array, " n"]
    late: Float[Array, " n"]
    repeated: Float[Array, " n"]
    repeats: Float[Array, " n"]
    step: Float[Array, " n"]
    began: Float[Array, " n"]
    equal: Float[Array, " n"]
    most: Float[Array, " n"]
    rows: Float[Array, " n"]
    samples: Float[Array, " n"]

    @property
    def is_silent(self) -> Bool[Array, " n"]:
        """(n,) a channel that used to come, and comes no more."""
        return (self.gap > 0) & (self.age > _SILENT + 2 * self.gap)

    @property
    def has_spikes(self) -> Bool[Array, " n"]:
        """(n,) a channel that has just gone far and come back within two samples."""
        return self.alarm > 0


class Watch(eqx.Module):
    """Looks at each channel by itself, whatever it measures.

    How often a channel comes it tells by coming: one that has been away for clearly longer than it usually is
    has fallen silent. If it comes again, so long a gap counts as half usual, so that a channel which is sent
    when it changes is soon known as such. A sample that lies far from both its neighbours, which agree, is a
    spike: known as such one sample later, when it can be told but no longer be left out. An inertial channel
    whose noise used to change nearly every sample, and which says the same to the last bit while the car
    drives, is frozen; one whose steps are coarser than its noise cannot be judged by that.

    Attributes:
        channels: looked at.
    """

    channels: tuple[str, ...] = eqx.field(static=True)
    _most: Float[Array, " n"]
    _short: Float[Array, " n"]
    _noisy: tuple[bool, ...] = eqx.field(static=True)

    def __init__(self, channels: tuple[str, ...]) -> None:
        self.channels = channels
        found = [[limit for p, limit in _SPIKES.items() if fnmatchcase(c, p)] for c in channels]
        limits = np.array([own[0] if own else (np.inf, 0.0) for own in found])
        self._most, self._short = jnp.asarray(limits[:, 0]), jnp.asarray(limits[:, 1])
        self._noisy = tuple(c in _NOISY for c in channels)

    def init(self) -> WatchState:
        """Nothing has come."""
        none = jnp.zeros(len(self.channels))
        never = none + 1e6
        return WatchState(
            none, none, never, never, none, none, none, none, none, none + jnp.inf, none, *[none] * 4
        )

    @property
    def fault_names(self) -> tuple[str, ...]:
        """What :meth:`faults` tells of, as sentences: first of each channel that it is silent."""
        return (
            *(f"{c}: no samples any more" for c in self.channels),
            *(f"{c}: a sample far off its neighbours" for c in self.channels),
            *(f"{c}: stuck, the same to the last bit while the car drives" for c in self.channels),
        )

    def faults(self, state: WatchState) -> Bool[Array, " f"]:
        """Which of :attr:`fault_names` there are."""
        return jnp.concatenate([state.is_silent, state.has_spikes, self.is_frozen(state)])

    def is_frozen(self, state: WatchState) -> Bool[Array, " n"]:
        """(n,) a noisy channel that says the same to the last bit while the car drives."""
        noisy = jnp.asarray(self._noisy, bool) & (state.samples < _EQUAL * state.rows)
        known = (state.interval < _OFTEN) & (state.samples * state.interval > _KNOWN)
        return noisy & known & (state.equal > jnp.maximum(_FROZEN[0], _FROZEN[1] * state.most))

    def without_frozen(self, state: WatchState, sample: Sample) -> Sample:
        """The sample, frozen channels missing.

        Args:
            state: after :meth:`look` at this sample.
            sample: the channels at this instant.
        """
        frozen = self.is_frozen(state)
        judged = zip(self.channels, frozen, self._noisy, strict=True)
        return {**sample, **{c: jnp.where(is_so, jnp.nan, sample[c]) for c, is_so, noisy in judged if noisy}}

    def lateness(self, state: WatchState, sensors: Sequence[str]) -> Float[Array, " m"]:
        """(m,) s by which speeds and an accelerometer along may be late; 0 for all else, or not watched."""
        counts = np.array(
            [s in self.channels and s.startswith(("speed", "wheel_speed", "accel_x")) for s in sensors]
        )
        return jnp.where(counts, state.late[self._places(sensors)], 0.0)

    def since(self, state: WatchState, sensors: Sequence[str]) -> Float[Array, " m"]:
        """(m,) s from the sample before to the latest of each sensor; of one not watched, anything."""
        return state.interval[self._places(sensors)]

    def alike(self, state: WatchState, sensors: Sequence[str]) -> Float[Array, " m"]:
        """(m,) how many samples of each sensor are as good as one; 1 of a wheel, or not watched.

        A speed in whole km/h that comes a hundred times a second repeats itself, and its error with it.
        """
        counts = np.array([s in self.channels and not s.startswith("wheel_speed") for s in sensors])
        places = self._places(sensors)
        alike = 1 + state.repeats[places] / jnp.maximum(state.interval[places], _LEAST_STEP)
        return jnp.where(counts, alike, 1.0)

    def step(self, state: WatchState, channels: Sequence[str]) -> Float[Array, " m"]:
        """(m,) in what steps channels come, as far as :data:`_COARSEST`; 0 before that is known."""
        step = state.step[self._places(channels)]
        return jnp.where(jnp.isfinite(step), jnp.minimum(step, _COARSEST), 0.0)

    def _places(self, sensors: Sequence[str]) -> Int[Array, " m"]:
        return jnp.asarray([self.channels.index(s) if s in self.channels else 0 for s in sensors])

    def is_stuck(self, state: WatchState, speed: Float[Array, ""]) -> Bool[Array, ""]:
        """Whether the speed signal repeats itself while the car's speed, now ``speed`` (m/s), changes."""
        if "speed" not in self.channels:
            return jnp.asarray(False)
        place = self.channels.index("speed")
        gained = jnp.abs(speed - state.began[place])
        most = self.step(state, ("speed",))[0] + jnp.where(jnp.abs(state.last[place]) > _STANDS, *_STUCK)
        return (gained > most) & (state.repeated[place] > 0)

    def look(
        self, state: WatchState, sample: Sample, speed: Float[Array, ""], dt: Float[Array, ""]
    ) -> WatchState:
        """Take a sample ``dt`` (s) after the last, when the car's speed was ``speed`` (m/s)."""
        now = jnp.stack([sample[c] for c in self.channels])
        seen = jnp.isfinite(now)
        now = jnp.where(seen, now, state.last)
        # where the whole log has a gap, no channel is to blame
        since = state.age + jnp.minimum(dt, jnp.maximum(_PAUSE[0], _PAUSE[1] * jnp.min(state.interval)))
        came = state.age < 1e6
        usual = jnp.where(state.is_silent, jnp.minimum(since, 2 * state.gap + 0.5 * _SILENT), since)
        gap = jnp.where(seen & came, jnp.maximum(usual, state.gap * jnp.exp(-since / _FORGETS)), state.gap)
        there, back = state.last - state.before, now - state.last
        far = jnp.minimum(jnp.abs(there), jnp.abs(back)) > self._most
        home = jnp.abs(there + back) < 0.5 * self._most
        silence = jnp.where(since <= _LATEST, since, 0.0)
        spike = seen & far & home & (jnp.maximum(since, state.interval) < self._short)
        change = jnp.abs(now - state.last)
        same = came & (change == 0)
        repeated = jnp.where(seen, jnp.where(same, state.repeated + since, 0.0), state.repeated)
        repeats = jnp.maximum(jnp.minimum(repeated, _REPEATS), state.repeats * jnp.exp(-dt / _REFRESHED))
        steps = seen & came & (change > 0)
        drives = jnp.abs(speed) > _DRIVES
        ends = steps & drives & ~self.is_frozen(state)
        return WatchState(
            last=now,
            before=jnp.where(seen, state.last, state.before),
            age=jnp.where(seen, 0.0, since),
            interval=jnp.where(seen, since, state.interval),
            gap=gap,
            alarm=jnp.where(spike, _ALARM, state.alarm - dt),
            late=jnp.where(seen & state.is_silent, silence, state.late * jnp.exp(-dt / _FORGETS)),
            repeated=repeated,
            repeats=repeats,
            began=jnp.where(seen & ~same, jnp.where(came, speed, now), state.began),
            step=jnp.where(steps, jnp.minimum(state.step, change), state.step),
            equal=jnp.where(steps | ~drives, 0.0, state.equal + (seen & same)),
            most=jnp.where(ends, jnp.maximum(state.most, state.equal + 1), state.most),
            rows=state.rows + ends,
            samples=state.samples + jnp.where(ends, state.equal + 1, 0.0),
        )
