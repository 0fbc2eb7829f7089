"""Filters: one file, one method. They know no vehicle. A :class:`Filter` with a name is found."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from typing import Any

from roadstate.filters.base import Filter, FilterState, GateRule, GaussianFilter
from roadstate.filters.kf import KF
from roadstate.filters.ukf import UKF

__all__ = ["KF", "UKF", "Filter", "FilterState", "GateRule", "GaussianFilter", "all_filters"]


@cache
def all_filters() -> dict[str, type[Filter[Any]]]:
    """Every filter class by name, in alphabetical order."""
    found: dict[str, type[Filter[Any]]] = {}
    for module in pkgutil.iter_modules(__path__, f"{__name__}."):
        for value in vars(importlib.import_module(module.name)).values():
            if isinstance(value, type) and issubclass(value, Filter) and "name" in vars(value):
                found[value.name] = value
    return dict(sorted(found.items()))
