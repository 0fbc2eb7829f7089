"""Target speed over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roadstate.core import InputError
from roadstate.sim.roads.grade import RAMP_SPEED

Array = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class SpeedPlan:
    """A target speed over time, linear between its knots.

    Attributes:
        time: knots in s, the first at 0, increasing.
        speed: target speed at the knots in m/s, never negative.

    Raises:
        InputError: knots that do not increase or a negative speed.
    """

    time: tuple[float, ...]
    speed: tuple[float, ...]

    def __post_init__(self) -> None:
        increasing = len(self.time) > 1 and bool((np.diff(self.time) > 0).all()) and self.time[0] == 0
        if len(self.time) != len(self.speed) or not increasing or min(self.speed) < 0:
            raise InputError("a speed plan needs times from 0 upward and as many speeds of 0 or more")

    @property
    def duration(self) -> float:
        """Seconds from first to last knot."""
        return self.time[-1]

    def at(self, time: NDArray[np.floating[Any]]) -> tuple[Array, Array]:
        """Target speed (m/s) and its derivative (m/s²) at times (T,), s."""
        knots, speeds = np.asarray(self.time), np.asarray(self.speed)
        slopes = np.diff(speeds) / np.diff(knots)
        section = np.clip(np.searchsorted(knots, time, side="right") - 1, 0, len(slopes) - 1)
        rise = np.where(time > knots[-1], 0.0, slopes[section])
        return np.interp(time, knots, speeds), rise

    @classmethod
    def constant(cls, speed: float = RAMP_SPEED, duration: float = 110.0) -> SpeedPlan:
        """One speed (m/s) throughout: paper 002, §4.1."""
        return cls((0.0, duration), (speed, speed))

    @classmethod
    def variable(cls) -> SpeedPlan:
        """Braking, gear shifts and 8 s of standstill on the upslope, within the length of paper 002's ramp.

        The paper's §4.2 does not print its speeds; these are chosen.
        """
        knots = (
            (0.0, 9.7), (12.0, 9.7), (18.0, 14.0), (26.0, 14.0), (31.0, 8.0), (42.0, 8.0), (48.0, 0.0),
            (56.0, 0.0), (68.0, 13.0), (78.0, 13.0), (84.0, 8.0), (90.0, 8.0), (98.0, 15.0), (106.0, 15.0),
            (112.0, 10.0), (124.0, 10.0),
        )  # fmt: skip
        return cls(tuple(t for t, _ in knots), tuple(v for _, v in knots))
