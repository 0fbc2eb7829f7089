"""Friction by an extended Kalman filter: the plain rival of papers 003 and 004."""

from __future__ import annotations

from typing import Any, ClassVar

from roadstate.estimators.base import with_options
from roadstate.estimators.friction import FrictionEstimator, Settings
from roadstate.estimators.lm_aekf import PRINTED
from roadstate.filters import EKF, GateRule
from roadstate.filters.base import Filter


class FrictionEKF(FrictionEstimator):
    """Peak friction by an extended Kalman filter, against which paper 004 sets its own.

    ``as_printed``: the settings of :class:`~roadstate.estimators.lm_aekf.LimitedMemoryFriction` without its
    three ideas.
    """

    name: ClassVar[str] = "friction-ekf"
    summary: ClassVar[str] = "peak friction from slips and accelerations (EKF)"

    @classmethod
    def printed(cls) -> Settings:
        """Paper 004 §4."""
        return PRINTED

    @classmethod
    def make_filter(cls, settings: Settings, *, as_printed: bool, **options: Any) -> Filter[Any]:
        """The extended filter."""
        return with_options(EKF, {"gate": None if as_printed else GateRule()} | options)
