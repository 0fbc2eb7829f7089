"""What a step of each estimator costs: over one log, and over many at once."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks.accuracy.built import buildable
from benchmarks.accuracy.scenarios import logs

from roadstate.core import Log
from roadstate.estimators import Estimator
from roadstate.run import CHUNK, batch, scan
from roadstate.run.chunk import SHORT

DRIVE = "straight-variable-speed"
LOGS = 64  # from there on a step and log costs no less
_SECONDS = 60.0
_REPEATS = 3


@dataclass(frozen=True)
class Speed:
    """Cost of a step.

    Attributes:
        estimator: its name.
        scan_us: µs a step over one log of 60 s, the least of three, by the program that a long log gets.
        batch_us: µs a step and log over 64 logs at once, on all processors.
    """

    estimator: str
    scan_us: float
    batch_us: float

    @property
    def real_time(self) -> float:
        """How many times faster than the car one log is gone through, at 100 samples a second."""
        return 1e4 / self.scan_us


def study(
    vehicle: str, estimators: Sequence[str], tell: Callable[[str], None] = lambda what: None
) -> list[Speed]:
    """Time every estimator that runs on a car's log.

    Args:
        vehicle: preset to drive.
        estimators: names.
        tell: called with what is being done.
    """
    log, car = logs(vehicle, DRIVE, 1)[0]
    minute = log.between(0.0, _SECONDS)
    found = []
    for name, estimator in buildable(estimators, car, minute.available):
        tell(f"speed: {name}")
        found.append(Speed(name, _scan_us(estimator, minute), _batch_us(estimator, log)))
    return found


def _scan_us(estimator: Estimator[Any], log: Log) -> float:
    def go() -> Any:
        return scan(estimator, log, among=SHORT + 1)

    go()
    return min(_timed(go) for _ in range(_REPEATS)) / len(log) * 1e6


def _batch_us(estimator: Estimator[Any], log: Log) -> float:
    many = [log.between(log.time[0], log.time[CHUNK])] * LOGS
    batch(estimator, many)
    return _timed(lambda: batch(estimator, many)) / (LOGS * CHUNK) * 1e6


def _timed(call: Callable[[], Any]) -> float:
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin
