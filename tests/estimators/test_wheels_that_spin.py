"""A wheel that spins on ice is no sensor that lies, however long it takes to roll again."""

from __future__ import annotations

import numpy as np
import pytest

from roadstate.core import WHEELS, Log, Validity
from roadstate.core.constants import GRAVITY
from roadstate.estimators import Estimator, build
from roadstate.run import scan
from roadstate.vehicles import Vehicle

RATE = 100.0
TIME = np.arange(2400) / RATE
SPEED = 10 + 0.3 * TIME
SPINS = np.interp(TIME, [4, 8, 16, 19], [0, 20, 20, 0])  # m/s by which the left front wheel is too fast
ICE = 0.09  # of its load is what the wheel's torque was as it began to spin
SUSTAINED = 0.06  # and what it is later


@pytest.fixture(scope="module")
def estimator(vehicle: Vehicle) -> Estimator:
    wheels = [f"wheel_speed_{w}" for w in WHEELS]
    return build("joint", vehicle, [*wheels, *(f"drive_torque_{w}" for w in WHEELS), "accel_x"])


def log(vehicle: Vehicle, spins: np.ndarray, over_load: np.ndarray) -> Log:
    """Of a car with front-wheel drive, whose left front wheel is too fast, on as steep a road as that takes.

    Args:
        vehicle: the car.
        spins: m/s by which that wheel is.
        over_load: torque of the front wheels, over radius and a quarter of the weight.
    """
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(6, len(TIME)))
    drag = 0.5 * vehicle.aerodynamics.air_density * vehicle.drag_area * SPEED**2
    felt = GRAVITY * (0.5 * over_load - vehicle.rolling_resistance.coefficient) - drag / vehicle.mass
    leaning = felt * (1 + GRAVITY * vehicle.body.pitch_gradient)
    channels = {"accel_x": leaning + 0.05 * noise[4], "ref_velocity_x": SPEED}
    for i, wheel in enumerate(WHEELS):
        rim = SPEED + (spins if wheel == "fl" else 0.0)
        channels[f"wheel_speed_{wheel}"] = rim / vehicle.wheels.radius + 0.05 * noise[i]
        force = 0.25 * vehicle.mass * GRAVITY * over_load
        drives = wheel.startswith("f")
        channels[f"drive_torque_{wheel}"] = vehicle.wheels.radius * force * drives + noise[5]
    return Log(TIME, channels)


def accused(estimator: Estimator, given: Log) -> list[str]:
    """What is said to lie."""
    said = scan(estimator, given)
    assert np.abs(said.values["speed"] - SPEED)[TIME > 1].max() < 0.5
    faults = [fault["fault"].split(":")[0] for fault in said.metadata.get("faults", [])]
    assert bool(faults) == bool(np.any(said.validity == int(Validity.SENSOR_FAULT)))
    return faults


def test_a_wheel_spins_for_as_long_as_less_torque_holds_it(vehicle: Vehicle, estimator: Estimator) -> None:
    torque = np.where((TIME > 3.5) & (TIME < 8), ICE, SUSTAINED)
    assert accused(estimator, log(vehicle, SPINS, torque)) == []


def test_a_wheel_may_take_its_time_to_roll_again(vehicle: Vehicle, estimator: Estimator) -> None:
    torque = np.where((TIME > 3.5) & (TIME < 13), ICE, 0.02)
    assert accused(estimator, log(vehicle, SPINS, torque)) == []


@pytest.mark.parametrize("torque", [0.0, 0.02, -0.06])
def test_a_wheel_that_nothing_drives_has_no_reason_to_be_faster(
    vehicle: Vehicle, estimator: Estimator, torque: float
) -> None:
    assert accused(estimator, log(vehicle, SPINS, np.full(len(TIME), torque))) == ["wheel_speed_fl"]


def test_nor_one_that_is_slower_the_more_it_is_driven(vehicle: Vehicle, estimator: Estimator) -> None:
    slower = log(vehicle, -0.3 * SPINS, np.full(len(TIME), SUSTAINED))
    assert accused(estimator, slower) == ["wheel_speed_fl"]


@pytest.mark.parametrize("spins", [True, False])
def test_wheels_that_spin_follow_no_steering(vehicle: Vehicle, spins: bool) -> None:
    """Steered further and further the car goes straight on; were all wheels rolling, that would be odd."""
    sides = ("yaw_rate", "accel_y", "steering_wheel")
    wheels = [f"{kind}_{w}" for kind in ("wheel_speed", "drive_torque") for w in WHEELS]
    torque = np.where((TIME > 3.5) & (TIME < 8), ICE, SUSTAINED)
    given = log(vehicle, SPINS * spins, torque)
    noise = np.random.default_rng(1).normal(size=(3, len(TIME)))
    turned = np.interp(TIME, [5, 10, 13, 16], [0, 2, 2, 0])  # rad of the steering wheel
    told = dict(zip(sides, (0.003 * noise[0], 0.05 * noise[1], turned + 0.01 * noise[2]), strict=True))
    sees_sides = build("joint", vehicle, [*wheels, *sides, "accel_x"])
    assert accused(sees_sides, Log(TIME, {**given.channels, **told})) == ([] if spins else ["steering_wheel"])
