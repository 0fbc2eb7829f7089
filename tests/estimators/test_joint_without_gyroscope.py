"""Bends without a yaw rate: the other sensors say how the car turns, and nobody how far it slides."""

from __future__ import annotations

import numpy as np
import pytest

from roadstate.core import Estimates, Log
from roadstate.estimators import build
from roadstate.papers.base import MISMATCHED
from roadstate.papers.plants import told
from roadstate.run import batch
from roadstate.sim.manoeuvres import manoeuvre
from roadstate.sim.plant import multibody_plant
from roadstate.sim.run import drive, truth_table
from roadstate.sim.sensors import measure, sensor_preset, to_log
from roadstate.vehicles import Vehicle

SATELLITE = {"speed", "altitude", "vertical_speed", "latitude", "longitude"}
LACKING = {"bus": {"yaw_rate", *SATELLITE}, "receiver": {"yaw_rate"}}


@pytest.fixture(scope="module")
def circle(vehicle: Vehicle) -> Log:
    """100 m, ever faster, to 80 % of a dry road's friction."""
    table = truth_table(
        drive(multibody_plant(vehicle), manoeuvre("constant-radius").prepare(vehicle), vehicle, rate=200.0)
    )
    return to_log(measure(table, sensor_preset("automotive"), seed=0, metadata={}))


@pytest.fixture(scope="module")
def estimates(vehicle: Vehicle, circle: Log) -> dict[str, Estimates]:
    car = told(vehicle, MISMATCHED, 0)
    return {
        kind: batch([build("joint", car, [c for c in circle.available if c not in lacking])], [circle])[0]
        for kind, lacking in LACKING.items()
    }


@pytest.mark.parametrize("kind", list(LACKING))
def test_no_sound_sensor_is_called_faulty(estimates: dict[str, Estimates], kind: str) -> None:
    assert estimates[kind].metadata.get("faults", []) == []


@pytest.mark.parametrize(("kind", "most"), [("bus", 0.015), ("receiver", 0.002)])
def test_the_grade_and_its_interval(
    circle: Log, estimates: dict[str, Estimates], kind: str, most: float
) -> None:
    """v_y r of an unknown sideslip is a slope of up to 2 % to the bus alone, and σ says so."""
    said = estimates[kind]
    error = (said.values["grade"] - circle["ref_grade"])[200:]
    assert np.sqrt(np.mean(error**2)) < most
    assert np.mean(np.abs(error) < 1.96 * said.std["grade"][200:]) > 0.9
