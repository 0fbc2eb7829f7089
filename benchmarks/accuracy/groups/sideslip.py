"""Sideslip on a double lane change near the limit."""

from __future__ import annotations

from benchmarks.accuracy.groups.base import BUS, SATELLITE, Group, PerSeed, Runs, root_mean_square
from benchmarks.accuracy.groups.forces import DRIVE
from benchmarks.accuracy.measures import rmse
from benchmarks.accuracy.score import Score

SETTLED = 1.0
"""s that are left out."""


class Sideslip(Group):
    """RMSE of the lateral velocity."""

    name = "sideslip"
    title = "Sideslip, double lane change at 85 km/h on 0.8: RMSE of the lateral velocity in m/s, from 1 s on"
    drives = ((DRIVE, BUS), (DRIVE, SATELLITE))
    quantities = frozenset({"velocity_y"})

    def __init__(self) -> None:
        self._figures = PerSeed(self.name, mean=root_mean_square)

    def add(self, runs: Runs) -> None:
        """One RMSE per seed."""
        if (runs.drive, runs.variant) in self.drives:
            pairs = zip(runs.estimates, runs.logs, strict=True)
            found = [rmse(e, log, "velocity_y", settle=SETTLED) for e, log in pairs]
            self._figures.add(f"velocity_y, {runs.variant}", "m/s", None, runs, found)

    def scores(self) -> list[Score]:
        """With and without a receiver."""
        return self._figures.scores()
