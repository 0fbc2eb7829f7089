"""Learning a car from its logs: figures of the vehicle file and noise levels by an estimator's likelihood."""

from roadstate.calibration.fit import DEFAULT_ESTIMATOR, Calibration, Learned, calibrate
from roadstate.calibration.parameters import GROUPS, select
from roadstate.calibration.write import learned_yaml

__all__ = [
    "DEFAULT_ESTIMATOR",
    "GROUPS",
    "Calibration",
    "Learned",
    "calibrate",
    "learned_yaml",
    "select",
]
