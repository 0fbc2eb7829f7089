"""Filters: one file, one method. They know no vehicle. A :class:`Filter` with a name is found."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from typing import Any

from roadstate.filters.adaptive import AdaptiveEKF, AdaptiveNoise, AdaptiveState, AdaptiveUKF
from roadstate.filters.averages import Forgetting, Window
from roadstate.filters.base import Filter, FilterState, GateRule, GaussianFilter
from roadstate.filters.constraints import Bounded, project, truncate
from roadstate.filters.ekf import EKF, IteratedEKF
from roadstate.filters.fading import StrongTracking
from roadstate.filters.fuzzy import FuzzyNoise
from roadstate.filters.hinfinity import ExtendedHInfinity, HInfinityState
from roadstate.filters.kf import KF
from roadstate.filters.limited_memory import LimitedMemoryEKF, LimitedMemoryState
from roadstate.filters.ukf import UKF

__all__ = [
    "EKF",
    "KF",
    "UKF",
    "AdaptiveEKF",
    "AdaptiveNoise",
    "AdaptiveState",
    "AdaptiveUKF",
    "Bounded",
    "ExtendedHInfinity",
    "Filter",
    "FilterState",
    "Forgetting",
    "FuzzyNoise",
    "GateRule",
    "GaussianFilter",
    "HInfinityState",
    "IteratedEKF",
    "LimitedMemoryEKF",
    "LimitedMemoryState",
    "StrongTracking",
    "Window",
    "all_filters",
    "project",
    "truncate",
]


@cache
def all_filters() -> dict[str, type[Filter[Any]]]:
    """Every filter class by name, in alphabetical order."""
    found: dict[str, type[Filter[Any]]] = {}
    for module in pkgutil.iter_modules(__path__, f"{__name__}."):
        for value in vars(importlib.import_module(module.name)).values():
            if isinstance(value, type) and issubclass(value, Filter) and "name" in vars(value):
                found[value.name] = value
    return dict(sorted(found.items()))
