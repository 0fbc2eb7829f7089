"""Filters: one file, one method. They know no vehicle."""

from roadstate.filters.base import Filter, FilterState, GateRule, GaussianFilter
from roadstate.filters.kf import KF
from roadstate.filters.ukf import UKF

__all__ = ["KF", "UKF", "Filter", "FilterState", "GateRule", "GaussianFilter"]
