"""Peak friction, by how much of it is used at the sample."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from benchmarks.accuracy.groups.base import SATELLITE, Array, Group, Runs
from benchmarks.accuracy.measures import (
    AXLES,
    CLASSES,
    after_excitation,
    in_class,
    peak_of,
    relative_error,
    share_used,
)
from benchmarks.accuracy.score import Goal, Score

from roadstate.core import Estimates, Log, reference

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
    share = share_used(log, group)
    signed = 100 * (estimates.values[quantity] / truth - 1)
    masks = {name: in_class(share, name) for name in CLASSES} | {LONG: after_excitation(share, log.time)}
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
    drives = tuple((drive, SATELLITE) for drive in DRIVES)
    quantities = frozenset({"friction_peak"})

    def __init__(self, *, by_drive: bool = False) -> None:
        self.by_drive = by_drive
        # (axle or car, class, statistic, estimator) → vehicle → seed → (drive, samples)
        self._seen: dict[_Key, dict[str, dict[int, list[tuple[str, Array]]]]] = defaultdict(
            lambda: defaultdict(lambda: defaultdict(list))
        )

    def add(self, runs: Runs) -> None:
        """The samples of each class."""
        if runs.drive not in DRIVES:
            return
        for seed, (estimates, log) in enumerate(zip(runs.estimates, runs.logs, strict=True)):
            for group in AXLES:
                place = "car" if group == "car" else "axle"
                for (name, statistic), samples in seen(estimates, log, group).items():
                    key = place, name, statistic, runs.estimator
                    self._seen[key][runs.vehicle.name][seed].append((runs.drive, samples))

    def scores(self) -> list[Score]:
        """A row for each class, statistic, and axle or car; then, if asked for, for each drive as well."""
        found = self._pooled(None)
        if self.by_drive:
            found += [score for drive in DRIVES for score in self._pooled(drive)]
        return found

    def _pooled(self, drive: str | None) -> list[Score]:
        """Over one drive, or all."""
        found = []
        for (place, name, statistic, estimator), by_vehicle in self._seen.items():
            if drive is None and statistic == _BIAS:
                continue
            whole, seeds = {}, {}
            for vehicle, by_seed in by_vehicle.items():
                chosen = [[v for d, v in parts if drive in (None, d)] for parts in by_seed.values()]
                pooled = [np.concatenate(parts) for parts in chosen if parts]
                if not sum(map(len, pooled)):  # no drive uses such a share
                    continue
                whole[vehicle] = summed_up(statistic, np.concatenate(pooled))
                seeds[vehicle] = np.array([summed_up(statistic, samples) for samples in pooled])
            if whole:
                where = "" if drive is None else f"{drive}, "
                what, goal = f"{where}{place} {name}: {statistic}", _GOALS.get((name, statistic))
                found.append(Score(self.name, what, estimator, "%", goal, whole, seeds))
        rows = [*_GOALS, *((name, _BIAS) for name in CLASSES)]
        order = [f"{place} {name}: {statistic}" for place in ("axle", "car") for name, statistic in rows]
        return sorted(found, key=lambda score: order.index(score.what.rsplit(", ", 1)[-1]))
