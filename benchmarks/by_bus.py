"""Drives of cars on the multibody plant, what `joint` makes of their own bus alone, and how well."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from benchmarks.accuracy.measures import inside, rmse
from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import SATELLITE, VEHICLES, LeftTheRoad, Scenario, on_plant

from roadstate.core import Estimates, Log
from roadstate.estimators import build
from roadstate.run import batch
from roadstate.sim.manoeuvres import Manoeuvre, Script
from roadstate.sim.manoeuvres.path import straight
from roadstate.sim.roads.centreline import Along
from roadstate.sim.roads.road import Road
from roadstate.sim.speed_plan import SpeedPlan

Runs = list[tuple[Log, Estimates]]
SETTLE = 5.0
"""s of a log's start that do not count."""


def incline(slope: float) -> Along:
    """Height and slope along a road that only climbs, or only falls."""
    return lambda s: (slope * s, np.full_like(s, slope))


def planned(name: str, road: Road, plan: SpeedPlan) -> Manoeuvre:
    """Along a road at planned speeds, by a driver who holds them."""
    return Manoeuvre(name, name, road, plan.speed[0], Script.write(plan), straight())


def rounds(waits: float, phases: Sequence[tuple[float, float]], count: int) -> SpeedPlan:
    """Again and again: phases of so many seconds, at whose ends a speed is reached; from the last one's."""
    times, speeds = [0.0, waits], [phases[-1][1]] * 2
    for seconds, speed in count * tuple(phases):
        times.append(times[-1] + seconds)
        speeds.append(speed)
    return SpeedPlan(tuple(times), tuple(speeds))


def driven(vehicle: str, drive: Scenario, count: int) -> Runs:
    """Recordings of a drive by the bus, and what `joint` says of each.

    Raises:
        LeftTheRoad: the car does.
    """
    logs = on_plant(vehicle, drive, count)
    buses = [without(log, SATELLITE) for log, _ in logs]
    built = [build("joint", car, log.available) for (_, car), log in zip(logs, buses, strict=True)]
    return list(zip(buses, batch(built, buses), strict=True))


def judged(runs: Runs, quantities: Mapping[str, str], friction: float) -> dict[str, float]:
    """RMSE of quantities and the share (%) within their 95 % interval; shares within friction's bounds.

    Args:
        runs: of a drive.
        quantities: by the titles of their columns.
        friction: of the road.
    """
    found: dict[str, float] = {}
    for name, quantity in quantities.items():
        errors = [rmse(said, log, quantity, settle=SETTLE) for log, said in runs]
        shares = [inside(said, log, quantity, settle=SETTLE) for log, said in runs]
        found[name] = float(np.sqrt(np.mean(np.square(errors))))
        found[f"{name.split(',')[0]} inside"] = float(np.mean(shares))
    for end, below in (("lower", True), ("upper", False)):
        bounds = [said.values[f"friction_peak_{end}"][log.time - log.time[0] >= SETTLE] for log, said in runs]
        found[f"{end} bound"] = 100 * float(np.mean((np.concatenate(bounds) <= friction) == below))
    return found


def study(
    drives: Mapping[str, Scenario], quantities: Mapping[str, str], friction: float, count: int
) -> Iterator[tuple[str, dict[str, float]]]:
    """Row after row: the drive and the car."""
    for title, drive in drives.items():
        for vehicle in VEHICLES:
            print(f"{title}, {vehicle}", file=sys.stderr)
            try:
                runs = driven(vehicle, drive, count)
            except LeftTheRoad as error:  # there is nothing to estimate then
                print(error, file=sys.stderr)
                continue
            yield f"{title}, {vehicle}", judged(runs, quantities, friction)
