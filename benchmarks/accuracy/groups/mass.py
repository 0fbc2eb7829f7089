"""The car's mass, learnt in town."""

from __future__ import annotations

from benchmarks.accuracy.grade_bound import least_mass_error
from benchmarks.accuracy.groups.base import SATELLITE, Group, PerSeed, Runs
from benchmarks.accuracy.score import Goal, Score

DRIVE = "urban"


class Mass(Group):
    """Size of the error at the end of the drive, beside that of the file."""

    name = "mass"
    title = "Mass after ten minutes in town, told 5 to 10 % wrong: |error| in per cent"
    drives = ((DRIVE, SATELLITE),)
    quantities = frozenset({"mass"})

    def __init__(self) -> None:
        self._figures = PerSeed(self.name)
        self._bounds: dict[str, float] = {}

    def add(self, runs: Runs) -> None:
        """One error per seed."""
        if runs.drive != DRIVE or "mass" not in runs.estimates[0].values:
            return
        true = runs.vehicle.mass
        final = [100 * abs(e.values["mass"][-1] / true - 1) for e in runs.estimates]
        told = [100 * abs(car.mass / true - 1) for car in runs.cars]
        if runs.vehicle.name not in self._bounds:
            self._bounds[runs.vehicle.name] = least_mass_error(runs.logs[0], runs.vehicle)
        bound = self._bounds[runs.vehicle.name]
        self._figures.add("estimated", "%", Goal.at_most(3), runs, final, bound)
        self._figures.add("as told", "%", None, runs, told)

    def scores(self) -> list[Score]:
        """The estimate's and the file's."""
        return self._figures.scores()
