"""Grade and forces on roads that are not smooth: very good, good and average ones (ISO 8608, classes A to C).

``python -m benchmarks.rough_roads`` prints the tables of ``benchmarks/results/rough_roads.md``: cars on the
multibody plant, production sensors, vehicle files that are off by 5 to 10 %. Grade over the ramp of paper 002
at changing speed: what counts there is the mean of the road's slope over a second. Forces where they are
large: near the limit in a circle, and in a swift lane change, which is no rough road.
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

from roadstate.core import Estimates, Log, reference
from roadstate.core.numerics import use_compilation_cache
from roadstate.estimators import build
from roadstate.metrics import NORMAL_95
from roadstate.run import batch
from roadstate.sim.manoeuvres import Manoeuvre
from roadstate.sim.roads.roughness import rough_surface
from roadstate.vehicles import Vehicle

CLASSES = ("A", "B", "C")
_VEHICLES, _NAMES = ("family-car", "suv"), ("joint", "tfobe", "kmbe")
_RAMP, _LENGTH = "straight-variable-speed", 1200.0  # m
HARD = {"circle": ("0", "B"), "double-lane-change-85-0.8": ("0", "B"), "curve-variable-speed": ("0", "C")}
"""Drives with large lateral forces, and the classes of road; ``0`` is smooth."""
_QUANTITIES = ("force_y_front", "force_y_rear", "friction_used")
_RESTS = 4.0  # s in which the plant, which begins above the uneven road, comes to rest on it
_SETTLE = 5.0  # s that do not count
_BEGINS = 0.5  # s in which it has come so far that a car in motion may be watched


def prepared(vehicle: Vehicle, *, drive: str, road_class: str) -> Manoeuvre:
    """A drive of :data:`SCENARIOS` on a rough surface."""
    smooth = SCENARIOS[drive].prepare(vehicle)
    if road_class == "0":
        return smooth
    surface = rough_surface(road_class, 1, _LENGTH)
    road = eqx.tree_at(lambda r: r.surface, smooth.road, surface, is_leaf=lambda leaf: leaf is None)
    return replace(smooth, road=road)


@cache
def recorded(
    vehicle: str, road_class: str, count: int, drive: str = _RAMP, rests: float = _RESTS
) -> list[tuple[Log, Vehicle]]:
    """Recordings of one drive from ``rests`` s on, each with the vehicle file that an estimator is told."""
    scenario = Scenario("rough", "a rough road", partial(prepared, drive=drive, road_class=road_class))
    made = on_plant(vehicle, scenario, count)
    return [(log.between(log.time[0] + rests, log.time[-1]), car) for log, car in made]


def of_grade(name: str, logs: list[tuple[Log, Vehicle]]) -> dict[str, float]:
    """RMSE and stated σ, % of grade, and how many of the samples lie within ±1.96 σ, %."""
    errors, stds = [], []
    for (log, _), said in zip(logs, _estimated(name, logs), strict=True):
        truth = moving_mean(np.tan(log["ref_grade"]), log.time, 1.0)
        used = (log.time - log.time[0] >= _SETTLE) & np.isfinite(truth)
        errors.append(100 * (np.tan(said.values["grade"]) - truth)[used])
        stds.append(100 * said.std["grade"][used])
    return _judged(errors, stds)


def of_forces(logs: list[tuple[Log, Vehicle]]) -> dict[str, dict[str, float]]:
    """The same of lateral forces, N, and of the friction used, by quantity; ``joint``."""
    estimates = _estimated("joint", logs)
    found = {}
    for quantity in _QUANTITIES:
        errors, stds = [], []
        for (log, _), said in zip(logs, estimates, strict=True):
            truth = reference(quantity, log.channels)
            assert truth is not None
            errors.append((said.values[quantity] - truth)[np.isfinite(truth)])
            stds.append(said.std[quantity][np.isfinite(truth)])
        found[quantity] = _judged(errors, stds)
    return found


def _estimated(name: str, logs: list[tuple[Log, Vehicle]]) -> list[Estimates]:
    return batch([build(name, car, log.available) for log, car in logs], [log for log, _ in logs])


def _judged(errors: list[np.ndarray], stds: list[np.ndarray]) -> dict[str, float]:
    error, std = np.concatenate(errors), np.concatenate(stds)
    inside = 100 * float(np.mean(np.abs(error) <= NORMAL_95 * std))
    return {
        "RMSE": float(np.sqrt(np.mean(error**2))),
        "stated": float(np.sqrt(np.mean(std**2))),
        "inside": inside,
    }


def of_grades(count: int) -> Iterator[tuple[str, dict[str, float]]]:
    """Row after row: class, car and estimator."""
    for road_class in CLASSES:
        for vehicle in _VEHICLES:
            print(f"class {road_class}, {vehicle}", file=sys.stderr)
            logs = recorded(vehicle, road_class, count)
            bus = [(without(log, SATELLITE), car) for log, car in logs]
            for name in _NAMES:
                yield f"class {road_class}, {vehicle}, {name}", of_grade(name, bus)
            yield f"class {road_class}, {vehicle}, joint with satellites", of_grade("joint", logs)


def of_drives(count: int) -> Iterator[tuple[str, dict[str, float]]]:
    """Row after row: drive, class, car and quantity."""
    for drive, classes in HARD.items():
        for road_class in classes:
            for vehicle in _VEHICLES:
                road = "smooth" if road_class == "0" else f"class {road_class}"
                print(f"{drive}, {road}, {vehicle}", file=sys.stderr)
                logs = recorded(vehicle, road_class, count, drive, _BEGINS)
                bus = [(without(log, SATELLITE), car) for log, car in logs]
                for quantity, row in of_forces(bus).items():
                    yield f"{drive}, {road}, {vehicle}, {quantity}", row


def main() -> None:
    """Print the tables."""
    use_compilation_cache()
    how = "`python -m benchmarks.rough_roads`: four recordings of each drive; grade in per cent, forces in N."
    print(f"# Rough roads\n\n{how}\n")
    print(table("the ramp of paper 002 at changing speed, ISO 8608 classes A to C", dict(of_grades(4))))
    print(table("large lateral forces, `joint`, channels of a bus", dict(of_drives(4))))


if __name__ == "__main__":
    main()
