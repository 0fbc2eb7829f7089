"""The estimator `joint` with few samples a second: logs thinned out from 100 Hz, as buses and loggers do it.

``python -m benchmarks.slow_samples`` prints the table of ``benchmarks/results/slow_samples.md``: three cars
on the multibody plant, automotive sensors without satellites, vehicle files that are off by 5 to 10 %.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np
from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import SATELLITE, SCENARIOS, Scenario, on_plant
from benchmarks.real_logs import table

from roadstate.core import Log
from roadstate.core.constants import GRAVITY
from roadstate.core.numerics import use_compilation_cache
from roadstate.estimators import build
from roadstate.metrics import NORMAL_95
from roadstate.run import batch
from roadstate.sim.manoeuvres import Manoeuvre, Script
from roadstate.sim.manoeuvres.path import straight
from roadstate.sim.roads.centreline import Bend, make_road
from roadstate.sim.roads.friction import uniform
from roadstate.sim.speed_plan import SpeedPlan
from roadstate.vehicles import Vehicle

_VEHICLES = ("family-car", "suv", "in-wheel-ev")
_EVERY = (1, 2, 5, 10)
_SETTLE = 5.0  # s that do not count, but of a drive that is hardly longer
_LOW = 0.6  # share of the road's friction below which a middle value is a false alarm


def winding(vehicle: Vehicle) -> Manoeuvre:
    """Ten bends of 70 m to either side on a road of .5, the last ones with nearly all of its friction."""
    bends = [Bend(60.0)]
    for i in range(10):
        sharp = (1 if i % 2 else -1) / 70.0
        bends += [Bend(20.0, 0.0, sharp), Bend(35.0, sharp), Bend(20.0, sharp, 0.0), Bend(10.0)]
    road = make_road([*bends, Bend(500.0)], friction=uniform(0.5))
    plan = SpeedPlan((0.0, 60.0), (14.0, 16.5))
    return Manoeuvre("winding", "bends of 70 m on .5", road, 14.0, Script.write(plan), straight())


def lifted_off(vehicle: Vehicle) -> Manoeuvre:
    """Into a bend of 60 m on a road of .4, faster to four fifths of its friction, and off the pedals."""
    road = make_road([Bend(60.0), Bend(25.0, 0.0, 1 / 60), Bend(3000.0, 1 / 60)], friction=uniform(0.4))
    fast = (0.8 * 0.4 * GRAVITY * 60) ** 0.5
    plan = SpeedPlan((0.0, 6.0, 10.0, 30.0), (0.7 * fast, 0.7 * fast, fast, fast))
    script = Script.write(plan, pedals_from=13.0)
    return Manoeuvre("lifted-off", "off the pedals in a bend of .4", road, plan.speed[0], script, straight())


DRIVES = {
    name: SCENARIOS[name]
    for name in (
        *("straight-variable-speed", "curve-variable-speed", "double-lane-change-85-0.8"),
        *("joint-acceleration-0.8-0.2", "joint-braking-0.8-0.2"),
    )
} | {
    "winding-0.5": Scenario("winding-0.5", "bends of 70 m on .5", winding),
    "lifted-off-0.4": Scenario("lifted-off-0.4", "off the pedals in a bend of .4", lifted_off),
}


def thinned(log: Log, every: int) -> Log:
    """Every so manieth sample."""
    return Log(log.time[::every], {name: values[::every] for name, values in log.channels.items()})


def judged(logs: list[tuple[Log, Vehicle]]) -> dict[str, float]:
    """Of `joint`: grade (RMSE in %, share within ±1.96 σ), friction's false alarms and bounds, faults (shares
    in %)."""
    said = batch([build("joint", car, log.available) for log, car in logs], [log for log, _ in logs])
    grade, inside, alarms, above, below, faulty = [], [], [], [], [], []
    for (log, _), estimates in zip(logs, said, strict=True):
        used = log.time - log.time[0] >= min(_SETTLE, 0.2 * (log.time[-1] - log.time[0]))
        error = (np.tan(estimates.values["grade"]) - np.tan(log["ref_grade"]))[used]
        road = np.mean([log[f"ref_friction_{w}"] for w in ("fl", "fr", "rl", "rr")], axis=0)[used]
        low, middle, high = (
            estimates.values[f"friction_peak{part}"][used] for part in ("_lower", "", "_upper")
        )
        grade.append(100 * error)
        inside.append(np.abs(error) <= NORMAL_95 * estimates.std["grade"][used])
        alarms.append(middle < _LOW * road)
        above.append(road >= low)
        below.append(road <= high)
        faulty.append(np.array([str(label) == "sensor_fault" for label in estimates.labels()])[used])
    share = {"inside": inside, "alarm": alarms, "above lower": above, "below upper": below, "fault": faulty}
    return {
        "RMSE": float(np.sqrt(np.mean(np.concatenate(grade) ** 2))),
        **{name: 100 * float(np.mean(np.concatenate(parts))) for name, parts in share.items()},
    }


def study(count: int) -> Iterator[tuple[str, dict[str, float]]]:
    """Row after row: drive, car and rate."""
    for drive in DRIVES:
        for vehicle in _VEHICLES:
            print(f"{drive}, {vehicle}", file=sys.stderr)
            logs = [(without(log, SATELLITE), car) for log, car in on_plant(vehicle, DRIVES[drive], count)]
            for every in _EVERY:
                found = judged([(thinned(log, every), car) for log, car in logs])
                yield f"{drive}, {vehicle}, {100 // every} Hz", found


def main() -> None:
    """Print the table."""
    use_compilation_cache()
    rows = dict(study(count=4))
    print(
        "# Few samples a second\n\n`python -m benchmarks.slow_samples`: four recordings of each drive, every"
        " sample, second, fifth or tenth of\nthem. Grade: RMSE in per cent of grade and share within the 95 %"
        " interval. Friction: share of samples with a middle\nvalue below 60 % of the road's (false alarms),"
        " with the road's above the lower and below the upper 5 % bound. Samples\ncalled a fault. Shares"
        " in per cent.\n"
    )
    print(table("joint, bus alone", rows))


if __name__ == "__main__":
    main()
