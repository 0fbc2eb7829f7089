"""How soon a change of the road's friction is noticed."""

from __future__ import annotations

import numpy as np
from benchmarks.accuracy.groups.base import SATELLITE, Group, PerSeed, Runs
from benchmarks.accuracy.measures import half_way_time
from benchmarks.accuracy.score import Goal, Score

DRIVES = tuple(
    f"joint-{how}-{words}" for how in ("acceleration", "braking") for words in ("0.8-0.2", "0.2-0.8")
)
_SOON = 2.0  # s within which a change must be noticed to count as detected


class JointRoad(Group):
    """s until the friction of the front axle has gone half the way, and how often it does within 2 s."""

    name = "joint-road"
    title = "Joint road: from the front wheels' crossing to half the way (in log μ), if within 2 s"
    drives = tuple((drive, SATELLITE) for drive in DRIVES)
    quantities = frozenset({"friction_peak_front", "friction_peak"})

    def __init__(self) -> None:
        self._times = PerSeed(self.name, mean=np.nanmedian)
        self._shares = PerSeed(self.name)

    def add(self, runs: Runs) -> None:
        """A time per seed, and whether there is one."""
        if runs.drive not in DRIVES:
            return
        given = runs.estimates[0].values
        quantity = "friction_peak_front" if "friction_peak_front" in given else "friction_peak"
        times = np.array(
            [half_way_time(e, log, quantity) for e, log in zip(runs.estimates, runs.logs, strict=True)]
        )
        soon = times <= _SOON  # false where it never is
        road = runs.drive.removeprefix("joint-")
        detected = np.where(soon, 100.0, 0.0).tolist()
        self._times.add(f"{road}: time", "s", Goal.at_most(0.2), runs, np.where(soon, times, np.nan).tolist())
        self._shares.add(f"{road}: noticed", "%", Goal.at_least(95), runs, detected)

    def scores(self) -> list[Score]:
        """Two rows for each road."""
        return self._times.scores() + self._shares.scores()
