"""Whether intervals hold what they promise, of every quantity, over all drives."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from benchmarks.accuracy.groups.base import Group, Runs
from benchmarks.accuracy.measures import covered
from benchmarks.accuracy.score import Goal, Score

from roadstate.core import is_bound

_GOALS = {95: Goal(92, 98), 90: Goal(87, 95)}


class Coverage(Group):
    """Share of samples whose interval holds the truth: ±1.96 σ, or the 5 % and 95 % bounds of a friction."""

    name = "coverage"
    title = "Coverage in per cent: of ±1.96 σ (ideally 95), of a friction's bounds (ideally 90), all drives"

    def __init__(self) -> None:
        # (quantity, share promised, estimator) → vehicle → seed → (inside, all)
        self._counts: dict[tuple[str, int, str], dict[str, dict[int, list[int]]]] = defaultdict(
            lambda: defaultdict(lambda: defaultdict(lambda: [0, 0]))
        )

    def add(self, runs: Runs) -> None:
        """Counts of each quantity that has a reference."""
        for seed, (estimates, log) in enumerate(zip(runs.estimates, runs.logs, strict=True)):
            for quantity in (q for q in estimates.values if not is_bound(q)):
                counted = covered(estimates, log, quantity)
                if counted is not None:
                    promised = 90 if f"{quantity}_lower" in estimates.values else 95
                    sums = self._counts[quantity, promised, runs.estimator][runs.vehicle.name][seed]
                    sums[0] += counted[0]
                    sums[1] += counted[1]

    def scores(self) -> list[Score]:
        """A row for each quantity."""
        found = []
        for (quantity, promised, estimator), by_vehicle in self._counts.items():
            sums = {
                vehicle: np.array(list(by_seed.values()), float) for vehicle, by_seed in by_vehicle.items()
            }
            whole = {vehicle: float(100 * s[:, 0].sum() / s[:, 1].sum()) for vehicle, s in sums.items()}
            seeds = {vehicle: 100 * s[:, 0] / s[:, 1] for vehicle, s in sums.items()}
            what = quantity
            found.append(Score(self.name, what, estimator, "%", _GOALS[promised], whole, seeds))
        return sorted(found, key=lambda score: score.what)
