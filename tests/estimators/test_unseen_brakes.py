"""Drives of a car whose torque is known while nothing tells of its brakes."""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import Log
from roadstate.estimators import build
from roadstate.estimators.signals import Held
from roadstate.estimators.traction import BrakeWatch
from roadstate.run import scan
from roadstate.vehicles import Vehicle

DT = 0.01
Array = NDArray[np.float64]


def watched(*parts: tuple[float, float, float], forward: float = 1.0) -> BrakeWatch:
    """After parts of a drive: s, specific force, what the drive makes of it (m/s²)."""
    watch = BrakeWatch.none()
    for seconds, accel, push in parts:
        for _ in range(round(seconds / DT)):
            held = Held(jnp.asarray(accel), jnp.zeros(()))
            watch = watch.take(held, *map(jnp.asarray, (push, push, forward, DT)))
    return watch


@pytest.mark.parametrize(
    ("parts", "seems", "possible"),
    [
        ([(0.2, 1.0, 1.0)], False, True),  # the log has just begun
        ([(2.0, 1.0, 1.0)], False, False),
        ([(2.0, 1.0, 1.0), (0.02, -0.6, 0.0)], False, True),  # a brake begins
        ([(2.0, 1.0, 1.0), (0.5, -0.6, 0.0)], True, True),
        ([(2.0, 1.0, 1.0), (0.5, 0.0, 0.0)], False, False),  # it coasts
        ([(2.0, 0.0, 0.0)], False, True),  # it has done so from the first sample, or dragged a brake
        ([(2.0, -0.5, 0.0)], True, True),
        ([(2.0, -0.5, 0.0), (1.0, 0.8, 0.8)], False, False),  # it drives off
        ([(2.0, 0.2, 0.2)], False, False),  # at constant speed
        ([(2.0, -1.0, -1.0)], False, False),  # in reverse
        ([(2.0, 0.0, 1.0)], True, True),  # with both feet
    ],
)
def test_when_brakes_seem_or_may_act(
    parts: list[tuple[float, float, float]], seems: bool, possible: bool
) -> None:
    watch = watched(*parts)
    assert (bool(watch.seems), bool(watch.possible)) == (seems, possible)


def test_brakes_push_ahead_a_car_that_backs_up() -> None:
    parts = [(2.0, -1.0, -1.0), (0.5, 0.6, 0.0)]
    assert bool(watched(*parts, forward=-1.0).seems)
    assert not bool(watched(*parts).seems)


@pytest.mark.parametrize("name", ["joint", "tfobe", "debe"])
@pytest.mark.parametrize("brake", [0.15, 0.7])
def test_brakes_that_nothing_tells_of_are_no_bias_and_no_slope(
    vehicle: Vehicle, drive: Callable[..., Log], name: str, brake: float
) -> None:
    """The log begins under brakes, gentle or not, of which the accelerometer could be blamed."""
    gains = np.repeat([-brake, 0.0, 0.8, 0.3, -brake, 0.6], 700)
    speed = 15 + np.cumsum(gains) * DT
    log = drive(speed, np.full(len(speed), 0.02))
    rng = np.random.default_rng(1)
    seen = {c: v for c, v in log.channels.items() if "brake" not in c}
    seen |= {c: 0.001 * rng.standard_normal(len(speed)) for c in ("accel_y", "yaw_rate", "steer")}
    seen["accel_x"] = seen["accel_x"] + 0.02 * rng.standard_normal(len(speed))
    log = Log(log.time, seen)
    found = scan(build(name, vehicle, log.available), log)
    error, std = found.values["grade"] - 0.02, found.std["grade"]
    assert np.mean((np.abs(error) < 2 * std)[log.time > 1]) > 0.98
    assert np.abs(error)[log.time > 21].max() < {"joint": 0.004, "tfobe": 0.02, "debe": 0.06}[name]
