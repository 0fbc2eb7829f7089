"""Peak friction, by how much of it is used at the sample."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from concurrent.futures import Future
from typing import ClassVar

import numpy as np
from benchmarks.accuracy.friction_bound import friction_bound, quantile
from benchmarks.accuracy.groups.base import BESIDE, BUS, SATELLITE, Array, Group, Runs
from benchmarks.accuracy.measures import (
    AXLES,
    CLASSES,
    Mask,
    after_excitation,
    in_class,
    peak_of,
    relative_error,
    share_used,
)
from benchmarks.accuracy.score import Goal, Score

from roadstate.core import Estimates, Log, reference
from roadstate.vehicles import Vehicle

DRIVES = (
    *(f"double-lane-change-{speed}-{mu}" for speed in (48, 85) for mu in (0.8, 0.4)),
    "circle",
    *(f"straight-{mu}" for mu in (0.8, 0.4, 0.2)),
    *(f"joint-{how}-{words}" for how in ("acceleration", "braking") for words in ("0.8-0.2", "0.2-0.8")),
    "split-road",
    "split-road-braking",
    "urban",
)
LARGE, MEDIUM, SMALL = CLASSES
LONG = f"{LARGE} after 0.5 s"
_GOALS = {
    (LARGE, "median"): Goal.at_most(10),
    (LARGE, "p90"): Goal.at_most(20),
    (LONG, "median"): Goal.at_most(10),
    (LONG, "p90"): Goal.at_most(20),
    (MEDIUM, "median"): Goal.at_most(18),
    (MEDIUM, "in 5–95 %"): Goal.at_least(88),
    (SMALL, "lower ≤ truth"): Goal.at_least(95),
}
_SHARES = {"median": 0.5, "p90": 0.9}  # statistics of |error| that have a bound
_BIAS = "too high by"  # median of the signed error: shown for single drives only, where it tells a cause
_Key = tuple[str, str, str, str]
_Seen = dict[tuple[str, str], Array]  # (class, statistic) → what is pooled: errors in %, or hits as 0 and 100


def seen(estimates: Estimates, log: Log, group: str) -> _Seen:
    """What one run shows of the friction of one group of wheels, for each figure the samples it rests on.

    Args:
        estimates, log: of the run.
        group: of :data:`benchmarks.accuracy.measures.AXLES`.
    """
    quantity = peak_of(group)
    error, truth = relative_error(estimates, log, quantity), reference(quantity, log.channels)
    if error is None or truth is None:
        return {}
    masks = _classes(log, group)
    signed = 100 * (estimates.values[quantity] / truth - 1)
    found: _Seen = {}
    for name in (LARGE, LONG, MEDIUM):
        found[name, "median"] = error[masks[name]]
    for name in CLASSES:
        found[name, _BIAS] = signed[masks[name]]
    for name in (LARGE, LONG):
        found[name, "p90"] = found[name, "median"]
    lower, upper = (estimates.values.get(f"{quantity}{end}") for end in ("_lower", "_upper"))
    if lower is not None and upper is not None:
        inside = (lower <= truth) & (truth <= upper)
        found[MEDIUM, "in 5–95 %"] = np.where(inside[masks[MEDIUM]], 100.0, 0.0)
        found[SMALL, "lower ≤ truth"] = np.where((lower <= truth)[masks[SMALL]], 100.0, 0.0)
    return {key: values.astype(np.float32) for key, values in found.items()}


def _classes(log: Log, group: str) -> dict[str, Mask]:
    """(T,) for each class the samples of it."""
    share = share_used(log, group)
    return {name: in_class(share, name) for name in CLASSES} | {LONG: after_excitation(share, log.time)}


def least_spread(log: Log, vehicle: Vehicle) -> dict[tuple[str, str], Array]:
    """Least 1σ, %, at the samples of each class with a bound, by (``axle`` or ``car``, class).

    Args:
        log, vehicle: as :func:`benchmarks.accuracy.friction_bound.friction_bound`.
    """
    classes = {group: _classes(log, group) for group in AXLES}
    bounded = (LARGE, LONG, MEDIUM)
    wanted = np.any([classes[group][name] for group in AXLES for name in bounded], axis=0)
    if not wanted.any():
        return {}
    # nothing that comes after the last sample of a class changes what could be known there
    after = np.append(log.time, np.inf)[np.flatnonzero(wanted)[-1] + 1]
    ended = log.between(log.time[0], after)
    std = friction_bound(ended, vehicle).friction
    found: dict[tuple[str, str], list[Array]] = defaultdict(list)
    for group in AXLES:
        for name in bounded:
            mask = classes[group][name][: len(ended)]
            found[_place(group), name].append(100 * std[group][mask])
    return {key: np.concatenate(parts) for key, parts in found.items()}


def _place(group: str) -> str:
    return "car" if group == "car" else "axle"


def summed_up(statistic: str, samples: Array) -> float:
    """The figure of pooled samples; NaN where there are none. What is not finite is an infinite error."""
    if not len(samples):
        return float("nan")
    kept = np.where(np.isfinite(samples), samples, np.inf)
    if statistic in ("median", _BIAS):
        return float(np.median(kept))
    if statistic == "p90":
        return float(np.percentile(kept, 90, method="higher"))
    return float(np.mean(samples))


class Friction(Group):
    """Median and 90th percentile of the relative error, coverage and lower bounds, over samples and seeds."""

    name = "friction"
    title = (
        "Peak friction by the share of it that is used: |error| in per cent, over samples, drives and seeds"
    )
    variant: ClassVar[str] = SATELLITE
    drives = tuple((drive, SATELLITE) for drive in DRIVES)
    quantities = frozenset({"friction_peak"})

    def __init__(self, *, by_drive: bool = False, drives: Sequence[str] = DRIVES) -> None:
        self.by_drive, self._drives = by_drive, drives
        # (axle or car, class, statistic, estimator) → vehicle → seed → (drive, samples)
        self._seen: dict[_Key, dict[str, dict[int, list[tuple[str, Array]]]]] = defaultdict(
            lambda: defaultdict(lambda: defaultdict(list))
        )
        self._spread: dict[tuple[str, str], Future[dict[tuple[str, str], Array]]] = {}  # vehicle, drive

    def add(self, runs: Runs) -> None:
        """The samples of each class."""
        if runs.drive not in self._drives or runs.variant != self.variant:
            return
        condition = runs.vehicle.name, runs.drive
        if self.variant == SATELLITE and condition not in self._spread:
            self._spread[condition] = BESIDE.submit(least_spread, runs.logs[0], runs.vehicle)
        for seed, (estimates, log) in enumerate(zip(runs.estimates, runs.logs, strict=True)):
            for group in AXLES:
                place = _place(group)
                for (name, statistic), samples in seen(estimates, log, group).items():
                    key = place, name, statistic, runs.estimator
                    self._seen[key][runs.vehicle.name][seed].append((runs.drive, samples))

    def scores(self) -> list[Score]:
        """A row for each class, statistic, and axle or car; then, if asked for, for each drive as well."""
        found = self._pooled(None)
        if self.by_drive:
            found += [score for drive in self._drives for score in self._pooled(drive)]
        return found

    def _pooled(self, drive: str | None) -> list[Score]:
        """Over one drive, or all."""
        found = []
        for (place, name, statistic, estimator), by_vehicle in self._seen.items():
            if drive is None and statistic == _BIAS:
                continue
            whole, seeds, bounds = {}, {}, {}
            for vehicle, by_seed in by_vehicle.items():
                chosen = [[p for p in parts if drive in (None, p[0])] for parts in by_seed.values()]
                pooled = [np.concatenate([v for _, v in parts]) for parts in chosen if parts]
                if not sum(map(len, pooled)):  # no drive uses such a share
                    continue
                whole[vehicle] = summed_up(statistic, np.concatenate(pooled))
                seeds[vehicle] = np.array([summed_up(statistic, samples) for samples in pooled])
                if statistic in _SHARES and self._spread:
                    drives = [d for parts in chosen for d, _ in parts]
                    bounds[vehicle] = self._bound(vehicle, drives, (place, name), _SHARES[statistic])
            if whole:
                where = "" if drive is None else f"{drive}, "
                what, goal = f"{where}{place} {name}: {statistic}", _GOALS.get((name, statistic))
                found.append(Score(self.name, what, estimator, "%", goal, whole, seeds, bounds))
        rows = [*_GOALS, *((name, _BIAS) for name in CLASSES)]
        order = [f"{place} {name}: {statistic}" for place in ("axle", "car") for name, statistic in rows]
        return sorted(found, key=lambda score: order.index(score.what.rsplit(", ", 1)[-1]))

    def _bound(self, vehicle: str, drives: Sequence[str], key: tuple[str, str], share: float) -> float:
        """What |error|, %, could be in a share of samples; each drive counts as often as it was run."""
        found = {drive: self._spread[vehicle, drive].result() for drive in set(drives)}
        times = {drive: n for drive, n in Counter(drives).items() if key in found[drive]}
        spreads = [found[drive][key] for drive in times]
        weight = [np.full(len(v), n) for v, n in zip(spreads, times.values(), strict=True)]
        return quantile(np.concatenate(spreads), share, np.concatenate(weight))


class FrictionOnBus(Friction):
    """The same without a receiver."""

    name = "friction-bus"
    title = f"{Friction.title}, no satellites"
    variant = BUS
    drives = tuple((drive, BUS) for drive in DRIVES)
