"""A car in reverse gear, whose figures follow from the signs of slips alone: F_x over |v|, F_y over |v|."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import WHEELS, Estimates, Log
from roadstate.core.constants import GRAVITY
from roadstate.estimators import build
from roadstate.run import scan
from roadstate.vehicles import Vehicle

Array = NDArray[np.float64]
STEP = 0.01
BEGINS = int(3 / STEP)
FORWARD, BACKWARD = 1.0, -1.0


def driven(vehicle: Vehicle, speed: Array, curvature: float) -> Log:
    """A level road: linear tires, F_x as speed and lateral forces ask for, all of a drive at the front."""
    rng, figures, mass = np.random.default_rng(0), vehicle.geometry, vehicle.mass
    base = vehicle.wheelbase
    yaw_rate, steer = curvature * speed, curvature * base
    across = speed * yaw_rate
    slides = across / GRAVITY / vehicle.tires.cornering_stiffness_rear
    sideways = figures.cg_to_rear_axle * yaw_rate - np.abs(speed) * slides
    felt = np.gradient(speed, STEP) - yaw_rate * sideways
    front = figures.cg_to_rear_axle * mass * across / base / np.cos(steer)
    drag = 0.5 * vehicle.aerodynamics.air_density * vehicle.drag_area * speed * np.abs(speed)
    force = mass * felt + drag + front * np.sin(steer)
    rolling = vehicle.rolling_resistance.coefficient + vehicle.rolling_resistance.speed_coefficient * speed**2
    lean = 1 + GRAVITY * np.array([vehicle.body.pitch_gradient, vehicle.body.roll_gradient])
    channels = {
        "accel_x": lean[0] * felt + rng.normal(0, 0.03, len(speed)),
        "accel_y": lean[1] * across + rng.normal(0, 0.03, len(speed)),
        "yaw_rate": yaw_rate + rng.normal(0, 0.002, len(speed)),
        "steer": np.full(len(speed), steer),
        "gear_ratio": np.where(speed < 0, -3.5, 3.5),
        "ref_velocity_x": speed,
        "ref_velocity_y": sideways,
        "ref_grade": np.zeros(len(speed)),
    }
    drives = force * speed > 0
    for i, wheel in enumerate(WHEELS):
        ahead = i < 2
        width = (figures.track_front if ahead else figures.track_rear) / 2 * (1 if i % 2 == 0 else -1)
        arm = figures.cg_to_rear_axle if ahead else figures.cg_to_front_axle
        own = force * np.where(drives, 0.5 if ahead else 0.0, 0.25)
        moves = (speed - width * yaw_rate) / (np.cos(steer) if ahead else 1.0)
        slip = own / (vehicle.tires.slip_stiffness * mass * GRAVITY * arm / base / 2)
        spin = (moves + np.abs(moves) * slip) / vehicle.wheels.radius
        torque = vehicle.wheels.radius * (own + rolling * np.sign(speed) * mass * GRAVITY / 4)
        channels[f"wheel_speed_{wheel}"] = spin + rng.normal(0, 0.05, len(speed))
        channels[f"drive_torque_{wheel}"] = np.where(drives, torque, 0.0)
        channels[f"brake_torque_{wheel}"] = np.where(drives, 0.0, np.maximum(-torque * np.sign(speed), 0.0))
    return Log(STEP * np.arange(len(speed)), channels)


def said_of(name: str, vehicle: Vehicle, log: Log) -> Estimates:
    return scan(build(name, vehicle, log.available), log)


@pytest.mark.parametrize("direction", [FORWARD, BACKWARD])
@pytest.mark.parametrize("name", ["joint", "tfobe"])
def test_a_force_ahead_turns_tires_faster_whichever_way_they_roll(
    vehicle: Vehicle, name: str, direction: float
) -> None:
    """Taken as a share of a negative speed, slips of 2 to 3 % make that wrong by twice as much."""
    speed = direction * (7 - 2 * np.cos(np.pi * np.arange(0, 24, STEP) / 3))
    said = said_of(name, vehicle, driven(vehicle, speed, 0.0))
    off = (said.values["speed"] - speed)[BEGINS:]
    assert np.sqrt(np.mean(off**2)) < 0.04
    assert np.abs(np.mean(off)) < 0.01


@pytest.mark.parametrize("direction", [FORWARD, BACKWARD])
@pytest.mark.parametrize(("name", "most"), [("joint", 0.2), ("tfobe", 0.15), ("friction-ukf", 0.15)])
def test_a_tire_slides_outward_whichever_way_it_rolls(
    vehicle: Vehicle, name: str, most: float, direction: float
) -> None:
    """What it slides by is the other way round where the sign of the speed is taken for the slip angle's."""
    log = driven(vehicle, np.full(2000, direction * 8.0), 0.05)
    said = said_of(name, vehicle, log)
    true = log["ref_velocity_y"][-1]
    assert np.abs(true) > 0.3
    np.testing.assert_allclose(said.values["velocity_y"][BEGINS:], true, atol=most * np.abs(true))


@pytest.mark.parametrize("direction", [FORWARD, BACKWARD])
@pytest.mark.parametrize("name", ["joint", "tfobe", "debe", "kmbe"])
def test_a_bend_is_no_slope_whichever_way_it_is_driven(vehicle: Vehicle, name: str, direction: float) -> None:
    said = said_of(name, vehicle, driven(vehicle, np.full(2000, direction * 8.0), 0.05))
    assert np.abs(np.mean(said.values["grade"][-500:])) < 0.008


@pytest.mark.parametrize("name", ["joint", "tfobe", "debe", "kmbe"])
def test_a_gear_says_which_way_unsigned_wheels_roll(vehicle: Vehicle, name: str) -> None:
    """Also where torques come at the wheels, and no gear is asked for them."""
    log = driven(vehicle, BACKWARD * (7 - 2 * np.cos(np.pi * np.arange(0, 24, STEP) / 3)), 0.0)
    wheels = [f"wheel_speed_{w}" for w in WHEELS]
    said, signed = (
        said_of(name, vehicle, each) for each in (log.with_channels({c: np.abs(log[c]) for c in wheels}), log)
    )
    np.testing.assert_allclose(
        said.values["speed"][BEGINS:], signed.values["speed"][BEGINS:], rtol=0, atol=0.02
    )
    assert np.abs(said.values["grade"] - signed.values["grade"])[BEGINS:].max() < 0.003


@pytest.mark.parametrize("direction", [FORWARD, BACKWARD])
@pytest.mark.parametrize("curvature", [0.0, 0.05])
@pytest.mark.parametrize("name", ["joint", "tfobe", "debe"])
def test_brakes_that_no_channel_tells_of(
    vehicle: Vehicle, name: str, curvature: float, direction: float
) -> None:
    """They push ahead a car that backs up; what its front tires hold back in a bend is no brake."""
    speed = direction * (7 - 2 * np.cos(np.pi * np.arange(0, 24, STEP) / 3))
    log = driven(vehicle, speed, curvature)
    bus = Log(log.time, {c: v for c, v in log.channels.items() if not c.startswith("brake_torque")})
    grade = said_of(name, vehicle, bus).values["grade"][BEGINS:]
    assert np.sqrt(np.mean(grade**2)) < (0.011 if name == "debe" else 0.0075)


def test_a_gear_says_which_way_an_unsigned_speed_goes(vehicle: Vehicle) -> None:
    """A receiver's, beside wheels that the gear turns as well."""
    speed = BACKWARD * (7 - 2 * np.cos(np.pi * np.arange(0, 24, STEP) / 3))
    log = driven(vehicle, speed, 0.0)
    log = log.with_channels({"speed": np.abs(speed)})
    error = (said_of("friction-ukf", vehicle, log).values["speed"] - speed)[BEGINS:]
    assert np.sqrt(np.mean(error**2)) < 0.05
