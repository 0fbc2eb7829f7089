"""Friction on a street with bumps and potholes, which no estimator shall take for ice.

``python -m benchmarks.bumps`` prints the table of ``benchmarks/results/bumps.md``: cars on the multibody
plant, production sensors, vehicle files that are off by 5 to 10 %, on asphalt of a friction of 0.9.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import cache, partial

import numpy as np
from benchmarks.accuracy.scenarios import VEHICLES, Scenario, on_plant
from benchmarks.real_logs import of_friction, table

from roadstate.core import Log
from roadstate.core.numerics import use_compilation_cache
from roadstate.sim.manoeuvres import Manoeuvre, Script
from roadstate.sim.manoeuvres.path import straight
from roadstate.sim.roads.bumps import Bump, bumpy_surface
from roadstate.sim.roads.centreline import Bend, make_road
from roadstate.sim.roads.friction import uniform
from roadstate.sim.speed_plan import SpeedPlan
from roadstate.vehicles import Vehicle

NAMES = ("joint", "friction-ukf", "lm-aekf")
FRICTION = 0.9
_LENGTH = 400.0  # m
_FIRST = 30.0  # m to the first bump
_APART = (8.0, 30.0)  # m from one to the next
_SPEEDS = ((0.0, 2.0, 6.0, 12.0, 18.0, 22.0, 28.0, 36.0, 42.0), (5, 5, 12, 12, 14, 8, 13, 13, 6))  # s, m/s


def street(seed: int) -> list[Bump]:
    """Cables and joints across the whole street, and potholes under the wheels of one side, at random."""
    rng, place, found = np.random.default_rng(seed), _FIRST, []
    while place < _LENGTH - 1:
        kind = rng.integers(3)
        if kind == 0:
            found.append(Bump(place, rng.uniform(0.3, 0.6), rng.uniform(0.02, 0.04)))
        else:
            sides = (-2.0, 0.0) if kind == 1 else (0.0, 2.0)
            found.append(Bump(place, rng.uniform(0.4, 0.9), -rng.uniform(0.03, 0.06), *sides))
        place += rng.uniform(*_APART)
    return found


def prepared(vehicle: Vehicle, *, seed: int) -> Manoeuvre:
    """Half a minute in town, on :func:`street`."""
    plan = SpeedPlan(_SPEEDS[0], tuple(float(v) for v in _SPEEDS[1]))
    surface = bumpy_surface(street(seed), _LENGTH)
    road = make_road([Bend(2000.0)], friction=uniform(FRICTION), surface=surface)
    return Manoeuvre("bumps", "a street with bumps", road, plan.speed[0], Script.write(plan), straight())


@cache
def recorded(vehicle: str, seed: int, count: int) -> list[tuple[Log, Vehicle]]:
    """Recordings on one street, each with the vehicle file that an estimator is told."""
    return on_plant(vehicle, Scenario("bumps", "a street with bumps", partial(prepared, seed=seed)), count)


def study(name: str, streets: int, count: int) -> Iterator[tuple[str, dict[str, float]]]:
    """Row after row: the car, and means and extremes over its recordings."""
    for vehicle in VEHICLES:
        rows = [
            of_friction(log, car, name)
            for seed in range(streets)
            for log, car in recorded(vehicle, seed, count)
        ]
        pick = {"used, at most": max, "largest lower bound": max, "least peak": min, "least upper bound": min}
        yield (
            f"{name}, {vehicle}",
            {key: float(pick.get(key, np.mean)([row[key] for row in rows])) for key in rows[0]},
        )


def main() -> None:
    """Print the table."""
    use_compilation_cache()
    rows: dict[str, dict[str, float]] = {}
    for name in NAMES:
        print(name, file=sys.stderr)
        rows |= dict(study(name, streets=4, count=5))
    print("# Bumps and potholes\n\n`python -m benchmarks.bumps`: four streets, five recordings of each.\n")
    print(table(f"a street of {FRICTION}, with a bump or pothole every 8 to 30 m", rows))


if __name__ == "__main__":
    main()
