"""Axle forces on a double lane change near the limit."""

from __future__ import annotations

from benchmarks.accuracy.friction_bound import friction_bound
from benchmarks.accuracy.groups.base import SATELLITE, Group, PerSeed, Runs, root_mean_square
from benchmarks.accuracy.measures import rmse_of_peak, share_of_peak
from benchmarks.accuracy.score import Goal, Score

DRIVE = "double-lane-change-85-0.8"
_GOALS = {
    "force_y_front": Goal.at_most(4),
    "force_y_rear": Goal.at_most(4),
    "force_x_front": Goal.at_most(5),
    "force_x_rear": Goal.at_most(5),
}


class Forces(Group):
    """RMSE over the peak of the true force."""

    name = "forces"
    title = "Axle forces, double lane change at 85 km/h on 0.8: RMSE in per cent of the true force's peak"
    drives = ((DRIVE, SATELLITE),)
    quantities = frozenset(_GOALS)

    def __init__(self) -> None:
        self._figures = PerSeed(self.name)
        self._bounds: dict[str, dict[str, float]] = {}

    def add(self, runs: Runs) -> None:
        """One figure per seed and force."""
        if runs.drive != DRIVE:
            return
        bounds = self._bound(runs)
        for quantity, goal in _GOALS.items():
            if quantity in runs.estimates[0].values:
                pairs = zip(runs.estimates, runs.logs, strict=True)
                found = [rmse_of_peak(e, log, quantity) for e, log in pairs]
                self._figures.add(quantity, "%", goal, runs, found, bounds[quantity])

    def _bound(self, runs: Runs) -> dict[str, float]:
        if runs.vehicle.name not in self._bounds:
            log = runs.logs[0]
            forces = friction_bound(log, runs.vehicle).forces
            self._bounds[runs.vehicle.name] = {
                quantity: share_of_peak(root_mean_square(std), log, quantity)
                for quantity, std in forces.items()
            }
        return self._bounds[runs.vehicle.name]

    def scores(self) -> list[Score]:
        """A row for each force."""
        return self._figures.scores()
