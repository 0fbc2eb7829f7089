"""From a drive to a log: rates, references, files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.sim.simple_car import SimpleCar

from roadstate.core import CHANNELS, WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.io import read, write
from roadstate.sim.manoeuvres import manoeuvre
from roadstate.sim.run import Drive, drive, record, truth_table
from roadstate.sim.sensors import Fault, sensor_preset, to_log
from roadstate.vehicles import load_vehicle

CAR = load_vehicle("family-car")
PLANT = SimpleCar.of(CAR)


@pytest.fixture(scope="module")
def driven() -> Drive:
    return drive(PLANT, manoeuvre("double-lane-change").prepare(CAR), CAR)


def test_finer_rows_are_the_same_drive(driven: Drive) -> None:
    fine = drive(PLANT, driven.manoeuvre, CAR, rate=500.0)
    assert len(fine.time) == 5 * len(driven.time)
    assert np.diff(fine.time) == pytest.approx(0.002)
    # the simple car integrates with the rows' step: the same up to its error
    assert fine.truth.road[::5] == pytest.approx(driven.truth.road, abs=0.05)
    held = np.asarray(fine.controls.steering_wheel).reshape(-1, 5)
    assert held[1:, 1:] == pytest.approx(np.repeat(held[1:, 1:2], 4, axis=1))
    assert held[1:, 0] == pytest.approx(held[:-1, 1])


def test_same_drive_twice_gives_the_same_bits(driven: Drive) -> None:
    again = drive(PLANT, driven.manoeuvre, CAR)
    for a, b in zip(driven.truth, again.truth, strict=True):
        assert np.array_equal(a, b)


def test_table_holds_truth_and_references(driven: Drive) -> None:
    table = truth_table(driven)
    assert len(table["time"]) == len(driven.time)
    for name in ("ref_grade", "ref_bank", "ref_velocity_x", "ref_velocity_y"):
        assert name in table
    for wheel in WHEELS:
        for stem in ("ref_friction", "ref_force_x", "ref_force_y", "ref_load", "wheel_speed", "drive_torque"):
            assert f"{stem}_{wheel}" in table
    assert all(name in CHANNELS for name in table if name.startswith("ref_"))
    assert table["ref_friction_fl"] == pytest.approx(0.8)


def test_gear_ratio_is_the_gearboxs_alone(driven: Drive) -> None:
    moving = truth_table(driven)["gear_ratio"]
    assert moving == pytest.approx(driven.truth.gear_ratio / CAR.driveline.final_drive)
    assert CAR.driveline.final_drive > 1.5


def test_kinematic_acceleration_has_no_gravity() -> None:
    chosen = manoeuvre("hill-start").prepare(CAR)
    table = truth_table(drive(PLANT, chosen, CAR))
    stands = table["time"] < 3.0
    slope = np.arctan(0.12)
    # the simple car feels no gravity along itself: what is left is minus the slope's share
    assert table["kinematic_accel_x"][stands] == pytest.approx(
        table["accel_x"][stands] - GRAVITY * np.sin(slope), abs=1e-6
    )
    assert table["ref_grade"][stands] == pytest.approx(slope, abs=1e-6)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_log_of_a_drive_goes_through_a_file(driven: Drive, tmp_path: Path, suffix: str) -> None:
    recording = record(
        driven, sensor_preset("automotive"), seed=3, faults=[Fault("dropout", "yaw_rate", 4.0, 1.0)],
        metadata={"vehicle": CAR.name},
    )  # fmt: skip
    log = to_log(recording)
    assert log.metadata["manoeuvre"] == "double-lane-change"
    assert log.metadata["faults"][0]["kind"] == "dropout"
    gap = (log.time > 4.01) & (log.time < 4.99)
    assert np.isnan(log["yaw_rate"][gap]).all()
    assert log["wheel_speed_fl"][600:700] == pytest.approx(48 / 3.6 / 0.3, rel=0.03)
    again = read(write(log, tmp_path / f"drive{suffix}")).resample()
    assert set(again.channels) == set(log.channels)
