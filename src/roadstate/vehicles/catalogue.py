"""The vehicle models there are: one file, one model; a module that defines one with a name is found."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from roadstate import vehicles
from roadstate.vehicles.model import VehicleModel


@cache
def vehicle_models() -> dict[str, type[VehicleModel]]:
    """Every vehicle model class by name, in alphabetical order."""
    found: dict[str, type[VehicleModel]] = {}
    for module in pkgutil.iter_modules(vehicles.__path__, f"{vehicles.__name__}."):
        for value in vars(importlib.import_module(module.name)).values():
            if isinstance(value, type) and issubclass(value, VehicleModel) and "name" in vars(value):
                found[value.name] = value
    return dict(sorted(found.items()))
