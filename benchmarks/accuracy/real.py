"""Grade on the two real recordings, by every estimator that their channels allow."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from benchmarks.accuracy.built import buildable
from benchmarks.accuracy.run import quantities
from benchmarks.accuracy.score import Goal, Score
from benchmarks.real_logs import DATA, load, ours, plain
from numpy.typing import NDArray

from roadstate.core import WHEELS, Log
from roadstate.vehicles import Vehicle

GROUP = "real"
TITLE = "Grade on real recordings: mean |error| in per cent of slope against the recording's own reference"
_SETTLED = 3.0  # s
_Case = tuple[str, Goal, Log, Vehicle, NDArray[np.bool_]]


def study(estimators: Sequence[str], tell: Callable[[str], None] = lambda what: None) -> list[Score]:
    """A figure for each recording and estimator; none where the recordings are not on this machine.

    Args:
        estimators: names.
        tell: called with what is being done.
    """
    found = []
    for what, goal, log, car, where in _cases() if DATA.is_dir() else ():
        for name, estimator in buildable(estimators, car, log.available):
            tell(f"{what}: {name}")
            if "grade" not in quantities(estimator):
                continue
            row, _ = ours(name, log, car, where)
            found.append(Score(GROUP, what, name, "%", goal, {what: row["MAE"]}, {}))
    return found


def _cases() -> Iterator[_Case]:
    files = [DATA / "comma2k19" / "segment40_decoded_50Hz.csv.gz"]
    log, car = load("comma2k19", files, [], "vehicle.yaml", "mapping.yaml")
    speed = car.wheels.radius * np.mean([log[f"wheel_speed_{w}"] for w in WHEELS], axis=0)
    # where the non-causal estimate beside which `benchmarks.real_logs` shows ours has a value
    where = np.isfinite(plain(log, speed, 1.0)) & (log.time - log.time[0] >= _SETTLED)
    yield "comma2k19, car's accelerometer", Goal.at_most(0.35), log, car, where
    folder = DATA / "css_mf4"
    files = sorted(folder.glob("0*.MF4"))
    log, car = load("css_mf4", files, [folder / "canmod-gps.dbc"], "vehicle.yaml", "mapping.yaml")
    # the example's vehicle file rests on the first half
    yield "css_mf4, second half", Goal.at_most(0.6), log, car, log.time >= log.time[[0, -1]].mean()
