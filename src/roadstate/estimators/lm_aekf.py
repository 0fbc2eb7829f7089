"""Friction by the limited-memory adaptive extended Kalman filter (paper 004)."""

from __future__ import annotations

from typing import Any, ClassVar

from roadstate.estimators.base import with_options
from roadstate.estimators.friction import FrictionEstimator, Settings
from roadstate.filters import GateRule, LimitedMemoryEKF
from roadstate.filters.base import Filter
from roadstate.filters.fuzzy import FuzzyNoise

PRINTED = Settings("four", 0.5, 0.0, 1e-3, 0.0, 0.0, 10**-4.5, 1e-2, uses_rate=False, direct=True)
"""Paper 004 §4: P0 = 10⁻⁶ I, Q = 10⁻⁹ I a step, R = 10⁻⁴ I; x0 is lost, 0.5 is chosen."""


class LimitedMemoryFriction(FrictionEstimator):
    """Peak friction by limited memory, a fading factor and fuzzy noise adaptation (paper 004 §3).

    ``as_printed``: four wheels of a_x, a_y and ṙ, Q = 10⁻⁹ I a step, P0 = 10⁻⁶ I, R = 10⁻⁴ I.
    ``filter_options`` are those of :class:`roadstate.filters.LimitedMemoryEKF`; each of its ideas can be
    left out (``memory=None``, ``fading=None``, ``fuzzy=None``).
    """

    name: ClassVar[str] = "lm-aekf"
    summary: ClassVar[str] = "peak friction by limited memory, fading and fuzzy noise (LM-AEKF)"

    @classmethod
    def printed(cls) -> Settings:
        """Paper 004 §4."""
        return PRINTED

    @classmethod
    def make_filter(cls, settings: Settings, *, as_printed: bool, **options: Any) -> Filter[Any]:
        """The limited-memory filter.

        Where R holds errors that last, innovations are smaller than it from sample to sample, and mean
        nothing by that: then fuzzy adaptation may only raise it, and old samples are forgotten only where
        new ones know as much. A single wild sample is refused; the fourth in a row is believed, for it may be
        another road.
        """
        usual: dict[str, Any] = {}
        if settings.sensor_std is None:
            gate = GateRule(patience=3)
            usual = {"memory": 100, "least_share": 0.5, "fuzzy": FuzzyNoise(floor=1.0), "gate": gate}
        return with_options(LimitedMemoryEKF, usual | options)
