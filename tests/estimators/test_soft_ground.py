"""Snow that holds wheels back, which an accelerometer's bias looks like."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import SATELLITE
from benchmarks.by_bus import on_plant
from benchmarks.hills import DRIVES

from roadstate.core import Log, reference
from roadstate.core.constants import GRAVITY
from roadstate.estimators import build
from roadstate.estimators.soft_ground import unsettled
from roadstate.run import batch, scan
from roadstate.vehicles import Vehicle

SNOW = 0.04  # what fresh snow adds to the coefficient of rolling resistance
DRIVEN = ("drive_torque_fl", "drive_torque_fr")


def on_snow(log: Log, vehicle: Vehicle) -> Log:
    """The same motion, on ground that takes so much more torque."""
    moves = np.abs(log["ref_velocity_x"]) > 0.3
    more = SNOW * vehicle.mass * GRAVITY * vehicle.wheels.radius / len(DRIVEN)
    return replace(log, channels={**log.channels, **{c: log[c] + more * moves for c in DRIVEN}})


def test_a_usual_bias_is_as_sure_as_the_filter_has_it() -> None:
    told = [float(unsettled(jnp.asarray(b), jnp.asarray(0.03), jnp.asarray(0.1))) for b in (0.0, 0.19, -0.19)]
    assert told == [0.0, 0.0, 0.0]
    assert float(unsettled(jnp.zeros(()), jnp.zeros(()), jnp.zeros(()))) == 0


def test_a_rare_bias_may_be_none() -> None:
    """Half way between twice and three times the file's, half of it; and nothing is said of one not known."""
    usual = jnp.asarray(0.1)
    told = [float(unsettled(jnp.asarray(b), jnp.asarray(0.03), usual)) for b in (-0.25, 0.4, -0.4)]
    assert told == pytest.approx([0.125, 0.4, 0.4])
    assert float(unsettled(jnp.asarray(0.4), jnp.asarray(0.09), usual)) == 0


def told(car: Vehicle, rolling_resistance_std: float) -> Vehicle:
    prior = car.prior.model_copy(update={"rolling_resistance_std": rolling_resistance_std})
    return car.model_copy(update={"prior": prior})


def test_grade_on_snow_is_no_surer_than_what_tells_snow_from_a_tilt(vehicle: Vehicle) -> None:
    """Without a height nothing does: grade is 3 to 4 % off and says so, where it said .4 %. Who knows of the
    snow says so in the vehicle file, and has it right to 1 %."""
    made = [
        (without(on_snow(log, vehicle), SATELLITE), car)
        for log, car in on_plant("family-car", DRIVES["hills, braked"], 4)
    ]
    logs = [log for log, _ in made]
    for std, most in ((0.002, 0.06), (0.02, 0.012)):
        estimators = [build("joint", told(car, std), log.available) for log, car in made]
        for log, said in zip(logs, batch(estimators, logs), strict=True):
            later = log.time - log.time[0] > 10.0
            off = (said.values["grade"] - reference("grade", log.channels))[later]
            assert np.sqrt(np.mean(off**2)) < most
            assert np.mean(np.abs(off) < 1.96 * said.std["grade"][later]) > 0.9
            assert said.metadata["faults"] == []


def test_every_wheel_rolls_through_snow(vehicle: Vehicle) -> None:
    """What is learnt of the ground holds back those that nothing drives, too; brakes act on them besides."""
    for log, car in on_plant("family-car", DRIVES["hills, winding"], 3):
        snow = without(on_snow(log, vehicle), SATELLITE)
        said = scan(build("joint", told(car, 0.02), snow.available), snow)
        later = log.time - log.time[0] > 15.0
        weighs = SNOW * (log["ref_load_rl"] + log["ref_load_rr"])
        for axle, sign in (("front", 1.0), ("rear", -1.0)):
            off = said.values[f"force_x_{axle}"] - reference(f"force_x_{axle}", log.channels) - sign * weighs
            assert np.abs(np.mean(off[later])) < 0.4 * np.mean(weighs)
            assert np.mean(np.abs(off) < 1.96 * said.std[f"force_x_{axle}"], where=later) > 0.9
