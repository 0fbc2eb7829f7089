"""One figure of one estimator over seeds and vehicles, its goal, and whether it is met."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Goal:
    """What is wanted of a figure.

    Attributes:
        low, high: both ends included.
    """

    low: float = -np.inf
    high: float = np.inf

    @classmethod
    def at_most(cls, limit: float) -> Goal:
        """No more than that."""
        return cls(high=limit)

    @classmethod
    def at_least(cls, limit: float) -> Goal:
        """No less than that."""
        return cls(low=limit)

    def is_met(self, value: float) -> bool:
        """Whether a value lies within; one that is not finite does not."""
        return bool(np.isfinite(value) and self.low <= value <= self.high)

    def badness(self, value: float) -> float:
        """The larger the worse: to compare estimators and vehicles by."""
        if not np.isfinite(value):
            return np.inf
        if np.isfinite(self.low) and np.isfinite(self.high):
            return abs(value - 0.5 * (self.low + self.high))
        return value if np.isfinite(self.high) else -value

    def __str__(self) -> str:
        if np.isfinite(self.low) and np.isfinite(self.high):
            return f"{self.low:g}–{self.high:g}"
        return f"≤ {self.high:g}" if np.isfinite(self.high) else f"≥ {self.low:g}"


@dataclass(frozen=True)
class Score:
    """A figure of an estimator.

    Attributes:
        group: of figures it belongs to.
        what: the figure, in words; the same for all estimators.
        estimator: its name.
        unit: of the figure.
        goal: for it, if there is one.
        vehicles: vehicle → the figure over all its seeds.
        seeds: vehicle → the figure of each seed; NaN where it has none.
        bounds: vehicle → the least that any estimator could reach, where computed.
    """

    group: str
    what: str
    estimator: str
    unit: str
    goal: Goal | None
    vehicles: Mapping[str, float]
    seeds: Mapping[str, Array]
    bounds: Mapping[str, float] = field(default_factory=dict)

    @property
    def value(self) -> float:
        """The mean of the vehicles' figures; NaN where one of them has none."""
        return float(np.mean(list(self.vehicles.values()))) if self.vehicles else float("nan")

    @property
    def spread(self) -> tuple[float, float]:
        """5th and 95th percentile of all seeds' figures; NaN where there are none."""
        every = np.concatenate([np.asarray(v, float) for v in self.seeds.values()] or [np.zeros(0)])
        every = every[np.isfinite(every)]
        if not len(every):
            return float("nan"), float("nan")
        low, high = np.percentile(every, (5, 95))
        return float(low), float(high)

    @property
    def worst(self) -> tuple[str, float]:
        """The vehicle farthest from the goal, and its figure."""
        judge = self.goal or Goal.at_most(np.inf)
        name = max(self.vehicles, key=lambda v: judge.badness(self.vehicles[v]))
        return name, self.vehicles[name]

    @property
    def bound(self) -> float | None:
        """The mean of the vehicles' bounds."""
        return float(np.mean(list(self.bounds.values()))) if self.bounds else None

    @property
    def verdict(self) -> str:
        """``met``, ``met*`` where some vehicle misses it, or ``missed``; empty without a goal."""
        if self.goal is None:
            return ""
        if not self.goal.is_met(self.value):
            return "missed"
        return "met" if all(map(self.goal.is_met, self.vehicles.values())) else "met*"

    def to_json(self) -> dict[str, object]:
        """The same in plain types; numbers that are not finite as ``None``."""

        def plain(value: float | None) -> float | None:
            return float(value) if value is not None and np.isfinite(value) else None

        return {
            "group": self.group,
            "what": self.what,
            "estimator": self.estimator,
            "unit": self.unit,
            "goal": None if self.goal is None else str(self.goal),
            "value": plain(self.value),
            "spread": [plain(v) for v in self.spread],
            "vehicles": {name: plain(value) for name, value in self.vehicles.items()},
            "seeds": {name: [plain(v) for v in values] for name, values in self.seeds.items()},
            "bound": plain(self.bound),
            "verdict": self.verdict,
        }
