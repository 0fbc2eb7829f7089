"""What a car's sensors say, held, low-passed and foreseen, where some of them are silent for a while."""

from __future__ import annotations

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.core import WHEELS
from roadstate.estimators.intake import SPIN, YAW_RATE, Intake, Signals
from roadstate.vehicles import Vehicle

STEP = 0.01
SPINS = tuple(f"wheel_speed_{w}" for w in WHEELS)
Speed = Callable[[float], float]


def read(vehicle: Vehicle, speed: Speed, yaw_rate: Speed, lost: tuple[str, ...], until: float) -> Signals:
    """At ``until``, the end of three seconds in which channels were lost; sensors without noise."""
    intake = Intake(vehicle, ("accel_x", "accel_y", "yaw_rate", "steer", *SPINS))
    step = eqx.filter_jit(intake.read)
    state = intake.init()
    for k in range(round(until / STEP) + 1):
        now = k * STEP
        sample = dict.fromkeys(SPINS, speed(now) / vehicle.wheels.radius)
        sample |= {"accel_x": -3.0, "accel_y": 0.0, "yaw_rate": yaw_rate(now), "steer": 0.0}
        if until - 3.0 < now < until - STEP / 2:
            sample |= dict.fromkeys(lost, np.nan)
        arrays = {channel: jnp.asarray(value) for channel, value in sample.items()}
        state, signals = step(state, arrays, jnp.asarray(speed(now)), jnp.asarray(STEP))
    return signals


def test_wheels_that_come_back_have_not_stopped_meanwhile(vehicle: Vehicle) -> None:
    """What was 3 s ago is no part of what a wheel does now, nor of how it changes."""
    signals = read(vehicle, lambda t: 30 - 3 * t, lambda t: 0.0, SPINS, 5.0)
    for rims in (signals.smooth[SPIN], signals.now[SPIN]):
        np.testing.assert_allclose(vehicle.wheels.radius * rims, 15.0, atol=0.01)
    for rates in (signals.rate[SPIN], signals.now_rate[SPIN]):
        np.testing.assert_allclose(rates, 0.0, atol=1e-9)


def test_a_bend_that_begins_unseen_is_no_jerk(vehicle: Vehicle) -> None:
    signals = read(vehicle, lambda t: 20.0, lambda t: 0.3 * (t > 3), ("yaw_rate",), 5.0)
    assert float(signals.smooth[YAW_RATE]) == pytest.approx(0.3)
    assert float(signals.now_rate[YAW_RATE]) == pytest.approx(0.0, abs=1e-9)
    assert float(signals.rate[YAW_RATE]) == pytest.approx(0.0, abs=1e-9)
