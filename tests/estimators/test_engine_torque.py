"""An engine's torque that is told too high or too low by the same in every gear."""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.core import Log
from roadstate.core.channels import WHEELS
from roadstate.estimators import build
from roadstate.estimators.along import AlongModel
from roadstate.run import scan
from roadstate.vehicles import Vehicle

pytestmark = pytest.mark.usefixtures("optimised")

DT = 0.01
GRADE = 0.02
GEARS = (0, 5, 2, 3, 1, 4)


def by_engine(vehicle: Vehicle, drive: Callable[..., Log], told: float) -> Log:
    """Gear after gear uphill, the engine's torque told by so many N·m too high."""
    gain = np.tile(np.repeat([0.6, 0.0, -0.4, -0.2], 400), 6)
    gear = np.array(vehicle.driveline.gear_ratios)[np.repeat(GEARS, 1600)]
    speed = 12 + np.cumsum(gain) * DT
    log = drive(speed, np.full(len(speed), GRADE))
    line, radius = vehicle.driveline, vehicle.wheels.radius
    at_wheels = sum(log[f"drive_torque_{w}"] for w in WHEELS[:2]) - sum(
        log[f"brake_torque_{w}"] for w in WHEELS
    )
    ratio = gear * line.final_drive
    at_wheels = at_wheels + line.engine_inertia * ratio**2 * gain / radius
    engine = at_wheels / ratio / np.where(at_wheels > 0, line.efficiency, 1 / line.efficiency)
    rng = np.random.default_rng(2)
    seen = {c: v for c, v in log.channels.items() if "torque" not in c}
    seen["accel_x"] = seen["accel_x"] + 0.03 * rng.standard_normal(len(speed))
    return Log(log.time, seen | {"engine_torque": engine + told, "gear_ratio": gear})


@pytest.mark.parametrize("told", [-6.0, 6.0])
def test_a_torque_that_is_off_is_told_from_a_slope_by_the_gears(
    vehicle: Vehicle, drive: Callable[..., Log], told: float
) -> None:
    """Low gears multiply it, which neither a slope nor rolling resistance does."""
    log = by_engine(vehicle, drive, told)
    found = scan(build("joint", vehicle, log.available), log)
    error, std = found.values["grade"] - GRADE, found.std["grade"]
    late = log.time > 48
    assert np.mean((np.abs(error) < 2 * std)[log.time > 1]) > 0.95
    assert np.sqrt(np.mean(error[late] ** 2)) < 0.002


@pytest.mark.parametrize("load", [-0.2, 0.5])
def test_a_load_turns_up_no_engine(vehicle: Vehicle, drive: Callable[..., Log], load: float) -> None:
    """Else a load would seem to be less than it is: in low gears much of the torque turns up the engine."""
    log = by_engine(vehicle, drive, 0.0)
    prior = vehicle.prior.model_copy(update={"mass_relative": 0.3})
    torque = vehicle.sensors.engine_torque.model_copy(update={"relative": 0.005})
    sensors = vehicle.sensors.model_copy(update={"engine_torque": torque})
    file = {"mass": vehicle.mass / (1 + load), "prior": prior, "sensors": sensors}
    found = scan(build("joint", vehicle.model_copy(update=file), log.available), log)
    assert found.values["mass"][-1] == pytest.approx(vehicle.mass, rel=0.01)


def test_only_an_engine_has_gears_that_multiply_it(vehicle: Vehicle) -> None:
    wheels = ("accel_x", "wheel_speed_rl", *(f"drive_torque_{w}" for w in WHEELS))
    assert "torque_zero" not in AlongModel(vehicle, wheels, torque_of="wheels").states
    engine = AlongModel(vehicle, ("accel_x", "wheel_speed_rl", "engine_torque"), torque_of="engine")
    place = engine.place("torque_zero")
    assert engine.prior().std[place] == pytest.approx(vehicle.sensors.engine_torque.bias)
    assert jnp.count_nonzero(engine.slow_factor[place - 3]) == 1


def test_half_of_a_driven_axle_leaves_the_engine_to_tell(vehicle: Vehicle) -> None:
    """A torque of one of two driven wheels is not the force, so gains and errors are the engine's."""
    rears = ["wheel_speed_rl", "wheel_speed_rr"]
    channels = ["accel_x", *rears, "engine_torque", "gear_ratio", "drive_torque_fl"]
    assert "torque_zero" in build("joint", vehicle, channels).along.states
    assert "torque_zero" not in build("joint", vehicle, [*channels, "drive_torque_fr"]).along.states
