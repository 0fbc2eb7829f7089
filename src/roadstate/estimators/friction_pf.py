"""Friction by a particle filter (paper 003)."""

from __future__ import annotations

from typing import Any, ClassVar

from roadstate.estimators.base import with_options
from roadstate.estimators.friction import FrictionEstimator, Settings
from roadstate.filters.base import Filter
from roadstate.filters.jitter import Regularization
from roadstate.filters.particle import ParticleFilter


class FrictionPF(FrictionEstimator):
    """Peak friction by a bootstrap particle filter (paper 003 §4).

    ``as_printed``: four wheels, x0 = 1, P0 = I, Q = 0.01 I a step, R = I, of a_x, a_y and ṙ; 500 particles
    and resampling below half of them are chosen, for the paper prints neither.
    """

    name: ClassVar[str] = "friction-pf"
    summary: ClassVar[str] = "peak friction from slips and accelerations (particle filter)"

    @classmethod
    def printed(cls) -> Settings:
        """Paper 003 §5.1."""
        return Settings("four", 1.0, 0.0, 1.0, 0.0, 0.0, 0.1, 1.0, uses_rate=False, direct=True)

    @classmethod
    def usual(cls) -> Settings:
        """Particles cannot follow a yaw rate that is measured far better than it is predicted."""
        return Settings(uses_rate=False)

    @classmethod
    def make_filter(cls, settings: Settings, *, as_printed: bool, **options: Any) -> Filter[Any]:
        """The particle filter."""
        usual: dict[str, Any] = {"particles": 500}
        if not as_printed:
            usual["jitter"] = Regularization()
        return with_options(ParticleFilter, usual | options)
