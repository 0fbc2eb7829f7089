"""What is told of a drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.sim.simple_car import SimpleCar

from roadstate.sim.facts import drive_facts, force_over_load, off_path
from roadstate.sim.manoeuvres import manoeuvre
from roadstate.sim.run import Drive, drive
from roadstate.vehicles import load_vehicle

CAR = load_vehicle("family-car")


@pytest.fixture(scope="module")
def driven() -> Drive:
    return drive(SimpleCar.of(CAR), manoeuvre("double-lane-change").prepare(CAR), CAR)


def test_distance_and_extremes(driven: Drive) -> None:
    facts = drive_facts(driven)
    steps = np.diff(driven.truth.position[:, :2], axis=0)
    assert facts["distance"] == pytest.approx(np.hypot(*steps.T).sum(), rel=1e-3)
    assert facts["duration"] == driven.time[-1]
    assert facts["accel_y_most"] == np.abs(driven.truth.specific_force[:, 1]).max()
    assert facts["off_path_most"] == np.abs(off_path(driven)).max()


def test_off_path_is_to_the_left_of_it(driven: Drive) -> None:
    place = np.array(driven.truth.road)
    place[:, 1] = np.asarray(driven.manoeuvre.path.at(place[:, 0]).d) + 0.3
    moved = replace(driven, truth=driven.truth._replace(road=place))
    assert off_path(moved) == pytest.approx(0.3, abs=1e-9)
    assert drive_facts(moved)["off_path_most"] == pytest.approx(0.3, abs=1e-9)


def test_a_wheel_in_the_air_uses_no_friction(driven: Drive) -> None:
    load = np.full((len(driven.time), 4), 4000.0)
    load[:100, 2] = 5.0
    force = np.full_like(load, 0.0)
    force[:, 0], force[:100, 2] = 1600.0, 400.0
    lifted = replace(driven, truth=driven.truth._replace(load=load, force_x=force, force_y=0 * force))
    along, across = force_over_load(lifted.truth)
    assert np.isnan(along[:100, 2]).all()
    assert not np.isnan(along[100:]).any()
    assert np.nanmax(across) == 0.0
    assert drive_facts(lifted)["friction_used_most"] == pytest.approx(0.4 / 0.8)


def test_friction_counts_as_used_after_a_tenth_of_a_second(driven: Drive) -> None:
    load, force = np.full((len(driven.time), 4), 4000.0), np.zeros((len(driven.time), 4))
    force[500:509, 1] = 3200.0  # nine samples: less
    force[700:711, 3] = 1600.0
    short = replace(driven, truth=driven.truth._replace(load=load, force_x=force, force_y=0 * force))
    assert drive_facts(short)["friction_used_most"] == pytest.approx(0.5)
