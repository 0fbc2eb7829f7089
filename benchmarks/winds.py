"""Grade and forces in wind, which torques take for a slope: on a motorway, where air resists most.

``python -m benchmarks.winds`` prints the table of ``benchmarks/results/winds.md``: cars on the multibody
plant, production sensors, vehicle files that are off by 5 to 10 %.
"""

from __future__ import annotations

import sys

import numpy as np
from benchmarks.accuracy.measures import averaged, inside, rmse
from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import SATELLITE, VEHICLES, Scenario, on_plant
from benchmarks.real_logs import table

from roadstate.core import Log
from roadstate.core.numerics import use_compilation_cache
from roadstate.estimators import build
from roadstate.run import batch
from roadstate.sim.manoeuvres import Manoeuvre, Script
from roadstate.sim.manoeuvres.path import straight
from roadstate.sim.roads.centreline import Bend, half_cosine, make_road
from roadstate.sim.roads.friction import uniform
from roadstate.sim.speed_plan import SpeedPlan
from roadstate.vehicles import Vehicle

WINDS = (0.0, 3.1, -3.1, 6.2, -6.2)
"""m/s from ahead: SAE J1252 has 3.1 in the mean, from anywhere."""
_RECORDINGS = 4
_SETTLES = 5.0  # s that do not count
_SPIRAL, _ARC, _RADIUS = 120.0, 350.0, 900.0  # m
_HILLS = 300.0  # m from a top to the foot
_SLOPES = (0.02, -0.03, 0.04, -0.01, 0.03, -0.04, 0.0)
_PLAN = ((0.0, 20.0, 28.0, 60.0, 70.0, 90.0, 100.0, 124.0), (33.0, 33.0, 29.0, 29.0, 36.0, 36.0, 31.0, 31.0))


def prepared(vehicle: Vehicle) -> Manoeuvre:
    """A motorway in hills: 105 to 130 km/h, wide bends that lead back to the same direction."""
    del vehicle
    plan = [Bend(_HILLS)]
    for side in (1.0, -1.0, 1.0, -1.0):
        curved = side / _RADIUS
        plan += [Bend(_SPIRAL, 0.0, curved), Bend(_ARC, curved), Bend(_SPIRAL, curved, 0.0), Bend(450.0)]
    length = sum(bend.length for bend in plan)
    knots = np.arange(0.0, length + _HILLS, _HILLS)
    slopes = np.resize(_SLOPES, len(knots))
    heights = np.concatenate([[0.0], np.cumsum(_HILLS * slopes[1:])])
    road = make_road(plan, height=half_cosine(knots, heights), friction=uniform(0.9))
    drive = Script.write(SpeedPlan(*_PLAN))
    return Manoeuvre("motorway", "a motorway in wind", road, _PLAN[1][0], drive, straight())


def recorded(vehicle: str, wind: float, count: int) -> list[tuple[Log, Vehicle]]:
    """Recordings of the drive in a wind from ahead, m/s, without satellites."""
    made = on_plant(vehicle, Scenario("motorway", "a motorway", prepared, wind=(-wind, 0.0)), count)
    return [(without(log, SATELLITE), car) for log, car in made]


def judged(name: str, logs: list[tuple[Log, Vehicle]]) -> dict[str, float]:
    """RMSE of an estimator and how many of the samples lie within ±1.96 σ, %: grade (%), F_x in front (N)."""
    rows = []
    built = [build(name, car, log.available) for log, car in logs]
    for (log, _), said in zip(logs, batch(built, [log for log, _ in logs]), strict=True):
        row = {}
        for quantity, unit in (("grade", "%"), ("force_x_front", "N")):
            if quantity in said.values:
                row[f"RMSE {quantity}, {unit}"] = rmse(said, log, quantity, settle=_SETTLES)
                row[f"{quantity} inside"] = inside(said, log, quantity, settle=_SETTLES)
        rows.append(row)
    return averaged(rows)


def main() -> None:
    """Print the tables."""
    use_compilation_cache()
    print(
        f"# Wind\n\n`python -m benchmarks.winds`: a motorway in hills at 105 to 130 km/h; {_RECORDINGS} "
        "recordings of each drive without satellites; a wind from ahead, m/s (from behind where negative). "
        "Inside: share of the samples in their 95 % interval, %.\n"
    )
    for vehicle in VEHICLES:
        rows: dict[str, dict[str, float]] = {}
        for wind in WINDS:
            print(vehicle, wind, file=sys.stderr)
            logs = recorded(vehicle, wind, _RECORDINGS)
            for name in ("joint", "tfobe", "debe"):
                rows[f"{wind:+.1f}, {name}"] = judged(name, logs)
        print(table(vehicle, rows))


if __name__ == "__main__":
    main()
