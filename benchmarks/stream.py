"""How long one sample takes in a stream, until its estimate can be read.

Run: python -m benchmarks.stream [--only ESTIMATOR …] [--save]
Budget: 1 ms at the 99th percentile, on one core.
"""

from __future__ import annotations

import argparse
import platform
import time
from pathlib import Path

import jax
import numpy as np
from benchmarks.machine import processor
from benchmarks.real_logs import table
from numpy.typing import NDArray

from roadstate.core import Log
from roadstate.core.numerics import use_compilation_cache
from roadstate.estimators import all_estimators, build
from roadstate.run import Stream
from roadstate.sim.manoeuvres import manoeuvre
from roadstate.sim.plant import multibody_plant
from roadstate.sim.run import drive, truth_table
from roadstate.sim.sensors import measure, sensor_preset, to_log
from roadstate.vehicles import load_vehicle

VEHICLE = "family-car"
RESULTS = Path(__file__).parent / "results" / "stream.md"
_ROUNDS = 3
_BACK = (1, 10, 50)  # samples that a late one lies back
_WINDOW = 1.0  # s
_MS = 1e3
_HEAD = f"""# One sample in a stream

`python -m benchmarks.stream`: {{samples}} samples at 100 Hz of a double lane change by {VEHICLE}, all
channels of the preset `automotive`; ms from a sample pushed to its estimate, least of {_ROUNDS} rounds; a
late sample comes when so many after it are there, which are done again. Budget: 1 ms at the 99th
percentile, on one core.
{{on}}.
"""


def recorded() -> Log:
    """A double lane change, with all channels of production sensors."""
    car = load_vehicle(VEHICLE)
    truth = truth_table(drive(multibody_plant(car), manoeuvre("double-lane-change").prepare(car), car))
    return to_log(measure(truth, sensor_preset("automotive"), seed=0, metadata={}))


def in_order(stream: Stream, log: Log, rows: list[dict[str, float]]) -> NDArray[np.float64]:
    """Seconds for each sample pushed in time order."""
    taken = []
    for at, row in zip(log.time.tolist(), rows, strict=True):
        begin = time.perf_counter()
        stream.push(at, row)
        taken.append(time.perf_counter() - begin)
    return np.array(taken)


def late(stream: Stream, log: Log, rows: list[dict[str, float]], back: int) -> float:
    """Median seconds for a sample that comes when so many after it are there, of a new stream."""
    taken = []
    for first in range(0, len(rows) - back, back + 1):
        for i in (*range(first + 1, first + back + 1), first):
            begin = time.perf_counter()
            stream.push(float(log.time[i]), rows[i])
        taken.append(time.perf_counter() - begin)
    return float(np.median(taken[1:]))


def measured(name: str, log: Log) -> dict[str, float]:
    """The table's row of an estimator, ms."""
    estimator = build(name, load_vehicle(VEHICLE), log.available)
    rows = [
        {c: float(v[i]) for c, v in log.channels.items() if c in estimator.channels and np.isfinite(v[i])}
        for i in range(len(log))
    ]
    in_order(Stream(estimator), log, rows)
    rounds = np.array([in_order(Stream(estimator), log, rows) for _ in range(_ROUNDS)])
    median, most = np.quantile(rounds, (0.5, 0.99), axis=1).min(axis=1)
    behind = {f"{n} back": _MS * late(Stream(estimator, window=_WINDOW), log, rows, n) for n in _BACK}
    return {"median": _MS * median, "99 %": _MS * most, **behind}


def main() -> None:
    """Measure, print, and on demand write the page."""
    names = list(all_estimators())
    parser = argparse.ArgumentParser(prog="python -m benchmarks.stream", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="ESTIMATOR")
    parser.add_argument("--save", action="store_true", help=f"write {RESULTS.name}")
    given = parser.parse_args()
    use_compilation_cache()
    log = recorded()
    on = f"JAX {jax.__version__}, Python {platform.python_version()}, {processor()}"
    rows = {name: measured(name, log) for name in given.only}
    page = f"{_HEAD.format(samples=len(log), on=on)}\n{table('estimators', rows)}"
    print(page, end="")
    if given.save:
        RESULTS.write_text(page)


if __name__ == "__main__":
    main()
