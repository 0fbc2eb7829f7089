"""An accelerometer whose bias the vehicle file knows of, as of a phone in a holder."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from roadstate.calibration.parameters import with_value
from roadstate.core import Log
from roadstate.estimators import build
from roadstate.run import scan
from roadstate.vehicles import Vehicle


@pytest.mark.parametrize(("stated", "is_accused"), [(1.0, False), (0.1, True)])
def test_a_bias_that_the_file_allows_is_no_lie(
    vehicle: Vehicle, drive: Callable[..., Log], stated: float, is_accused: bool
) -> None:
    """Wheels and torques both contradict it, by 1.5 m/s²: one and a half of its σ, or fifteen."""
    time = np.arange(0, 40, 0.01)
    speed = 12 + 6 * np.sin(0.4 * time)
    log = drive(speed, np.zeros(len(time)), accel_bias=-1.5)
    channels = sorted(log.available)
    noise = {"accel_x": 0.08, **{c: 0.03 for c in channels if c.startswith("wheel_speed")}}
    estimator = build("joint", with_value(vehicle, ("sensors", "accel", "bias"), stated), channels)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        noisy = {c: log[c] + rng.normal(0, noise.get(c, 1.0), len(time)) for c in channels}
        faults = scan(estimator, Log(time, noisy)).metadata["faults"]
        assert ("accel_x" in {fault["fault"].split(":")[0] for fault in faults}) is is_accused
