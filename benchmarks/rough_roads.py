"""Grade on roads that are not smooth: very good, good and average ones (ISO 8608, classes A to C).

``python -m benchmarks.rough_roads`` prints the table of ``benchmarks/results/rough_roads.md``: cars on the
multibody plant over the ramp of paper 002 at changing speed, production sensors, vehicle files that are off
by 5 to 10 %. What counts for grade there is the mean of the road's slope over a second.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import cache, partial

import equinox as eqx
import numpy as np
from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import SATELLITE, SCENARIOS, Scenario, on_plant
from benchmarks.real_logs import moving_mean, table

from roadstate.core import Log
from roadstate.core.numerics import use_compilation_cache
from roadstate.estimators import build
from roadstate.metrics import NORMAL_95
from roadstate.run import batch
from roadstate.sim.manoeuvres import Manoeuvre
from roadstate.sim.roads.roughness import rough_surface
from roadstate.vehicles import Vehicle

CLASSES = ("A", "B", "C")
_VEHICLES, _NAMES = ("family-car", "suv"), ("joint", "tfobe", "kmbe")
_DRIVE, _LENGTH = "straight-variable-speed", 1200.0  # m
_RESTS = 4.0  # s in which the plant, which begins above the uneven road, comes to rest on it
_SETTLE = 5.0  # s that do not count


def prepared(vehicle: Vehicle, *, road_class: str) -> Manoeuvre:
    """The drive, on a rough surface."""
    smooth = SCENARIOS[_DRIVE].prepare(vehicle)
    surface = rough_surface(road_class, 1, _LENGTH)
    road = eqx.tree_at(lambda r: r.surface, smooth.road, surface, is_leaf=lambda leaf: leaf is None)
    return replace(smooth, road=road)


@cache
def recorded(vehicle: str, road_class: str, count: int) -> list[tuple[Log, Vehicle]]:
    """Recordings of one drive, each with the vehicle file that an estimator is told."""
    scenario = Scenario("rough", "a rough road", partial(prepared, road_class=road_class))
    made = on_plant(vehicle, scenario, count)
    return [(log.between(log.time[0] + _RESTS, log.time[-1]), car) for log, car in made]


def of_grade(name: str, logs: list[tuple[Log, Vehicle]]) -> dict[str, float]:
    """RMSE and stated σ, % of grade, and how many of the samples lie within ±1.96 σ, %."""
    errors, stds = [], []
    estimates = batch([build(name, car, log.available) for log, car in logs], [log for log, _ in logs])
    for (log, _), said in zip(logs, estimates, strict=True):
        truth = moving_mean(np.tan(log["ref_grade"]), log.time, 1.0)
        used = (log.time - log.time[0] >= _SETTLE) & np.isfinite(truth)
        errors.append(100 * (np.tan(said.values["grade"]) - truth)[used])
        stds.append(100 * said.std["grade"][used])
    error, std = np.concatenate(errors), np.concatenate(stds)
    inside = 100 * float(np.mean(np.abs(error) <= NORMAL_95 * std))
    return {
        "RMSE": float(np.sqrt(np.mean(error**2))),
        "stated": float(np.sqrt(np.mean(std**2))),
        "inside": inside,
    }


def study(count: int) -> Iterator[tuple[str, dict[str, float]]]:
    """Row after row: class, car and estimator."""
    for road_class in CLASSES:
        for vehicle in _VEHICLES:
            print(f"class {road_class}, {vehicle}", file=sys.stderr)
            logs = recorded(vehicle, road_class, count)
            bus = [(without(log, SATELLITE), car) for log, car in logs]
            for name in _NAMES:
                yield f"class {road_class}, {vehicle}, {name}", of_grade(name, bus)
            yield f"class {road_class}, {vehicle}, joint with satellites", of_grade("joint", logs)


def main() -> None:
    """Print the table."""
    use_compilation_cache()
    rows = dict(study(count=4))
    how = "`python -m benchmarks.rough_roads`: four recordings of each drive; grade in per cent."
    print(f"# Rough roads\n\n{how}\n")
    print(table("the ramp of paper 002 at changing speed, ISO 8608 classes A to C", rows))


if __name__ == "__main__":
    main()
