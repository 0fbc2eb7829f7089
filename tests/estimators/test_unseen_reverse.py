"""A car that backs out while neither its gear nor the wheels' sign tells of it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from roadstate.core import Log
from roadstate.core.channels import WHEELS
from roadstate.estimators import build
from roadstate.run import scan
from roadstate.vehicles import Vehicle


@pytest.mark.parametrize("grade", [-0.05, 0.0, 0.05])
def test_wheels_at_rest_are_believed_again(vehicle: Vehicle, drive: Callable[..., Log], grade: float) -> None:
    """What was taken for a slope must not drive the standing car away, as if its wheels were locked."""
    time = np.arange(0, 45, 0.01)
    speed = np.interp(time, [0, 3, 6, 25, 28, 45], [0.0, 0, -2, -2, 0, 0])
    log = drive(speed, np.full(len(time), grade))
    rng = np.random.default_rng(1)
    wheels = {
        f"wheel_speed_{w}": np.abs(log[f"wheel_speed_{w}"] + rng.normal(0, 0.03, len(time)) * (speed < -0.1))
        for w in WHEELS
    }
    accel = {"accel_x": log["accel_x"] + rng.normal(0, 0.08, len(time))}
    said = scan(build("joint", vehicle, (*wheels, *accel)), Log(time, {**wheels, **accel}))
    assert np.max(np.abs(said.values["speed"])) < 3.0
    rested = time > 38
    assert np.max(np.abs(said.values["speed"][rested])) < 0.4
    error = np.abs(said.values["grade"] - np.sin(grade))[time > 44]
    assert np.max(error / said.std["grade"][time > 44]) < 3
