"""The driver in the planar plants: one whose wheels turn, and one whose slips he has to give."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from roadstate.core import WHEELS
from roadstate.sim.manoeuvres import manoeuvre
from roadstate.sim.plant.planar import PlanarPlant
from roadstate.sim.run import Drive, drive, record, truth_table
from roadstate.sim.sensors import sensor_preset, to_log
from roadstate.vehicles import load_vehicle

CAR = load_vehicle("family-car")
ENGINE = {"engine_torque", "engine_speed", "gear_ratio"}
TURNING = {
    f"{name}_{w}"
    for name in ("wheel_speed", "drive_torque", "brake_torque", "brake_pressure")
    for w in WHEELS
}


@cache
def driven_by(kind: str, name: str) -> Drive:
    return drive(getattr(PlanarPlant, kind)(CAR), manoeuvre(name).prepare(CAR), CAR)


@pytest.mark.parametrize("kind", ["seven_dof", "three_dof"])
@pytest.mark.parametrize("name", ["double-lane-change", "hill-start"])
def test_path_and_speed_are_kept(kind: str, name: str) -> None:
    driven = driven_by(kind, name)
    chosen, place = driven.manoeuvre, driven.truth.road
    assert np.abs(place[:, 1] - np.asarray(chosen.path.at(place[:, 0]).d)).max() < 0.3
    plan = np.asarray(chosen.script.table)[: len(driven.time), 0]
    assert np.abs(driven.truth.planar_velocity[:, 0] - plan).max() < 0.7


def test_parked_on_a_hill_the_recorded_imu_reads_the_slope() -> None:
    driven = driven_by("seven_dof", "hill-start")
    log = to_log(record(driven, sensor_preset("ideal")))
    stands = (log.time > 1.0) & (log.time < 3.5)
    assert log["accel_x"][stands] == pytest.approx(9.80665 * np.sin(np.arctan(0.12)), abs=0.02)
    assert log["kinematic_accel_x"][stands] == pytest.approx(0.0, abs=0.02)
    assert log["accel_z"][stands] == pytest.approx(9.80665 * np.cos(np.arctan(0.12)), abs=0.02)
    assert log["ref_grade"][stands] == pytest.approx(np.arctan(0.12), abs=1e-4)
    assert np.abs(log["wheel_speed_rl"][stands]).max() < 0.02


def test_recorded_forces_explain_the_recorded_acceleration() -> None:
    """m a_x = ΣF_x,body − drag at the centre of gravity, from the log's own columns."""
    driven = driven_by("seven_dof", "double-lane-change")
    table = truth_table(driven)
    steer = table["steer"]
    F_x, F_y = ({w: table[f"ref_force_{a}_{w}"] for w in ("fl", "fr", "rl", "rr")} for a in ("x", "y"))
    front_x, front_y = F_x["fl"] + F_x["fr"], F_y["fl"] + F_y["fr"]
    along = front_x * np.cos(steer) - front_y * np.sin(steer) + F_x["rl"] + F_x["rr"]
    across = front_x * np.sin(steer) + front_y * np.cos(steer) + F_y["rl"] + F_y["rr"]
    drag = 0.5 * CAR.aerodynamics.air_density * CAR.drag_area * table["ref_velocity_x"] ** 2
    late = table["time"] > 0.5
    assert CAR.mass * table["accel_x"][late] == pytest.approx((along - drag)[late], abs=15.0)
    assert CAR.mass * table["accel_y"][late] == pytest.approx(across[late], abs=15.0)


@pytest.mark.parametrize(("kind", "missing"), [("seven_dof", ENGINE), ("three_dof", ENGINE | TURNING)])
@pytest.mark.parametrize("sensors", ["ideal", "worn"])
def test_what_a_plant_does_not_have_is_not_in_its_log(kind: str, missing: set[str], sensors: str) -> None:
    """A zero would be a reading: wheels that stand, a gearbox in neutral."""
    driven = driven_by(kind, "double-lane-change")
    table, log = truth_table(driven), to_log(record(driven, sensor_preset(sensors)))
    assert (ENGINE | TURNING) - set(table) == missing
    assert not missing & set(log.channels)
    assert {"speed", "brake", "steering_wheel", "accel_x", "ref_slip_fl"} <= set(log.channels)
    assert all(np.isfinite(column).all() for column in table.values())
