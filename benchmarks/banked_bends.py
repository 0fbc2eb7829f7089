"""Friction in banked bends of a dry road, whose bank no estimator shall take for a slide on ice.

``python -m benchmarks.banked_bends`` prints the table of ``benchmarks/results/banked_bends.md``: cars on the
multibody plant, production sensors, vehicle files that are off by 5 to 10 %, on asphalt of a friction of 0.9.
"""

from __future__ import annotations

import sys
from functools import partial
from typing import NamedTuple

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

FRICTION = 0.9
_STRAIGHT, _ARC = 140.0, 160.0  # m
_SETTLES = 2.0  # s that do not count
_RECORDINGS = 5


class Bends(NamedTuple):
    """A left bend, a right one, a left one, driven at one speed.

    Attributes:
        speed: m/s.
        bank: rad, inward.
        radius: m.
        run_off: m in which the bank comes.
        spiral: m in which the curvature does: a road's, or how swiftly a driver steers.
        ahead: share of the run-off that lies on the straight.
    """

    speed: float = 22.0
    bank: float = 0.07
    radius: float = 200.0
    run_off: float = 50.0
    spiral: float = 10.0
    ahead: float = 2 / 3

    def scenario(self) -> Scenario:
        """For the plant."""
        return Scenario("banked", "banked bends", partial(_prepared, bends=self))


ROADS = {
    "80 km/h, 200 m, 7 %, run-off in the spiral": Bends(spiral=50.0, ahead=0.0),
    "the same, two thirds of it ahead": Bends(spiral=50.0),
    "the same, steered within .5 s": Bends(),
    "80 km/h, 250 m, 8 %, all ahead": Bends(bank=0.08, radius=250.0, spiral=20.0, ahead=1.0),
    "50 km/h, 80 m, 6 %, two thirds ahead": Bends(14.0, 0.06, 80.0, 35.0),
    "110 km/h, 400 m, 6 %, two thirds ahead": Bends(30.0, 0.06, 400.0, 60.0),
    "90 km/h, 120 m, 16 %, run-off in the spiral": Bends(25.0, 0.16, 120.0, 80.0, 80.0, 0.0),
    "54 km/h, 180 m, 25 %, made for 77 km/h": Bends(15.0, 0.25, 180.0, 80.0, 80.0, 0.0),
    "29 km/h, straight, leaning by 20 %": Bends(8.0, 0.2, 1e6),
}
"""What is driven, by what is said of it."""


def _prepared(vehicle: Vehicle, *, bends: Bends) -> Manoeuvre:
    plan, knots, banks = [Bend(_STRAIGHT)], [0.0], [0.0]
    ahead = bends.ahead * bends.run_off
    for side in (1.0, -1.0, 1.0):
        curved = side / bends.radius
        begins = sum(bend.length for bend in plan) - ahead
        ends = begins + 2 * bends.spiral + _ARC + 2 * ahead
        plan += [Bend(bends.spiral, 0.0, curved), Bend(_ARC, curved), Bend(bends.spiral, curved, 0.0)]
        plan += [Bend(_STRAIGHT)]
        knots += [begins, begins + bends.run_off, ends - bends.run_off, ends]
        banks += [0.0, -side * bends.bank, -side * bends.bank, 0.0]
    length = sum(bend.length for bend in plan)
    road = make_road(plan, bank=half_cosine([*knots, length], [*banks, 0.0]), friction=uniform(FRICTION))
    seconds = (length - _STRAIGHT / 2) / bends.speed
    drive = Script.write(SpeedPlan((0.0, seconds), (bends.speed, bends.speed)))
    return Manoeuvre("banked", "banked bends", road, bends.speed, drive, straight())


def of_bends(logs: list[tuple[Log, Vehicle]]) -> dict[str, float]:
    """What ``joint`` makes of the recordings of one drive, in the mean; shares of samples in %."""
    rows = []
    built = [build("joint", car, log.available) for log, car in logs]
    for (log, _), said in zip(logs, batch(built, [log for log, _ in logs]), strict=True):
        late, values = log.time - log.time[0] >= _SETTLES, said.values
        rows.append(
            {
                "upper bound too low": 100 * np.mean(values["friction_peak_upper"][late] < FRICTION),
                "lower bound too high": 100 * np.mean(values["friction_peak_lower"][late] > FRICTION),
                "likeliest below half": 100 * np.mean(values["friction_peak"][late] < 0.5 * FRICTION),
                "RMSE bank, %": 100 * rmse(said, log, "bank", settle=_SETTLES),
                "bank inside": inside(said, log, "bank", settle=_SETTLES),
                "RMSE v_y, m/s": rmse(said, log, "velocity_y", settle=_SETTLES),
                "v_y inside": inside(said, log, "velocity_y", settle=_SETTLES),
            }
        )
    return averaged(rows)


def main() -> None:
    """Print the tables."""
    use_compilation_cache()
    print(
        f"# Banked bends\n\n`python -m benchmarks.banked_bends`: `joint` on a road of {FRICTION}; "
        f"{_RECORDINGS} recordings of each drive, without satellites; radius, bank, and where its run-off "
        "lies. Shares of the samples in %; inside: their 95 % intervals.\n"
    )
    for vehicle in VEHICLES:
        rows: dict[str, dict[str, float]] = {}
        for road, bends in ROADS.items():
            print(vehicle, road, file=sys.stderr)
            logs = on_plant(vehicle, bends.scenario(), _RECORDINGS)
            for dropped, what in (((), "with roll rate"), (("roll_rate",), "without")):
                cut = [(without(log, (*SATELLITE, *dropped)), car) for log, car in logs]
                rows[f"{road}; {what}"] = of_bends(cut)
        print(table(vehicle, rows))


if __name__ == "__main__":
    main()
