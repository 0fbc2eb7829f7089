"""Which way a car sets off, told by its accelerometer where neither gear nor wheels say."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import Estimates, Log
from roadstate.core.channels import WHEELS
from roadstate.estimators import build
from roadstate.estimators.joint import Joint
from roadstate.run import scan
from roadstate.vehicles import Vehicle

Array = NDArray[np.float64]
Drive = Callable[..., Log]
SPEEDS = tuple(f"wheel_speed_{w}" for w in WHEELS)


pytestmark = pytest.mark.usefixtures("optimised")


@pytest.fixture(scope="module")
def joint(vehicle: Vehicle) -> Joint:
    """One for all drives: a gear that no log tells of is one that is not there."""
    estimator = build("joint", vehicle, ("accel_x", *SPEEDS, "gear_ratio"))
    assert isinstance(estimator, Joint)
    return estimator


def in_first(log: Log) -> Log:
    return Log(log.time, {**log.channels, "gear_ratio": np.full(len(log), 3.6)})


def unsigned(log: Log, seed: int, dead_band: float = 0.0) -> Log:
    """What sensors make of it that tell no sign, and nothing below ``dead_band``, rad/s."""
    rng = np.random.default_rng(seed)
    channels = {"accel_x": log["accel_x"] + rng.normal(0, 0.08, len(log))}
    for wheel in SPEEDS:
        turning = np.abs(log[wheel] + rng.normal(0, 0.03, len(log)) * (np.abs(log[wheel]) > 0.1))
        channels[wheel] = np.where(turning < dead_band, 0.0, turning)
    return Log(log.time, channels)


def along(joint: Joint, drive: Drive, speed: Array, grade: Array, seed: int, **how: float) -> Estimates:
    return scan(joint, unsigned(drive(speed, grade), seed, **how))


TIME = np.arange(0, 40, 0.01)


@pytest.mark.parametrize("grade", [-0.12, -0.05, 0.0, 0.05, 0.12])
@pytest.mark.parametrize("accel", [0.4, 1.0, 2.5])
def test_backs_out(joint: Joint, drive: Drive, grade: float, accel: float) -> None:
    """Backing out at any rate on any slope, and driving off thereafter."""
    ramp = 3.0 / accel
    speed = np.interp(TIME, [3, 3 + ramp, 15, 18, 21, 31], [0, -3.0, -3.0, 0, 0, 15])
    said = along(joint, drive, speed, np.full(len(TIME), grade), seed=1)
    error = np.abs(said.values["speed"] - speed)
    assert np.max(error) < 0.5
    told = TIME > 1.0
    slope = np.abs(said.values["grade"] - np.sin(grade))[told]
    assert np.mean(slope < 2 * said.std["grade"][told]) > 0.98


def test_dead_band(joint: Joint, drive: Drive) -> None:
    """Wheels that tell nothing below 0.6 m/s."""
    speed = np.interp(TIME, [3, 6, 15, 18, 21, 31], [0, -3.0, -3.0, 0, 0, 15])
    said = along(joint, drive, speed, np.full(len(TIME), 0.03), seed=1, dead_band=2.0)
    assert np.max(np.abs(said.values["speed"] - speed)) < 0.4
    assert np.max(np.abs(said.values["speed"] - speed)[(TIME > 7) & (TIME < 17)]) < 0.15


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_creeps_out_of_a_parking_space(joint: Joint, drive: Drive, seed: int) -> None:
    """At .3 m/s² to .8 m/s, while wheels tell nothing below .3 m/s."""
    speed = np.interp(TIME, [3, 5.5, 9, 10, 21, 31], [0, -0.8, -0.7, 0, 0, 15])
    said = along(joint, drive, speed, np.zeros(len(TIME)), seed, dead_band=1.0)
    error = np.abs(said.values["speed"] - speed)
    assert np.max(error) < 0.4
    assert np.max(error[(TIME > 6) & (TIME < 9)]) < 0.1
    assert np.max(error[TIME > 11]) < 0.1


def test_turns_on_the_spot(joint: Joint, drive: Drive) -> None:
    """A turn in three goes, without standing between them."""
    speed = np.interp(TIME, [3, 5, 8, 12, 15, 18, 25, 30], [0, 2.0, 2.0, -2.0, -2.0, 2.0, 2.0, 10.0])
    said = along(joint, drive, speed, np.full(len(TIME), 0.02), seed=1)
    assert np.max(np.abs(said.values["speed"] - speed)) < 0.2


@pytest.mark.parametrize("accel", [0.2, 0.5, 1.0, 3.0])
@pytest.mark.parametrize("grade", [-0.12, 0.0, 0.12])
def test_sets_off_forward_as_ever(joint: Joint, drive: Drive, accel: float, grade: float) -> None:
    """Wheels count from the first step, whatever the slope."""
    speed = np.clip(accel * (TIME - 3), 0, 15)
    log = unsigned(drive(speed, np.full(len(TIME), grade)), 1)
    said = scan(joint, log)
    assert np.min(said.values["speed"]) > -0.15
    assert np.max(np.abs(said.values["speed"] - speed)) < 0.15


@pytest.mark.parametrize("grade", [0.06, 0.12, 0.2])
@pytest.mark.parametrize("fastest", [0.7, 2.5])
def test_rolls_back_in_first_gear(joint: Joint, drive: Drive, grade: float, fastest: float) -> None:
    """On a hill, before the clutch bites."""
    lets_go = fastest / (9.81 * np.sin(grade))
    times = [3, 3 + lets_go, 3.6 + lets_go, 4 + lets_go, 14 + lets_go]
    speed = np.interp(TIME, times, [0, -fastest, 0, 0, 12])
    said = scan(joint, in_first(unsigned(drive(speed, np.full(len(TIME), grade)), 1)))
    error = np.abs(said.values["speed"] - speed)
    assert np.max(error) < 0.6
    assert np.sqrt(np.mean(error**2)) < 0.1
    slope = np.abs(said.values["grade"] - np.sin(grade))[TIME > 1]
    assert np.mean(slope < 2 * said.std["grade"][TIME > 1]) > 0.95


@pytest.mark.parametrize("fastest", [2.0, 6.0])
def test_an_electric_car_backs_up_in_its_only_gear(
    joint: Joint, drive: Drive, vehicle: Vehicle, fastest: float
) -> None:
    """Its motor turns backward, at up to more than any car rolls back in first gear."""
    line = vehicle.driveline.model_copy(update={"gear_ratios": (3.6,)})
    electric = build("joint", vehicle.model_copy(update={"driveline": line}), joint.channels)
    speed = np.interp(TIME, [3, 9, 14, 20, 24, 34], [0, -fastest, -fastest, 0, 0, 10])
    said = scan(electric, in_first(unsigned(drive(speed, np.zeros(len(TIME))), 1)))
    assert np.max(np.abs(said.values["speed"] - speed)) < 0.6


@pytest.mark.parametrize("accel", [0.2, 1.0, 3.0])
@pytest.mark.parametrize("grade", [-0.2, 0.0, 0.2])
def test_a_forward_gear_goes_forward(joint: Joint, drive: Drive, accel: float, grade: float) -> None:
    speed = np.clip(accel * (TIME - 3), 0, 15)
    said = scan(joint, in_first(unsigned(drive(speed, np.full(len(TIME), grade)), 1)))
    assert np.min(said.values["speed"]) > -0.2
    assert np.max(np.abs(said.values["speed"] - speed)) < 0.2


@pytest.mark.parametrize("stands", [0.5, 2.0])
@pytest.mark.parametrize("grade", [-0.04, 0.0, 0.08])
def test_what_came_before_a_stop_does_not_count(
    joint: Joint, drive: Drive, stands: float, grade: float
) -> None:
    """Braked to a stop from speed, the accelerometer has summed up to −15 m/s; that is over."""
    speed = np.interp(TIME, [4, 8, 8 + stands, 28 + stands], [15, 0, 0, 10])
    log = unsigned(drive(speed, np.full(len(TIME), grade)), 1)
    for said in (scan(joint, log), scan(joint, in_first(log))):
        assert np.max(np.abs(said.values["speed"] - speed)[TIME > 1]) < 0.3


def test_an_accelerometer_turned_round_is_found_out_sooner_in_gear(joint: Joint, drive: Drive) -> None:
    """No car rolls back as fast as that."""
    speed = np.interp(TIME, [3, 13], [0, 15.0])
    log = in_first(unsigned(drive(speed, np.zeros(len(TIME))), 1))
    said = scan(joint, Log(TIME, {**log.channels, "accel_x": -log["accel_x"]}))
    assert np.max(np.abs(said.values["speed"] - speed)[TIME > 6.5]) < 1.0
    assert any(one["fault"].startswith("accel_x: wrong sign") for one in said.metadata["faults"])


def test_an_accelerometer_turned_round_is_found_out(joint: Joint, drive: Drive) -> None:
    """Its car seems to back up, until it goes as fast as no car does."""
    speed = np.interp(TIME, [3, 13], [0, 15.0])
    log = unsigned(drive(speed, np.zeros(len(TIME))), 1)
    said = scan(joint, Log(TIME, {**log.channels, "accel_x": -log["accel_x"]}))
    assert np.max(np.abs(said.values["speed"] - speed)[TIME > 9]) < 1.0
    assert any(one["fault"].startswith("accel_x: wrong sign") for one in said.metadata["faults"])
