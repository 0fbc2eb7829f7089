"""Road grade on the three drives of paper 002."""

from __future__ import annotations

from benchmarks.accuracy.grade_bound import least_rmse
from benchmarks.accuracy.groups.base import (
    BUS,
    NO_PITCH,
    SATELLITE,
    SMOOTHED,
    Group,
    PerSeed,
    Runs,
    root_mean_square,
)
from benchmarks.accuracy.measures import rmse
from benchmarks.accuracy.score import Goal, Score

DRIVES = ("straight-constant-speed", "straight-variable-speed", "curve-variable-speed")
SETTLED = 5.0
"""s that paper 002 leaves out."""
_GOALS = {BUS: Goal.at_most(0.25), SATELLITE: Goal.at_most(0.18), SMOOTHED: Goal.at_most(0.08)}
_NEAR = Goal.at_most(1.2)
_SHORT = dict(zip(DRIVES, ("constant speed", "changing speed", "bends"), strict=True))


class Grade(Group):
    """RMSE of the slope in per cent."""

    name = "grade"
    title = "Grade: RMSE in per cent of slope, from 5 s on, over samples and seeds"
    drives = tuple((drive, variant) for variant in (BUS, SATELLITE, SMOOTHED, NO_PITCH) for drive in DRIVES)
    quantities = frozenset({"grade"})

    def __init__(self) -> None:
        self._figures = PerSeed(self.name, mean=root_mean_square)
        self._bounds: dict[tuple[str, str, str], float] = {}

    def add(self, runs: Runs) -> None:
        """One RMSE per seed."""
        if runs.drive not in DRIVES:
            return
        what = f"{_SHORT[runs.drive]}, {runs.variant}"
        values = [
            rmse(e, log, "grade", settle=SETTLED) for e, log in zip(runs.estimates, runs.logs, strict=True)
        ]
        bound = self._bound(runs)
        self._figures.add(what, "%", _GOALS.get(runs.variant), runs, values, bound)
        if bound is not None:
            self._figures.add(f"{what}, over bound", "-", _NEAR, runs, [value / bound for value in values])

    def _bound(self, runs: Runs) -> float | None:
        if runs.variant in (SMOOTHED, NO_PITCH):
            return None
        key = runs.vehicle.name, runs.drive, runs.variant
        if key not in self._bounds:
            self._bounds[key] = least_rmse(runs.logs[0], runs.vehicle, settle=SETTLED)
        return self._bounds[key]

    def scores(self) -> list[Score]:
        """A row for each drive and set of channels."""
        return self._figures.scores()
