"""Friction by an unscented Kalman filter (paper 003)."""

from __future__ import annotations

from typing import Any, ClassVar

from roadstate.estimators.base import with_options
from roadstate.estimators.friction import FrictionEstimator, Settings
from roadstate.filters import UKF, GateRule
from roadstate.filters.base import Filter


class FrictionUKF(FrictionEstimator):
    """Peak friction by an unscented Kalman filter (paper 003, eqs. 25–37).

    ``as_printed``: four wheels, x0 = 1, P0 = I, Q = 0.01 I a step, R = I, of a_x, a_y and ṙ.
    """

    name: ClassVar[str] = "friction-ukf"
    summary: ClassVar[str] = "peak friction from slips and accelerations (UKF)"

    @classmethod
    def printed(cls) -> Settings:
        """Paper 003 §5.1."""
        return Settings("four", 1.0, 0.0, 1.0, 0.0, 0.0, 0.1, 1.0, uses_rate=False, direct=True)

    @classmethod
    def make_filter(cls, settings: Settings, *, as_printed: bool, **options: Any) -> Filter[Any]:
        """The unscented filter."""
        return with_options(UKF, {"gate": None if as_printed else GateRule()} | options)
