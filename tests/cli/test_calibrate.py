"""``roadstate calibrate``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_case import NOISE, Run, assert_refusal, steady

from roadstate.core import Log
from roadstate.io import read_all, write
from roadstate.vehicles import load_vehicle


def test_writes_a_vehicle_file(run: Run, noisy: Path, tmp_path: Path) -> None:
    out = tmp_path / "new.yaml"
    end = run("calibrate", noisy, "-v", "family-car", "--tune", "-e", "kmbe", "-o", out, "--json")
    assert (end.status, end.err) == (0, "")
    learned = end.json["learned"]["sensors.speed.noise"]
    assert learned["value"] == pytest.approx(NOISE, rel=0.15)
    assert learned["unit"] == "m/s"
    assert end.json["file"] == str(out)
    assert end.json["logs"] == {"noisy": {"samples": 1200}}
    new = load_vehicle(out)
    assert new.sensors.speed.noise == pytest.approx(learned["value"], rel=0.01)
    assert new.mass == load_vehicle("family-car").mass
    assert "noisy" in new.source


def test_a_channel_that_comes_late_is_named(run: Run, tmp_path: Path) -> None:
    """What is learned from it would be wrong."""
    random = np.random.default_rng(5)
    time = np.arange(0.0, 60.0, 0.05)
    speed = 20 + 5 * np.sin(0.3 * time) + np.sin(1.3 * time) + 0.02 * random.normal(size=len(time))
    accel = 1.5 * np.cos(0.3 * (time - 0.3)) + 1.3 * np.cos(1.3 * (time - 0.3))
    accel += 0.05 * random.normal(size=len(time))
    file = write(Log(time, {"speed": speed, "accel_x": accel}), tmp_path / "late.csv")
    end = run("calibrate", file, "-v", "family-car", "--tune", "-e", "kmbe")
    assert end.status == 0
    assert end.err.startswith(f"{file}: accel_x: 0.3")
    assert end.err.endswith("add 300 ms to its 'delay' in the mapping\n")


def test_table(run: Run, noisy: Path) -> None:
    end = run("calibrate", noisy, "-v", "family-car", "-l", "friction", "--tune", "-e", "kmbe")
    assert (end.status, end.err) == (0, "")
    assert "sensors.speed.noise" in end.out
    assert "tires.friction: 'kmbe' does not use it" in end.out
    assert "say '--out NEW.yaml'" in end.out
    assert max(len(line) for line in end.out.splitlines()) <= 80


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("-l", "mas"), "--learn: no group of parameters is called 'mas'; did you mean 'mass'"),
        ((), "nothing to learn; say --learn with any of mass,tire"),
        (("-l", "mass", "-e", "kmb"), "no estimator is called 'kmb'"),
        (("-l", "mass", "-e", "kmbe"), "nothing can be learned (mass "),
        (("-l", "mass", "-e", "tfobe"), "'tfobe' needs"),
        (("-l", "tire", "--road-friction", "8"), "--road-friction: 8 is no peak friction of a road; give"),
        (("-l", "tire", "-e", "kmbe", "--road-friction", "0.8"), "--road-friction: 'kmbe' weighs no"),
    ],
)
def test_refusals_are_one_line_and_leave_the_file(
    run: Run, noisy: Path, tmp_path: Path, words: tuple[str, ...], says: str
) -> None:
    out = tmp_path / "new.yaml"
    out.write_text("mine")
    end = run("calibrate", noisy, "-v", "family-car", "-o", out, *words)
    assert_refusal(end)
    assert says in end.err
    assert out.read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["new.yaml"]


def test_short_log(run: Run, drive_csv: Path) -> None:
    end = run("calibrate", drive_csv, "-v", "family-car", "-l", "mass")
    assert_refusal(end)
    assert end.err.startswith("drive: 9.99 s are too short to learn from")


def test_a_log_hardly_too_short_is_seen_to_be(run: Run, noisy: Path, tmp_path: Path) -> None:
    log = write(read_all([noisy]).resample().between(0.0, 29.99), tmp_path / "noisy.csv")
    cut = write(steady(3000), tmp_path / "cut.csv")
    for file, name, said in ((log, "noisy", "29.95"), (cut, "cut", "29.99")):
        end = run("calibrate", file, "-v", "family-car", "-l", "mass")
        assert_refusal(end)
        assert end.err == f"{name}: {said} s are too short to learn from; give logs of 30 s at least\n"


def test_missing_folders_are_made_for_what_was_learned(run: Run, noisy: Path, tmp_path: Path) -> None:
    out = tmp_path / "a" / "b" / "new.yaml"
    assert_refusal(run("calibrate", noisy, "-v", "suv", "-l", "mass", "-e", "kmbe", "-o", out))
    assert list(tmp_path.iterdir()) == []
    assert run("calibrate", noisy, "-v", "family-car", "--tune", "-e", "kmbe", "-o", out).status == 0
    assert [path.name for path in tmp_path.rglob("*")] == ["a", "b", "new.yaml"]


def test_a_folder_is_no_vehicle_file_to_write(run: Run, noisy: Path, tmp_path: Path) -> None:
    end = run("calibrate", noisy, "-v", "suv", "-l", "mass", "-o", tmp_path)
    assert_refusal(end)
    assert end.err == f"{tmp_path}: is a folder; give the name of a file in it\n"


def test_help_fits(run: Run) -> None:
    end = run("calibrate", "--help")
    assert end.status == 0
    assert max(len(line) for line in end.out.splitlines()) <= 80
    assert "mass, tire" in " ".join(end.out.split())
