"""Driving, recording and estimating what the groups of figures need: two conditions in memory at a time."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jax
from benchmarks.accuracy.ahead import made_ahead
from benchmarks.accuracy.groups import GROUPS
from benchmarks.accuracy.groups.base import BUS, NO_PITCH, SATELLITE, SMOOTHED, Group, Runs
from benchmarks.accuracy.groups.friction import Friction
from benchmarks.accuracy.scenarios import SATELLITE as RECEIVED
from benchmarks.accuracy.scenarios import few, logs
from benchmarks.accuracy.score import Score

from roadstate.core import Estimates, InputError, Log
from roadstate.estimators import Estimator, build
from roadstate.run import batch
from roadstate.vehicles import Vehicle, load_vehicle

# channels, by variant
_LACKING = {SATELLITE: (), SMOOTHED: (), BUS: RECEIVED, NO_PITCH: (*RECEIVED, "pitch_rate")}
_AT_ONCE = 2  # estimators at work: while one is compiled, which one processor does, another runs
_Reads = tuple[str, tuple[str, ...]]
Smooth = Callable[[Estimator[Any], Log], Estimates]
"""An estimator's smoothed estimates of a whole log."""
Progress = Callable[[str, int, int], None]
"""Called with what is being done, how many drives are done, and how many there are."""


@dataclass(frozen=True)
class Results:
    """What came out.

    Attributes:
        scores: of all groups.
        notes: what was left out, and why.
    """

    scores: list[Score]
    notes: list[str]


@dataclass
class _Plan:
    """What is needed of one drive: variant → groups that asked for it."""

    drive: str
    variants: dict[str, list[Group]] = field(default_factory=dict)


@dataclass(frozen=True)
class _Condition:
    """One drive's logs, and who gets how many of them.

    Attributes:
        vehicle: that was driven.
        drive: name of the scenario.
        recorded: logs, each with the vehicle file told.
        counts: estimator → how many of the logs it gets.
        gives: (estimator, the channels it reads) → its quantities, of this vehicle's drives so far.
    """

    vehicle: Vehicle
    drive: str
    recorded: Sequence[tuple[Log, Vehicle]]
    counts: Mapping[str, int]
    gives: dict[_Reads, frozenset[str]]


@dataclass(frozen=True)
class _Task:
    """One estimator, built for each of a condition's recordings, and the groups that ask for it."""

    reads: _Reads
    variant: str
    logs: list[Log]
    cars: list[Vehicle]
    built: list[Estimator[Any]]
    asking: list[Group]

    @property
    def key(self) -> tuple[_Reads, bool]:
        """Of what comes out: an estimator that reads no receiver's channels runs only once."""
        return self.reads, self.variant == SMOOTHED


def run(
    vehicles: Sequence[str],
    estimators: Sequence[str],
    seeds: int,
    *,
    subject: str | None = None,
    only: Sequence[str] = (),
    drives: Sequence[str] = (),
    by_drive: bool = False,
    cache: Path | None = None,
    smooth: Smooth | None = None,
    progress: Progress | None = None,
) -> Results:
    """Measure groups of figures.

    Args:
        vehicles: presets to drive.
        estimators: names.
        seeds: recordings of each drive.
        subject: the estimator that is judged; others get :func:`few` of the seeds. Without one, all get all.
        only: groups; all without any.
        drives: on these drives alone; on all the groups' without any.
        by_drive: whether friction is also shown for each drive by itself.
        cache: folder for logs, see :func:`benchmarks.accuracy.scenarios.logs`.
        smooth: also estimates grade with it, where given.
        progress: told of each drive.

    Raises:
        InputError: a drive or an estimator that there is not.
    """
    active = [kind() for name, kind in GROUPS.items() if not only or name in only]
    for group in active:
        if isinstance(group, Friction):
            group.by_drive = by_drive
    plans = _plans(active, drives, is_smoothed=smooth is not None)
    takers = [group for group in active if not group.drives]
    notes: dict[str, None] = {}
    conditions = [(vehicle, plan) for vehicle in vehicles for plan in plans]
    total = len(conditions)
    gives: dict[str, dict[_Reads, frozenset[str]]] = {vehicle: {} for vehicle in vehicles}
    work = made_ahead(_driven, [(vehicle, plan.drive, seeds, cache) for vehicle, plan in conditions])
    for i, ((vehicle, plan), recorded) in enumerate(zip(conditions, work, strict=True)):
        tell = _teller(progress, f"{vehicle}: {plan.drive}", i, total)
        if isinstance(recorded, InputError):
            notes[str(recorded)] = None
            continue
        counts = {name: few(seeds) if subject not in (None, name) else seeds for name in estimators}
        condition = _Condition(load_vehicle(vehicle), plan.drive, recorded, counts, gives[vehicle])
        tasks: list[_Task] = []
        for variant, askers in plan.variants.items():
            asked, left_out = _asked(condition, variant, askers)
            tasks += asked
            notes |= dict.fromkeys(left_out)
        _estimate(condition, tasks, takers, smooth, tell)
    if progress is not None:
        progress("done", total, total)
    return Results([score for group in active for score in group.scores()], list(notes))


def _driven(*arguments: Any) -> list[tuple[Log, Vehicle]] | InputError:
    """The logs of a condition, or why there are none."""
    try:
        return logs(*arguments)
    except InputError as error:
        return error


def _plans(active: Sequence[Group], drives: Sequence[str], *, is_smoothed: bool) -> list[_Plan]:
    """The drives that are needed, each once; where only takers are chosen, those of all groups."""
    askers = [group for group in active if group.drives] or [
        kind() for kind in GROUPS.values() if kind.drives
    ]
    plans: dict[str, _Plan] = {}
    for group in askers:
        for drive, variant in group.drives:
            takes_place = variant != SMOOTHED or (is_smoothed and group in active)
            if takes_place and (not drives or drive in drives):
                plans.setdefault(drive, _Plan(drive)).variants.setdefault(variant, []).append(group)
    if not plans:
        raise InputError("nothing is measured there", mend="choose other groups or drives")
    return list(plans.values())


def _teller(progress: Progress | None, title: str, done: int, total: int) -> Callable[[str], None]:
    def tell(what: str) -> None:
        if progress is not None:
            progress(f"{title}: {what}", done, total)

    return tell


def _asked(condition: _Condition, variant: str, askers: Sequence[Group]) -> tuple[list[_Task], list[str]]:
    """The tasks of a variant, and what is left out."""
    tasks, notes = [], []
    for name, count in condition.counts.items():
        cars = [car for _, car in condition.recorded[:count]]
        cut = [without(log, _LACKING[variant]) for log, _ in condition.recorded[:count]]
        try:
            built = [build(name, car, cut[0].available) for car in cars]
        except InputError as error:
            notes.append(f"{condition.vehicle.name}, {variant}: {error}")
            continue
        reads = name, tuple(built[0].channels)
        if reads not in condition.gives:
            condition.gives[reads] = quantities(built[0])
        gives, smoothable = condition.gives[reads], built[0].smoothable
        if variant == SMOOTHED:
            gives &= frozenset(smoothable.quantities if smoothable else ())
        asking = [group for group in askers if not group.quantities or group.quantities & gives]
        if asking:
            tasks.append(_Task(reads, variant, cut, cars, built, asking))
    return tasks, notes


def _estimate(
    condition: _Condition,
    tasks: Sequence[_Task],
    takers: Sequence[Group],
    smooth: Smooth | None,
    tell: Callable[[str], None],
) -> None:
    """Run each task over its logs, and hand out what comes of it, in their order."""

    def made(task: _Task) -> list[Estimates]:
        if task.variant != SMOOTHED or smooth is None:
            return batch(task.built, task.logs)
        with ThreadPoolExecutor() as pool:
            return list(pool.map(smooth, task.built, task.logs))

    with ThreadPoolExecutor(_AT_ONCE) as pool:
        work: dict[tuple[_Reads, bool], Future[list[Estimates]]] = {}
        for task in tasks:
            if task.key not in work:
                work[task.key] = pool.submit(made, task)
        for task in tasks:
            name, _ = task.reads
            tell(f"{name}, {task.variant}")
            estimates = work[task.key].result()
            runs = Runs(
                condition.vehicle, condition.drive, task.variant, name, task.logs, task.cars, estimates
            )
            for group in (*task.asking, *(takers if task.variant != SMOOTHED else ())):
                group.add(runs)


def without(log: Log, channels: Collection[str]) -> Log:
    """The log without some channels."""
    return log.select(set(log.channels) - set(channels))


def quantities(estimator: Estimator[Any]) -> frozenset[str]:
    """What an estimator gives, found without running it."""
    said = jax.eval_shape(lambda: estimator.estimate(estimator.init()))
    return frozenset(said.values)
