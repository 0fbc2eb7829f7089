"""A car that sets off gently, straight on: no tire tells anything of the road yet."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from roadstate.core import WHEELS, Log
from roadstate.estimators import build
from roadstate.run import scan
from roadstate.vehicles import Vehicle


@pytest.mark.usefixtures("optimised")
@pytest.mark.parametrize("bias", [-0.012, 0.012])
def test_a_sideslip_that_is_being_found_refutes_no_ice(
    bias: float, vehicle: Vehicle, drive: Callable[..., Log]
) -> None:
    """By a gyroscope's bias the car seems to slide as it passes walking pace, by as much as ice bears, and
    under a low friction nothing seemed to put that right."""
    time = np.arange(0, 25, 0.01)
    log = drive(np.interp(time, [0, 4, 20, 25], [1.8, 1.8, 6.0, 6.0]), np.zeros(len(time)))
    rng = np.random.default_rng(1)
    noise = {"accel_x": 0.08, "accel_y": 0.08, "yaw_rate": 0.003, "steering_wheel": 0.01}
    noise |= dict.fromkeys((f"wheel_speed_{w}" for w in WHEELS), 0.05)
    channels = {n: v for n, v in log.channels.items() if not n.startswith("ref")}
    still = np.zeros(len(time))
    channels |= {"accel_y": still, "yaw_rate": still + bias, "steering_wheel": still}
    channels = {n: v + rng.normal(0, noise.get(n, 5.0), len(time)) for n, v in channels.items()}
    values = scan(build("joint", vehicle, channels), Log(time, channels)).values
    assert values["friction_peak_lower"].max() < 0.12
    assert np.abs(values["velocity_y"]).max() < 0.06
