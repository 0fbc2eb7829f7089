"""What a car is: its parameters, read from a vehicle file or taken from the presets.

The names below are loaded when first used, so that importing this package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from roadstate.vehicles.library import VehicleSummary, json_schema, load_vehicle, parse_vehicle, presets
    from roadstate.vehicles.parameters import Vehicle

_HOME = {
    "Vehicle": "parameters",
    "VehicleSummary": "library",
    "json_schema": "library",
    "load_vehicle": "library",
    "parse_vehicle": "library",
    "presets": "library",
}

__all__ = ["Vehicle", "VehicleSummary", "json_schema", "load_vehicle", "parse_vehicle", "presets"]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
