"""What a group of figures is: drives it is measured on, what it takes of each run, the scores at the end."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from benchmarks.accuracy.score import Goal, Score
from numpy.typing import NDArray

from roadstate.core import Estimates, Log
from roadstate.vehicles import Vehicle

Array = NDArray[np.float64]
BUS, SATELLITE, SMOOTHED = "bus", "satellite", "smoothed"
"""What a log is cut to: no receiver's channels, or with them; or with them and smoothed afterwards."""
NO_PITCH = "bus, no pitch rate"
"""Nor the pitch rate, which few cars measure."""


BESIDE = ThreadPoolExecutor(1)
"""Works out bounds, which take seconds, while the estimators run on the next drives."""


@dataclass(frozen=True)
class Runs:
    """One estimator over all recordings of one drive.

    Attributes:
        vehicle: that was driven, whose figures are the truth.
        drive: name of the scenario.
        variant: ``BUS``, ``SATELLITE``, ``SMOOTHED`` or ``NO_PITCH``.
        estimator: its name.
        logs, cars, estimates: of each seed: the log, the vehicle file told, and what came out.
    """

    vehicle: Vehicle
    drive: str
    variant: str
    estimator: str
    logs: Sequence[Log]
    cars: Sequence[Vehicle]
    estimates: Sequence[Estimates]


class Group(ABC):
    """A table of figures. One instance serves one run of the benchmark.

    Attributes:
        name: on the command line.
        title: above its table, one line.
        drives: (drive, variant) that it needs; none for a group that takes what others need.
        quantities: an estimator that gives none of these is not run for it; empty takes any.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    drives: ClassVar[tuple[tuple[str, str], ...]] = ()
    quantities: ClassVar[frozenset[str]] = frozenset()

    @abstractmethod
    def add(self, runs: Runs) -> None:
        """Take what is needed of one estimator on one drive."""

    @abstractmethod
    def scores(self) -> list[Score]:
        """What was measured, in the table's order."""


@dataclass(frozen=True)
class Key:
    """What a score is of."""

    what: str
    estimator: str


def root_mean_square(values: Array) -> float:
    """What pooling gives of errors that are such roots themselves, over as many samples each."""
    return float(np.sqrt(np.mean(values**2)))


class PerSeed:
    """Figures that each seed has by itself, and a vehicle's, which is their mean of some kind.

    Args:
        group: name of the group.
        mean: of a vehicle's figures, (N,) → one number.
    """

    def __init__(self, group: str, *, mean: Callable[[Array], Any] = np.mean) -> None:
        self._group, self._mean = group, mean
        self._found: dict[Key, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
        self._about: dict[str, tuple[str, Goal | None]] = {}
        self._bounds: dict[str, dict[str, float]] = defaultdict(dict)

    def add(
        self,
        what: str,
        unit: str,
        goal: Goal | None,
        runs: Runs,
        values: Sequence[float],
        bound: float | None = None,
    ) -> None:
        """The figures of one estimator on one drive, a value per seed."""
        self._about.setdefault(what, (unit, goal))
        self._found[Key(what, runs.estimator)][runs.vehicle.name] += [float(v) for v in values]
        if bound is not None:
            self._bounds[what][runs.vehicle.name] = bound

    def scores(self) -> list[Score]:
        """In the order in which the figures first came."""
        found = []
        for key, by_vehicle in self._found.items():
            unit, goal = self._about[key.what]
            seeds = {name: np.asarray(values) for name, values in by_vehicle.items()}
            whole = {
                n: float(self._mean(v)) if np.isfinite(v).any() else float("nan") for n, v in seeds.items()
            }
            found.append(
                Score(self._group, key.what, key.estimator, unit, goal, whole, seeds, self._bounds[key.what])
            )
        order = {what: i for i, what in enumerate(self._about)}
        return sorted(found, key=lambda score: order[score.what])
