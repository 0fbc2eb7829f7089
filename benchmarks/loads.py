"""A load that changes at a stop in town: what `joint` makes of the mass, and of the slope meanwhile.

``python -m benchmarks.loads`` prints the table of ``benchmarks/results/loads.md``: three cars on the
multibody plant, automotive sensors, vehicle files that are off by 5 to 10 %.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np
from benchmarks.accuracy.measures import interval
from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import VEHICLES, Scenario, driven, in_town
from benchmarks.drawn.__main__ import LACKING
from benchmarks.real_logs import table

from roadstate.core import Estimates, Log, reference
from roadstate.core.numerics import use_compilation_cache
from roadstate.estimators import build
from roadstate.papers.base import MISMATCHED
from roadstate.papers.plants import told
from roadstate.run import batch
from roadstate.sim.run import truth_table
from roadstate.sim.sensors import measure, sensor_preset, to_log
from roadstate.vehicles import Vehicle, load_vehicle

LOADS = (0.0, 0.06, -0.06, 0.2, -0.17, 0.7)  # shares of the mass that come in, the last with a trailer
_SECONDS = 240.0  # of the drive in town
_CHANGES = (100.0, 190.0)  # s between which it is the longest stop at which the load changes
_STILL = 0.02  # m/s
_AFTER = (10.0, 30.0, 60.0)  # s of driving on
_FILES = 4
_CHANNELS = ("bus", "engine", "no brakes")


def loaded(vehicle: Vehicle, load: float) -> Vehicle:
    """With so much more, as a share of the mass, spread as the mass is."""
    share = 1 + load
    return vehicle.model_copy(
        update={"mass": share * vehicle.mass, "yaw_inertia": share * vehicle.yaw_inertia}
    )


def changed(
    before: dict[str, np.ndarray], after: dict[str, np.ndarray]
) -> tuple[dict[str, np.ndarray], float]:
    """Truths of two drives joined amid the longest stop, and when the car drives on, s."""
    time = before["time"]
    stands = np.all([np.abs(t["ref_velocity_x"]) < _STILL for t in (before, after)], axis=0)
    stands &= (time > _CHANGES[0]) & (time < _CHANGES[1])
    edges = np.flatnonzero(np.diff(np.r_[False, stands, False].astype(int)))
    begin, end = max(edges.reshape(-1, 2), key=lambda stop: stop[1] - stop[0])
    here = (begin + end) // 2
    return {n: np.concatenate([v[:here], after[n][here:]]) for n, v in before.items()}, float(time[end])


def judged(said: list[Estimates], logs: list[Log], mass: float, moves: float) -> dict[str, float]:
    """Of the mass after a while (|error|, %), and from 10 s on (share within the 95 % interval, %); of the
    slope in the minute after (RMSE, %; share inside, %)."""
    off, inside, slope, holds = [], [], [], []
    for estimates, log in zip(said, logs, strict=True):
        since = log.time - log.time[0] - moves
        off.append([100 * abs(np.interp(s, since, estimates.values["mass"]) / mass - 1) for s in _AFTER])
        ends, late = interval(estimates, "mass"), since > _AFTER[0]
        truth, reach = reference("grade", log.channels), interval(estimates, "grade")
        assert ends is not None
        assert reach is not None
        assert truth is not None
        inside.append(((ends[0] <= mass) & (mass <= ends[1]))[late])
        minute = (since > 0) & (since < 60)
        slope.append(100 * (estimates.values["grade"] - truth)[minute])
        holds.append(((reach[0] <= truth) & (truth <= reach[1]))[minute])
    after = dict(zip((f"after {s:g} s" for s in _AFTER), np.mean(off, axis=0), strict=True))
    return {
        **after,
        "inside": 100 * float(np.mean(np.concatenate(inside))),
        "slope": float(np.sqrt(np.mean(np.concatenate(slope) ** 2))),
        "slope inside": 100 * float(np.mean(np.concatenate(holds))),
    }


def study() -> Iterator[tuple[str, str, dict[str, float]]]:
    """Row after row: channels, then load and car."""
    town = Scenario("town", "four minutes in town", in_town(_SECONDS), is_long=True)
    sensors = sensor_preset("automotive")
    for vehicle in VEHICLES:
        car = load_vehicle(vehicle)
        files = [told(car, MISMATCHED, seed) for seed in range(_FILES)]
        before = truth_table(driven(car, town))
        for load in LOADS:
            print(f"{vehicle}, {100 * load:+g} %", file=sys.stderr)
            heavy = loaded(car, load)
            truth, moves = changed(before, truth_table(driven(heavy, town)))
            logs = [to_log(measure(truth, sensors, seed=s, metadata={})) for s in range(_FILES)]
            for channels in _CHANNELS:
                own = [without(log, LACKING[channels]) for log in logs]
                built = [build("joint", file, own[0].available) for file in files]
                yield (
                    channels,
                    f"{100 * load:+g} %, {vehicle}",
                    judged(batch(built, own), own, heavy.mass, moves),
                )


def main() -> None:
    """Print the tables."""
    use_compilation_cache()
    print(
        "# A load that changes at a stop\n\n`python -m benchmarks.loads`: four minutes in town; at a stop in"
        " the third the load changes by so many per cent of the\nmass. Four recordings each, `joint`. Mass:"
        " mean size of its error (%) 10, 30 and 60 s after the car drives on, and share (%)\nof samples from"
        " 10 s on within the 95 % interval. Slope: RMSE (%) in the minute after, and share (%) inside.\n"
    )
    rows = list(study())
    for channels in _CHANNELS:
        print(table(channels, {name: row for of, name, row in rows if of == channels}))


if __name__ == "__main__":
    main()
