"""Simulated drives: for now a longitudinal point-mass model on a graded road.

The names below are loaded when first used, so that importing this package does not import JAX.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from roadstate.sim.drive import SpeedPlan, Truth, follow
    from roadstate.sim.driver import Driver
    from roadstate.sim.longitudinal import LongitudinalPlant
    from roadstate.sim.road import GradeProfile, interchange_ramp
    from roadstate.sim.scenario import simulate
    from roadstate.sim.sensors import SensorNoise, measure

_HOME = {
    "Driver": "driver",
    "GradeProfile": "road",
    "LongitudinalPlant": "longitudinal",
    "SensorNoise": "sensors",
    "SpeedPlan": "drive",
    "Truth": "drive",
    "follow": "drive",
    "interchange_ramp": "road",
    "measure": "sensors",
    "simulate": "scenario",
}

__all__ = [
    "Driver",
    "GradeProfile",
    "LongitudinalPlant",
    "SensorNoise",
    "SpeedPlan",
    "Truth",
    "follow",
    "interchange_ramp",
    "measure",
    "simulate",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
