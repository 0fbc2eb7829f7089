"""Roundabouts, in which tires turn in swiftly at a walking car's forces, hairpins, and brakes in a bend."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.by_bus import Runs, driven
from benchmarks.tight_turns import DRIVES, FRICTION

from roadstate.calibration.parameters import with_value
from roadstate.core import reference
from roadstate.core.constants import GRAVITY
from roadstate.estimators import build
from roadstate.estimators.axle_forces import gains_aside, steered_cosines
from roadstate.run import batch
from roadstate.vehicles import Vehicle


@pytest.fixture(scope="module")
def around() -> Runs:
    return driven("family-car", DRIVES["roundabouts"], 2)


@pytest.fixture(scope="module")
def braked() -> Runs:
    return driven("family-car", DRIVES["trail braking"], 2)


@pytest.fixture(scope="module")
def downhill() -> Runs:
    return driven("family-car", DRIVES["10 % down"], 2)


@pytest.fixture(scope="module")
def uphill() -> Runs:
    return driven("family-car", DRIVES["hairpins, 8 % up"], 2)


def test_the_road_of_a_roundabout_is_not_slippery(around: Runs) -> None:
    """A third of the friction is used; what errs in one bend errs in the next one, and is no evidence."""
    for log, said in around:
        assert np.nanmax(said.values["friction_used"]) < 0.4
        assert (said.values["friction_peak_upper"] > FRICTION).mean() > 0.97
        assert (said.values["friction_peak_lower"] < FRICTION).all()
        assert not said.metadata["faults"]
        off = said.values["velocity_y"] - log["ref_velocity_y"]
        assert np.sqrt(np.mean(off**2)) < 0.04
        assert np.mean(np.abs(off) < 1.96 * said.std["velocity_y"]) > 0.9


@pytest.mark.parametrize("radius", [6.0, 9.0, -9.0, 20.0])
def test_wheels_that_roll_around_a_point_all_tell_the_same_speed(vehicle: Vehicle, radius: float) -> None:
    """Each by how it moves; were the yaw rate's share the same in front they would be 1 % apart at 9 m."""
    speed, length, beside = 3.2, vehicle.wheelbase, np.array(vehicle.geometry.half_tracks)
    turning = speed / radius
    rolls = np.hypot(speed - beside * turning, [length * turning, length * turning, 0, 0])
    turn = steered_cosines(jnp.cos(jnp.arctan(length / radius)))
    told = np.asarray(turn * rolls + gains_aside(jnp.asarray(beside), turn) * turning)
    np.testing.assert_allclose(told, speed, rtol=2e-3)
    assert np.ptp(np.asarray(turn) * rolls + beside * turning) > (0.01 if abs(radius) < 10 else 1e-3) * speed


def test_a_road_that_is_twisted_is_not_slippery(downhill: Runs) -> None:
    """In hairpins that fall the road leans across under either axle, and neither slides: if that did not
    count, the upper bound would fall to .7 within a minute."""
    for log, said in downhill:
        later = log.time - log.time[0] > 5.0
        assert np.mean(said.values["friction_peak_upper"][later] > FRICTION) > 0.97
        for axle in ("front", "rear"):
            off = said.values[f"force_y_{axle}"] - reference(f"force_y_{axle}", log.channels)
            assert np.mean(np.abs(off[later]) < 1.96 * said.std[f"force_y_{axle}"][later]) > 0.9
        off = said.values["velocity_y"] - log["ref_velocity_y"]
        assert np.sqrt(np.mean(off[later] ** 2)) < 0.038


def test_an_accelerometer_out_of_the_middle_is_no_load(uphill: Runs) -> None:
    """r² pulls it by .08 m/s² in every hairpin: taken for white noise that made the car 6 to 10 % too light
    within a minute, at 1σ of 3, and the road seem as much steeper."""
    for log, said in uphill:
        mass, std = said.values["mass"][-1], said.std["mass"][-1]
        assert abs(mass - 1500.0) < min(1.96 * std, 100.0)
        assert std < 70.0
        later = log.time - log.time[0] > 5.0
        off = np.tan(said.values["grade"]) - np.tan(log["ref_grade"])
        assert np.sqrt(np.mean(off[later] ** 2)) < 0.005


def test_an_accelerometer_on_the_windscreen_is_one_in_the_middle(around: Runs, vehicle: Vehicle) -> None:
    """1.2 m ahead it reads −x r² along and x ṙ across beside; told so, all comes out as it was, while
    the grade would else be off by up to 1.2 %."""
    log, ahead, step = around[0][0], 1.2, 0.01
    turning, later = np.convolve(log["yaw_rate"], np.hanning(15) / 7, "same"), slice(500, -50)
    pulled = {
        "accel_x": log["accel_x"] - ahead * turning**2,
        "accel_y": log["accel_y"] + ahead * np.gradient(turning, step),
    }
    told = with_value(vehicle, ("sensors", "accel", "ahead"), ahead)
    runs = batch(
        [build("joint", car, log.available) for car in (vehicle, told)], [log, log.with_channels(pulled)]
    )
    (middle, moved) = (run.values for run in runs)
    assert np.abs(moved["grade"] - middle["grade"])[later].max() < 1.5e-3
    for axle in ("front", "rear"):
        off = moved[f"force_y_{axle}"] - middle[f"force_y_{axle}"]
        assert np.sqrt(np.mean(off[later] ** 2)) < 0.02 * np.abs(middle[f"force_y_{axle}"]).max()
    assert ahead * np.max(turning**2) / GRAVITY > 0.015


def test_parking() -> None:
    """Steered wheels push against each other, backward the other way round, and those steered at rest push
    aside by a tenth of their load, which no balance tells."""
    for log, said in driven("family-car", DRIVES["parking"], 2):
        assert log["ref_velocity_x"].min() < -1.0 < 1.0 < log["ref_velocity_x"].max()
        later = log.time - log.time[0] > 5.0
        for axle in ("front", "rear"):
            off = said.values[f"force_y_{axle}"] - reference(f"force_y_{axle}", log.channels)
            assert np.mean(np.abs(off[later]) < 1.96 * said.std[f"force_y_{axle}"][later]) > 0.87
        off = np.tan(said.values["grade"]) - np.tan(log["ref_grade"])
        assert np.sqrt(np.mean(off[later] ** 2)) < 0.008
        assert (said.values["friction_peak_lower"] < FRICTION).all()
        assert not said.metadata["faults"]


def test_an_inner_wheel_that_locks_is_no_grip(braked: Runs) -> None:
    """The rear axle's inner wheel slides along, and the outer bears the axle across."""
    for log, said in braked:
        assert min(np.nanmin(log[f"ref_slip_{w}"]) for w in ("fl", "rl")) < -0.1
        low = said.values["friction_peak_lower"]
        assert (low <= FRICTION).mean() > 0.85
        assert low.max() < 1.1 * FRICTION


def test_a_tilted_yard_turns_under_the_car() -> None:
    """From 6 % uphill to 5 % downhill within ten seconds and 25 m: taken for a road that goes along with the
    turn, grade held in two of three samples, and what pushed the car passed for a slippery road."""
    held = []
    for log, said in driven("family-car", DRIVES["6 % up"], 2):
        grade, later = reference("grade", log.channels), log.time - log.time[0] > 5.0
        assert np.ptp(grade) > 0.1
        off = (said.values["grade"] - grade)[later]
        assert np.sqrt(np.mean(off**2)) < 0.01
        held.append(np.mean(np.abs(off) < 1.96 * said.std["grade"][later]))
        assert np.mean(said.values["friction_peak_lower"] < FRICTION) > 0.98
        assert np.mean(said.values["friction_peak_upper"] > FRICTION) > 0.98
    assert np.mean(held) > 0.9
