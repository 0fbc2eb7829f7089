"""The likelihood of logs under an estimator's own filter, and how it changes with the car's figures.

An estimator is built from plain numbers, which cannot be traced. So it is built once more for each parameter,
moved a little, and all of them go through the log side by side: differences of innovations and
of likelihoods are their derivatives.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from roadstate.calibration.known_road import bank_of, on_road, with_friction
from roadstate.calibration.parameters import Parameter, moved, with_certainty
from roadstate.calibration.scores import Judges, Moves, Rows, beyond, kept, scored
from roadstate.calibration.uncertainty import Mask, Numbers
from roadstate.core import InputError, Log
from roadstate.estimators import Estimator, build
from roadstate.run.chunk import CHUNK, cut, inputs, start, steps_through
from roadstate.vehicles import Vehicle

_SPAN = 0.5  # of a prior standard deviation, over which what hypotheses of friction tell is looked at
_BALANCE = ("mass", "aerodynamics", "rolling_resistance", "driveline", "brakes", "body")
_FRICTION = ("tires", "friction")
_ROADS = np.geomspace(0.15, 1.4, 24)  # frictions to begin with
_ROUNDING = 1e-3  # of a score
_PASSES = 50  # that a fit makes through a log, in order of magnitude


class Curvature(NamedTuple):
    """How the likelihood bends beyond its Gaussian innovations.

    Attributes:
        at: (p,) changes in prior standard deviations, where that was found.
        value: (p, p) how fast its gradient falls, in no direction less than 0.
    """

    at: Numbers
    value: Numbers

    def of(self, places: Sequence[int]) -> Curvature:
        """Of some of the parameters."""
        return Curvature(self.at[places], self.value[np.ix_(places, places)])


@dataclass(frozen=True)
class Evaluation:
    """The likelihood at one choice of the parameters.

    Attributes:
        scores: of each log (p, T), by each sample; their sums are to vanish.
        information: (p, p) how these sums fall with the parameters.
        curvature: the part of it from beyond the Gaussian innovations.
    """

    scores: tuple[Numbers, ...]
    information: Numbers
    curvature: Curvature

    @property
    def gradient(self) -> Numbers:
        """(p,) sum of the scores."""
        return np.asarray(sum(s.sum(axis=1) for s in self.scores))


class _Prepared(NamedTuple):
    name: str
    time: Numbers
    samples: Numbers
    dt: Numbers
    channels: frozenset[str]
    judges: Judges


class Likelihood:
    """The log-likelihood of logs as a function of a car's figures.

    Args:
        vehicle: the car as its file has it.
        parameters: p of its figures.
        logs: name → log; each is a run of the filter of its own.
        estimator: its name.
        road_friction: peak friction of the road in all logs, where it is known.

    Raises:
        InputError: the estimator cannot be built for the car or for a log's channels, or cannot be told of
            the friction.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        parameters: Sequence[Parameter],
        logs: Mapping[str, Log],
        estimator: str,
        road_friction: float | None = None,
    ) -> None:
        self.vehicle, self.estimator, self.road_friction = vehicle, estimator, road_friction
        self.parameters = tuple(parameters)
        self._friction = np.array([p.path == _FRICTION for p in parameters], bool)
        # so the error of a one-sided difference is half of this share of a prior standard deviation
        self._step = float(np.finfo(jnp.result_type(float)).eps) ** 0.25
        self._prepared: list[_Prepared] = []
        for name, log in logs.items():
            channels = frozenset(log.available)
            try:
                built = self._built(vehicle, channels)
            except InputError as error:
                raise InputError(error.what, where=error.where or name, mend=error.mend) from error
            judges = self._judges(built.sensors, bank_of(built) is not None)
            samples, dt, own = inputs(built, log)
            time = np.interp(np.arange(len(samples)), own, log.time)
            self._prepared.append(_Prepared(name, time, samples, dt, channels, judges))

    @property
    def times(self) -> tuple[Numbers, ...]:
        """(T,) of each log and of the steps through its breaks, s."""
        return tuple(p.time for p in self._prepared)

    def _built(
        self, vehicle: Vehicle, channels: frozenset[str], active: Mask | None = None
    ) -> Estimator[Any]:
        """An estimator; on the road whose friction is known, or is being learned."""
        estimator = build(self.estimator, vehicle, channels)
        if self.road_friction is not None:
            return on_road(estimator, self.road_friction)
        learned = self._friction if active is None else self._friction & active
        is_told = learned.any() and bank_of(estimator) is not None
        return with_friction(estimator, vehicle.tires.friction) if is_told else estimator

    def unused(self) -> dict[str, str]:
        """Parameters that cannot be moved in this estimator, with the channels there are, and why."""
        moving, fixed = np.zeros((2, len(self.parameters)), bool)
        for channels in {p.channels for p in self._prepared}:
            first = self._built(self.vehicle, channels)
            others = [
                self._built(moved(self.vehicle, [p], np.full(1, self._step)), channels)
                for p in self.parameters
            ]
            leaves, static = eqx.partition(first, eqx.is_inexact_array)
            for i, other in enumerate(others):
                other_leaves, other_static = eqx.partition(other, eqx.is_inexact_array)
                if not eqx.tree_equal(static, other_static):
                    fixed[i] = True
                elif not eqx.tree_equal(leaves, other_leaves):
                    moving[i] = True
        reasons = {}
        for parameter, is_fixed, moves in zip(self.parameters, fixed, moving, strict=True):
            if is_fixed:
                reasons[parameter.name] = f"is fixed once '{self.estimator}' is built"
            elif not moves:
                reasons[parameter.name] = f"'{self.estimator}' does not use it"
        return reasons

    def start(self) -> Numbers:
        """(p,) where to begin: the file's figures, and the friction that suits the logs best beside them.

        Below the limit a friction is told from smaller ones, not from larger: the likelihood bends about the
        true one, and far above it is a plateau on which nothing shows.
        """
        begin, mine = np.zeros(len(self.parameters)), self._friction
        if not any((mine & prepared.judges.wide).any() for prepared in self._prepared):
            return begin
        friction = self.parameters[int(mine.argmax())]
        free = np.array([0.0, *(np.log(_ROADS / friction.start) / friction.std)])
        tried = np.where(mine, free[:, None], begin)
        total = -0.5 * free**2
        for prepared in self._prepared:
            total += self._sums(prepared, tried, np.ones(len(mine), bool))
        return np.asarray(tried[total.argmax()])

    def __call__(self, free: Numbers, active: Mask, curvature: Curvature | None = None) -> Evaluation:
        """Run the filter over all logs.

        Args:
            free: (p,) changes in prior standard deviations.
            active: (p,) which are being learned: of those, the filter itself leaves nothing open.
            curvature: where it is known well enough.

        Raises:
            InputError: the filter fails; says in which log and when.
        """
        scores, has_rest = [], False
        information = np.zeros((len(free), len(free)))
        for prepared in self._prepared:
            parts, moves = [], self._moves(prepared.judges.wide)
            for count, rows in self._run(prepared, free + moves.changes, active):
                part = scored(rows, moves, prepared.judges)
                parts.append(np.asarray(part.scores)[:, :count])
                information += np.asarray(part.information)
                has_rest |= bool(np.abs(part.rest).max(initial=0.0) > _ROUNDING)
            scores.append(np.concatenate(parts, axis=1))
        if curvature is None:
            bent = self._curvature(free, active) if has_rest else np.zeros_like(information)
            curvature = Curvature(free, bent)
        return Evaluation(tuple(scores), information + curvature.value, curvature)

    def _moves(self, wide: Mask) -> Moves:
        """One step aside for each parameter, or one to either side of those that need a ``wide`` view."""
        reach = np.where(wide, _SPAN / 2, self._step)
        back = np.flatnonzero(wide)
        other = np.zeros(len(wide), int)
        other[back] = len(wide) + 1 + np.arange(len(back))
        changes = np.concatenate([np.zeros((1, len(wide))), np.diag(reach), -np.diag(reach)[back]])
        return Moves(changes, other, np.where(wide, _SPAN, reach))

    def _judges(self, sensors: Sequence[str], is_weighing: bool) -> Judges:
        """Who judges whom.

        Where the balance of forces along the road is a sensor of its own, it alone judges what makes it up:
        in wheel speeds, and in what tires tell, these forces show by the slip they make, whose errors last
        too long to weigh a car by. Wheel speeds then judge nothing but the wheels' radius.

        What hypotheses of friction tell has steps in it, where one takes over from another: its slope is that
        over a good part of a prior standard deviation.
        """
        noise = np.array([p.is_noise for p in self.parameters], bool)
        if "traction" not in sensors:
            return Judges(noise, ~noise, np.ones(len(sensors), bool), ~noise & is_weighing)
        balance = np.array([p.path[0] in _BALANCE for p in self.parameters], bool)
        has_radius = any(p.path == ("wheels", "radius") for p in self.parameters)
        counts = np.array([has_radius or not s.startswith("wheel_speed") for s in sensors])
        rest = ~noise & ~balance
        return Judges(noise, rest, counts, rest & is_weighing)

    def _curvature(self, free: Numbers, active: Mask) -> Numbers:
        """(p, p) how fast the gradient of what is beyond the Gaussian innovations falls, in no direction < 0.

        By second differences over a good part of a prior standard deviation, since the samples that a filter
        refuses make steps in it.
        """
        on = np.flatnonzero(np.any([prepared.judges.rest for prepared in self._prepared], axis=0))
        unit = _SPAN * np.eye(len(free))
        pairs = [(i, j) for k, i in enumerate(on) for j in on[:k]]
        moves = [0 * free, *unit[on], *-unit[on], *(unit[i] + unit[j] for i, j in pairs)]
        total = np.zeros(len(moves))
        for prepared in self._prepared:
            total += self._sums(prepared, free + np.array(moves), active)
        n = len(on)
        ahead = dict(zip(on, total[1 : n + 1] - total[0], strict=True))
        behind = dict(zip(on, total[n + 1 : 2 * n + 1] - total[0], strict=True))
        found = np.zeros((len(free), len(free)))
        for i in on:
            found[i, i] = -(ahead[i] + behind[i])
        for (i, j), value in zip(pairs, total[2 * n + 1 :] - total[0], strict=True):
            found[i, j] = found[j, i] = -(value - ahead[i] - ahead[j])
        values, vectors = np.linalg.eigh(found / _SPAN**2)
        result: Numbers = (vectors * np.maximum(values, 0.0)) @ vectors.T
        return result

    def _sums(self, prepared: _Prepared, free: Numbers, active: Mask) -> Numbers:
        """(b,) sums of what is beyond the Gaussian innovations, of the car at ``free`` (b, p)."""
        parts = [beyond(rows)[:, :count] for count, rows in self._run(prepared, free, active)]
        return np.asarray(sum(np.asarray(part).sum(axis=1) for part in parts))

    def _run(self, prepared: _Prepared, free: Numbers, active: Mask) -> Iterator[tuple[int, Rows]]:
        """Chunk after chunk, how many samples it has, and the rows of the car at ``free`` (b, p)."""
        car = with_certainty(self.vehicle, self.parameters, active)
        built = [self._built(moved(car, self.parameters, f), prepared.channels, active) for f in free]
        starts = [start(e) for e in built]
        states, layout = [state for state, _ in starts], starts[0][1]
        through = steps_through(_PASSES * len(prepared.time))
        with ThreadPoolExecutor(min(len(built), os.cpu_count() or 1)) as pool:
            for begin in range(0, len(prepared.time), CHUNK):
                values, dt = (jnp.asarray(a) for a in cut(prepared.samples, prepared.dt, begin))
                count = min(CHUNK, len(prepared.time) - begin)

                def advance(
                    own: Estimator[Any],
                    state: Any,
                    values: Array = values,
                    dt: Array = dt,
                    count: int = count,
                ) -> Any:
                    state, rows = through(own, layout, state, values, dt, jnp.asarray(count), kept)
                    return state, jax.tree.map(np.asarray, rows)

                # at first one by itself: several at once would each compile the program
                alone = 1 if begin == 0 else 0
                done = [
                    *map(advance, built[:alone], states),
                    *pool.map(advance, built[alone:], states[alone:]),
                ]
                states = [state for state, _ in done]
                rows = jax.tree.map(lambda *each: np.stack(each), *[rows for _, rows in done])
                self._check(prepared, begin, np.all(rows.ok, axis=0)[:count])
                yield count, rows

    def _check(self, prepared: _Prepared, begin: int, ok: NDArray[np.bool_]) -> None:
        if not ok.all():
            at = prepared.time[begin + int(np.argmin(ok))]
            raise InputError(
                f"the filter of '{self.estimator}' fails at t={at:.2f} s",
                where=prepared.name,
                mend="look at the channels there, or leave that part out",
            )
