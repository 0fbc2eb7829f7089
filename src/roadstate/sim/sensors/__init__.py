"""Sensors: from the truth of a drive to what a car records. Names are imported when first used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from roadstate.lazy import lazily

if TYPE_CHECKING:
    from roadstate.sim.sensors.faults import KINDS, Fault, inject
    from roadstate.sim.sensors.inertial import InertialUnit
    from roadstate.sim.sensors.noise import SensorNoise
    from roadstate.sim.sensors.presets import PRESETS, sensor_preset
    from roadstate.sim.sensors.probe import Probe
    from roadstate.sim.sensors.satellite import SatelliteReceiver
    from roadstate.sim.sensors.suite import SensorSuite, measure, to_log
    from roadstate.sim.sensors.wheel_pulses import ToothSensor

_HOME = {
    "KINDS": "faults",
    "PRESETS": "presets",
    "Fault": "faults",
    "InertialUnit": "inertial",
    "Probe": "probe",
    "SatelliteReceiver": "satellite",
    "SensorNoise": "noise",
    "SensorSuite": "suite",
    "ToothSensor": "wheel_pulses",
    "inject": "faults",
    "measure": "suite",
    "sensor_preset": "presets",
    "to_log": "suite",
}

__all__ = [
    "KINDS",
    "PRESETS",
    "Fault",
    "InertialUnit",
    "Probe",
    "SatelliteReceiver",
    "SensorNoise",
    "SensorSuite",
    "ToothSensor",
    "inject",
    "measure",
    "sensor_preset",
    "to_log",
]

__getattr__ = lazily(__name__, _HOME)
