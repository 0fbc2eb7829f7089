"""Roundabouts, in which tires turn in swiftly at a walking car's forces, ramps, and brakes in a bend."""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import SATELLITE, Scenario, on_plant
from benchmarks.accuracy.scenarios import driven as on_road
from numpy.typing import NDArray

from roadstate.core import Estimates, Log
from roadstate.estimators import build
from roadstate.estimators.axle_forces import gains_aside, steered_cosines
from roadstate.run import batch, scan
from roadstate.sim.manoeuvres import Manoeuvre, Script
from roadstate.sim.manoeuvres.path import straight
from roadstate.sim.roads.centreline import Bend, make_road
from roadstate.sim.roads.friction import uniform
from roadstate.sim.run import truth_table
from roadstate.sim.sensors import measure, sensor_preset, to_log
from roadstate.sim.speed_plan import SpeedPlan
from roadstate.vehicles import Vehicle

FRICTION = 0.85
RADIUS, CIRCUITS = 20.0, 2
Runs = list[tuple[Log, Estimates]]


def roundabouts(vehicle: Vehicle) -> Manoeuvre:
    """To the right, around to the left, and out to the right: each within 6 m, .9 s."""
    inward, around = -1 / (1.2 * RADIUS), 1 / RADIUS
    bends = [Bend(80.0)]
    for _ in range(CIRCUITS):
        turns = [Bend(6, 0, inward), Bend(10, inward), Bend(6, inward, around)]
        back = [Bend(6, around, inward), Bend(10, inward), Bend(6, inward, 0)]
        bends += [*turns, Bend(60, around), *back, Bend(80.0)]
    speed = SpeedPlan((0, 48), (7.0, 7.0))
    road = make_road([*bends, Bend(200.0)], friction=uniform(FRICTION))
    return Manoeuvre("roundabouts", "roundabouts", road, 7.0, Script.write(speed), straight())


def trail_braking(vehicle: Vehicle) -> Manoeuvre:
    """Braked for four seconds in a bend of .7 g."""
    road = make_road([Bend(120.0), Bend(40, 0, 1 / 80), Bend(900, 1 / 80)], friction=uniform(FRICTION))
    plan = SpeedPlan((0, 20), (23.0, 23.0))

    def brake(time: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.interp(time, [12, 12.5, 16, 17], [0, 0.35, 0.35, 0])

    return Manoeuvre(
        "trail", "trail braking", road, 23.0, Script.write(plan, pedals_from=12.0, brake=brake), straight()
    )


def spiral(vehicle: Vehicle) -> Manoeuvre:
    """Up the ramp of a car park: twice around to the left, 9 m from the middle, 11 % steep."""
    steep, around = 0.11, 1 / 9.0

    def height(s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        slope = steep * np.clip((s - 30) / 20, 0, 1)
        return np.where(s < 50, slope * (s - 30) / 2, steep * (s - 40)), slope

    bends = [Bend(60.0), Bend(10, 0, around), Bend(130, around)]
    road = make_road(bends, friction=uniform(FRICTION), height=height)
    return Manoeuvre("spiral", "spiral", road, 3.5, Script.write(SpeedPlan((0, 50), (3.5, 3.5))), straight())


def driven(name: str, prepare: Callable[[Vehicle], Manoeuvre]) -> Runs:
    """By a bus, with two files of the car that are off."""
    logs = on_plant("family-car", Scenario(name, name, prepare), 2)
    buses = [without(log, SATELLITE) for log, _ in logs]
    cars = [build("joint", car, log.available) for (_, car), log in zip(logs, buses, strict=True)]
    return list(zip(buses, batch(cars, buses), strict=True))


@pytest.fixture(scope="module")
def around() -> Runs:
    return driven("roundabouts", roundabouts)


@pytest.fixture(scope="module")
def braked() -> Runs:
    return driven("trail", trail_braking)


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


def test_a_road_that_is_twisted_leans_on_the_axles(vehicle: Vehicle) -> None:
    """Of a car that is known, with ideal sensors: what the road bears at an angle, 110 N at either axle, is
    no force of its tires."""
    scenario = Scenario("spiral", "spiral", spiral)
    truth = truth_table(on_road(vehicle, scenario))
    log = without(to_log(measure(truth, sensor_preset("ideal"), seed=0)), SATELLITE)
    said = scan(build("joint", vehicle, log.available), log)
    climbs = log.time - log.time[0] > 30.0
    assert log["ref_grade"][climbs] == pytest.approx(0.11, abs=0.002)
    for axle, most in (("front", 70.0), ("rear", 130.0)):
        true = sum(log[f"ref_force_y_{axle[0]}{side}"] for side in "lr")
        off = np.mean((said.values[f"force_y_{axle}"] - true)[climbs])
        assert abs(off) < most
        assert abs(off) < 1.5 * np.mean(said.std[f"force_y_{axle}"][climbs])


def test_an_inner_wheel_that_locks_is_no_grip(braked: Runs) -> None:
    """The rear axle's inner wheel slides along, and the outer bears the axle across."""
    for log, said in braked:
        assert min(np.nanmin(log[f"ref_slip_{w}"]) for w in ("fl", "rl")) < -0.1
        low = said.values["friction_peak_lower"]
        assert (low <= FRICTION).mean() > 0.85
        assert low.max() < 1.1 * FRICTION
