"""A car of which no speed is heard for a while, and which stops meanwhile."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from roadstate.core import WHEELS, Log
from roadstate.estimators import build
from roadstate.run import scan
from roadstate.vehicles import Vehicle


@pytest.mark.usefixtures("optimised")
@pytest.mark.parametrize("drift", [-0.15, 0.1])
def test_brakes_that_hold_a_car_do_not_push_it(
    drift: float, vehicle: Vehicle, drive: Callable[..., Log]
) -> None:
    """Whether it still rolls, or backward, nobody knows then: they passed for a bias of the accelerometer."""
    time = np.arange(0, 40, 0.01)
    speed = np.interp(time, [0, 12, 17, 30, 40], [15.0, 15.0, 0.0, 0.0, 15.0])
    log = drive(speed, np.full(len(time), 0.03))
    rng = np.random.default_rng(1)
    noise = {name: rng.normal(0, 0.05, len(time)) for name in ("accel_x", *log.channels)}
    silent, stands = (time > 5) & (time < 29), (time > 17) & (time < 30)
    channels = {name: v + noise[name] for name, v in log.channels.items() if not name.startswith("ref")}
    channels["accel_x"] = channels["accel_x"] + np.where(time > 5, drift, 0.0)
    for wheel in WHEELS:
        channels[f"wheel_speed_{wheel}"] = np.where(silent, np.nan, channels[f"wheel_speed_{wheel}"])
        channels[f"brake_torque_{wheel}"] = channels[f"brake_torque_{wheel}"] + np.where(stands, 800.0, 0.0)
    found = scan(build("joint", vehicle, channels), Log(time, channels))
    assert np.abs(found.values["accel_x_bias"] - drift)[time > 5].max() < 0.25
    lost = found.values["grade"] - 0.03
    assert (np.abs(lost) < 2.5 * found.std["grade"])[time > 5].all()
    assert np.abs(lost[time > 31]).max() < 0.02
