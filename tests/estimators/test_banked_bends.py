"""Bends as roads have them: banked towards their inside."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import Scenario, on_plant

from roadstate.core import Log
from roadstate.estimators import build
from roadstate.run import scan
from roadstate.sim.manoeuvres import Manoeuvre, Script
from roadstate.sim.manoeuvres.path import straight
from roadstate.sim.roads.centreline import Bend, half_cosine, make_road
from roadstate.sim.roads.friction import uniform
from roadstate.sim.speed_plan import SpeedPlan
from roadstate.vehicles import Vehicle

FRICTION, SPEED, BANK, CURVATURE = 0.9, 22.0, 0.07, 1 / 200
STRAIGHT, ARC, RUN_OFF = 80.0, 160.0, 50.0


def banked_bends(clothoid: float, ahead: float) -> Scenario:
    """A left bend, a right one, a left one, with a bank that takes :data:`RUN_OFF` to come.

    Args:
        clothoid: m in which the curvature grows.
        ahead: m of the run-off that lie ahead of it.
    """

    def prepared(vehicle: Vehicle) -> Manoeuvre:
        plan, knots, banks = [Bend(STRAIGHT)], [0.0], [0.0]
        for side in (1.0, -1.0, 1.0):
            curved = side * CURVATURE
            begins = sum(bend.length for bend in plan) - ahead
            ends = begins + 2 * clothoid + ARC + 2 * ahead
            plan += [Bend(clothoid, 0.0, curved), Bend(ARC, curved), Bend(clothoid, curved, 0.0)]
            plan += [Bend(STRAIGHT)]
            knots += [begins, begins + RUN_OFF, ends - RUN_OFF, ends]
            banks += [0.0, -side * BANK, -side * BANK, 0.0]
        length = sum(bend.length for bend in plan)
        road = make_road(plan, bank=half_cosine([*knots, length], [*banks, 0.0]), friction=uniform(FRICTION))
        seconds = (length - STRAIGHT / 2) / SPEED
        drive = Script.write(SpeedPlan((0.0, seconds), (SPEED, SPEED)))
        return Manoeuvre("banked", "banked bends", road, SPEED, drive, straight())

    return Scenario("banked", "banked bends", prepared)


@pytest.mark.usefixtures("optimised")
def test_a_dry_road_that_banks_is_no_slippery_one() -> None:
    """What the bank takes of the lateral acceleration could pass for a slide of saturated tires."""
    log, car = on_plant("family-car", banked_bends(50.0, 0.0), 1)[0]
    joint = build("joint", car, log.available)
    values = scan(joint, log).values
    late = log.time > 2
    assert np.ptp(log["ref_bank"]) > 1.9 * BANK
    assert np.nanmax(values["friction_used"]) < 0.35
    assert (values["friction_peak_upper"][late] > FRICTION).all()
    assert (values["friction_peak_lower"] < FRICTION).all()
    assert np.sqrt(np.mean((values["velocity_y"] - log["ref_velocity_y"])[late] ** 2)) < 0.08
    assert np.sqrt(np.mean((values["bank"] - log["ref_bank"])[late] ** 2)) < 0.02
    # the roll rate tells how the bank changes
    assert (values["friction_peak"] > 0.5).all()
    turned = scan(joint, Log(log.time, {**log.channels, "roll_rate": -log["roll_rate"]}))
    assert any(fault["fault"].startswith("roll_rate: refused") for fault in turned.metadata["faults"])
    assert (turned.values["friction_peak_upper"][late] > FRICTION).mean() > 0.95


@pytest.mark.usefixtures("optimised")
def test_without_a_roll_rate_the_bounds_still_hold() -> None:
    log, car = on_plant("family-car", banked_bends(50.0, 0.0), 1)[0]
    log = without(log, ("roll_rate",))
    values = scan(build("joint", car, log.available), log).values
    assert (values["friction_peak_upper"][log.time > 2] > FRICTION).all()
    assert (values["friction_peak_lower"] < FRICTION).all()


@pytest.mark.parametrize("known", [True, False], ids=["roll rate", "no roll rate"])
@pytest.mark.usefixtures("optimised")
def test_a_bank_that_comes_before_its_bend_is_no_ice(known: bool) -> None:
    """Two thirds of the run-off lie on the straight, and the driver steers within half a second."""
    log, car = on_plant("suv", banked_bends(10.0, 2 / 3 * RUN_OFF), 1)[0]
    log = log if known else without(log, ("roll_rate",))
    values = scan(build("joint", car, log.available), log).values
    late = log.time > 2
    assert (values["friction_peak_upper"][late] > FRICTION).all()
    assert (values["friction_peak_lower"] < FRICTION).all()
    # a bank that has just come does not pass for a slide
    assert np.abs(values["velocity_y"] - log["ref_velocity_y"])[late].max() < 0.2
