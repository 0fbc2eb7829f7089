"""Simulated drives: roads, plants, drivers and manoeuvres, sensors; and the point-mass model of the demo.

The names below are loaded when first used, so that importing this package does not import JAX.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from roadstate.lazy import lazily

if TYPE_CHECKING:
    from roadstate.sim.drive import Truth, follow
    from roadstate.sim.driver import Driver
    from roadstate.sim.longitudinal import LongitudinalPlant
    from roadstate.sim.roads.grade import GradeProfile, interchange_ramp
    from roadstate.sim.scenario import simulate
    from roadstate.sim.sensors.noise import SensorNoise
    from roadstate.sim.sensors.suite import measure
    from roadstate.sim.speed_plan import SpeedPlan

_HOME = {
    "Driver": "driver",
    "GradeProfile": "roads.grade",
    "LongitudinalPlant": "longitudinal",
    "SensorNoise": "sensors.noise",
    "SpeedPlan": "speed_plan",
    "Truth": "drive",
    "follow": "drive",
    "interchange_ramp": "roads.grade",
    "measure": "sensors.suite",
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

__getattr__ = lazily(__name__, _HOME)
