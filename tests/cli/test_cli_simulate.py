"""``roadstate simulate``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_case import Run, assert_refusal

from roadstate.io import read
from roadstate.vehicles import load_vehicle


def test_a_drive_becomes_a_log_with_its_truth(run: Run, tmp_path: Path) -> None:
    """Of the quickest plant: the others differ only in what drives."""
    words = ("simulate", "double-lane-change", "--plant", "seven-dof", "--speed", "48", "--friction", "0.8")
    end = run(*words, "--out", str(tmp_path / "a.parquet"), "--json")
    assert end.status == 0, end.err
    told = end.json
    log = read(tmp_path / "a.parquet").resample(100.0)
    assert len(log) == told["samples"]
    assert log["ref_friction_fl"] == pytest.approx(0.8, abs=1e-6)
    load = sum(log[f"ref_load_{w}"] for w in ("fl", "fr", "rl", "rr"))
    assert np.nanmean(load) == pytest.approx(load_vehicle("family-car").mass * 9.80665, rel=0.03)
    assert 40 / 3.6 < told["speed_least"] <= told["speed_most"] < 55 / 3.6
    assert 0.2 < told["friction_used_most"] < 0.8
    again = run(*words, "--out", str(tmp_path / "b.parquet"))
    assert again.status == 0
    same = read(tmp_path / "b.parquet").resample(100.0)
    np.testing.assert_array_equal(log["accel_y"], same["accel_y"])
    other = run(*words, "--seed", "7", "--out", str(tmp_path / "b.parquet"))
    assert other.status == 0
    assert not np.array_equal(log["accel_y"], read(tmp_path / "b.parquet").resample(100.0)["accel_y"])


def test_a_car_that_is_not_as_its_file_says(run: Run, tmp_path: Path) -> None:
    end = run("simulate", "double-lane-change", "--plant", "seven-dof", "--mismatch", "mass=10",
              "--out", str(tmp_path / "a.parquet"), "--json")  # fmt: skip
    assert end.json["mismatch"] == {"mass": 10.0}
    log = read(tmp_path / "a.parquet").resample(100.0)
    load = sum(log[f"ref_load_{w}"] for w in ("fl", "fr", "rl", "rr"))
    assert np.nanmean(load) == pytest.approx(1.1 * load_vehicle("family-car").mass * 9.80665, rel=0.03)


def test_a_wind_from_ahead_stops_a_coasting_car_sooner(run: Run, tmp_path: Path) -> None:
    """By ½ρ c_d A (v + w)², whichever way the road leads."""
    road = tmp_path / "road.yaml"
    road.write_text("heading: 90 deg\ncentreline: [{length: 1500 m}]\n")
    words = ("simulate", "coast-down", "--speed", "120", "--noise", "ideal", "--road", str(road))
    car = load_vehicle("family-car")
    slows, foreseen = [], []
    for wind in ("0", "40"):
        end = run(*words, "--wind", wind, "--out", str(tmp_path / f"{wind}.csv"), "--json")
        assert end.json["wind"] == pytest.approx(float(wind) / 3.6)
        log = read(tmp_path / f"{wind}.csv").resample(100.0)
        speed = log["ref_velocity_x"]
        slows.append(float(speed[200] - speed[400]) / 2)
        foreseen.append(car.drag_factor * (speed[300] + float(wind) / 3.6) ** 2 / car.mass)
    # but for what turning parts add to the mass
    assert slows[1] - slows[0] == pytest.approx(foreseen[1] - foreseen[0], rel=0.08)


@pytest.mark.parametrize(
    "words",
    [
        ("simulate", "double-lane-chnge"),
        ("simulate", "slalom", "--noise", "none"),
        ("simulate", "slalom", "--plant", "carsim"),
        ("simulate", "slalom", "--plant", "seven-dof", "--tir", "a.tir"),
        ("simulate", "slalom", "--plant", "three-dof", "--wind", "20"),
        ("simulate", "slalom", "--speed", "900"),
        ("simulate", "slalom", "--friction", "-1"),
        ("simulate", "slalom", "--road", "no-such-road.yaml"),
        ("simulate", "slalom", "--vehicle", "no-such-car"),
        ("simulate", "slalom", "--mismatch", "weight=10"),
        ("simulate", "slalom", "--mismatch", "mass=ten"),
        ("simulate", "slalom", "--mismatch", "mass=900"),
        ("simulate", "slalom", "--mismatch", "mass=nan"),
    ],
)
def test_bad_words_are_one_line(run: Run, tmp_path: Path, words: tuple[str, ...]) -> None:
    end = run(*words, "--out", str(tmp_path / "x.csv"))
    assert_refusal(end)
    assert not list(tmp_path.iterdir())
