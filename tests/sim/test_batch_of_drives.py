"""Many drives at once are the drives one by one."""

from __future__ import annotations

import numpy as np
import pytest
from tests.sim.simple_car import SimpleCar

from roadstate.core import InputError
from roadstate.sim.batch import drive_many
from roadstate.sim.manoeuvres import manoeuvre
from roadstate.sim.plant.planar import PlanarPlant
from roadstate.sim.roads import split
from roadstate.sim.run import drive
from roadstate.vehicles import load_vehicle

CAR = load_vehicle("family-car")


def test_frictions_and_speeds_in_one_batch() -> None:
    kind, plant = manoeuvre("double-lane-change"), SimpleCar.of(CAR)
    chosen = [kind.prepare(CAR, speed=v, friction=mu) for v, mu in ((9.0, 0.4), (14.0, 0.8), (20.0, 0.85))]
    for together, m in zip(drive_many([plant], chosen, CAR), chosen, strict=True):
        alone = drive(plant, m, CAR)
        assert np.array_equal(together.time, alone.time)
        for a, b in zip(together.truth, alone.truth, strict=True):
            assert a == pytest.approx(b, abs=1e-6)
        assert together.controls.throttle == pytest.approx(alone.controls.throttle, abs=1e-9)


def test_masses_in_one_batch() -> None:
    plants = [PlanarPlant.seven_dof(CAR, mass=mass) for mass in (1300.0, 1700.0)]
    chosen = manoeuvre("step-steer").prepare(CAR)
    light, heavy = drive_many(plants, [chosen], CAR)
    assert light.truth.load[0].sum() == pytest.approx(1300 * 9.80665, rel=1e-3)
    assert heavy.truth.load[0].sum() == pytest.approx(1700 * 9.80665, rel=1e-3)
    alone = drive(plants[1], chosen, CAR)
    assert heavy.truth.road == pytest.approx(alone.truth.road, abs=1e-6)


def test_what_does_not_go_together_is_refused() -> None:
    plant, one = SimpleCar.of(CAR), manoeuvre("slalom").prepare(CAR)
    for plants, manoeuvres, what in (
        ([plant] * 2, [one] * 3, "2 plants and 3 manoeuvres"),
        ([], [one], "0 plants"),
        ([plant], [one, one.with_friction(split(0.2, 0.8))], "different kinds"),
    ):
        with pytest.raises(InputError, match=what):
            drive_many(plants, manoeuvres, CAR)
