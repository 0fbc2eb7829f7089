"""An accelerometer whose bias the vehicle file knows of, as of a phone in a holder."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from roadstate.core import Log
from roadstate.estimators import build
from roadstate.run import scan
from roadstate.vehicles import Vehicle


@pytest.mark.parametrize(("stated", "is_accused"), [(0.7, False), (0.1, True)])
def test_a_bias_that_the_file_allows_is_no_lie(
    vehicle: Vehicle, drive: Callable[..., Log], stated: float, is_accused: bool
) -> None:
    """Wheels and torques both contradict it, by 1 m/s²: one and a half of its σ, or ten."""
    time = np.arange(0, 40, 0.01)
    speed = 12 + 6 * np.sin(0.4 * time)
    log = drive(speed, np.zeros(len(time)), accel_bias=-1.0)
    rng = np.random.default_rng(1)
    noise = {"accel_x": 0.08, **{c: 0.03 for c in log.available if c.startswith("wheel_speed")}}
    noisy = {c: log[c] + rng.normal(0, noise.get(c, 1.0), len(time)) for c in log.available}
    accel = vehicle.sensors.accel.model_copy(update={"bias": stated})
    sensors = vehicle.sensors.model_copy(update={"accel": accel})
    car = vehicle.model_copy(update={"sensors": sensors})
    said = scan(build("joint", car, tuple(noisy)), Log(time, noisy))
    accused = {fault["fault"].split(":")[0] for fault in said.metadata["faults"]}
    assert ("accel_x" in accused) is is_accused
