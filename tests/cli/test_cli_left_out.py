"""What readers left out of a log: ``channels`` tells all of it, the others where a channel is missed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from cli_case import Run, assert_refusal, csv

from roadstate.cli.left_out import left_out
from roadstate.core import Log
from roadstate.io import write
from roadstate.sim import SpeedPlan, simulate
from roadstate.vehicles import load_vehicle


def test_what_was_left_out_is_one_line_with_reasons() -> None:
    assert left_out({}) is None
    metadata = {
        "skipped": ["note", "m.text: more than 64 bits", "kind"],
        "undecoded": [f"0x{i:03X}" for i in range(9)],
    }
    assert left_out(metadata) == (
        "left out: note, kind (no plain numbers); m.text (more than 64 bits); "
        "0x000, 0x001, 0x002, 0x003, 0x004, 0x005 and 3 more (no DBC explains them)"
    )
    assert left_out({"skipped": [f"c{i}" for i in range(100)]}) == (
        "left out: c0, c1, c2, c3, c4, c5 and 94 more (no plain numbers)"
    )


def test_channels_tells_what_was_left_out(run: Run, tmp_path: Path) -> None:
    rows = [(0.1 * i, "12 kmh", 0.0, "x") for i in range(5)]
    file = csv(tmp_path / "log.csv", "time [s],speed,accel_x [m/s^2],note", rows)
    assert "left out: speed, note (no plain numbers)" in run("channels", file).out
    found = run("channels", file, "--json").json
    assert (found["skipped"], found["undecoded"]) == (["speed", "note"], [])
    assert set(found["channels"]) == {"accel_x"}


def test_a_canonical_channel_that_was_left_out_is_named(run: Run, tmp_path: Path) -> None:
    rows = [(0.01 * i, "12 kmh", 36, 0.0, 0.0, "x") for i in range(50)]
    header = "time [s],speed [m/s],v [km/h],accel_x [m/s^2],ref_grade [rad],note"
    file = csv(tmp_path / "log.csv", header, rows)
    mapping = tmp_path / "m.yaml"
    mapping.write_text("channels:\n  wheel_speed_fl: {from: v}\n  wheel_speed_fr: {from: v}\n")
    words = (file, "-v", "family-car", "-e", "kmbe")
    end = run("estimate", *words, "-m", mapping, "-o", tmp_path / "o", "--json")
    line = f"{file}: speed was left out (no plain numbers); correct it, or map another signal\n"
    assert (end.status, end.err) == (0, line)
    assert end.json["logs"]["log"]["skipped"] == ["speed", "note"]
    assert end.json["logs"]["log"]["undecoded"] == []
    assert end.json["logs"]["log"]["dropped"] == {}
    assert run("compare", *words, "-m", mapping).err == line
    mapping.write_text("channels:\n  speed: {from: v}\n")
    assert run("compare", *words, "-m", mapping).err == ""


def test_empty_and_misspelt_channels_are_named(run: Run, tmp_path: Path) -> None:
    rows = [(0.01 * i, 10.0, 0.0, "", 0.1, 1.0) for i in range(50)]
    header = "time [s],speed,accel_x,yaw_rate,Wheel Speed-FL [rad/s],Speed"
    file = csv(tmp_path / "log.csv", header, rows)
    words = (file, "-v", "family-car", "-e", "kmbe", "-o", tmp_path / "o")
    end = run("estimate", *words)
    misspelt = f"{file}: column 'Wheel Speed-FL' is not used; "
    misspelt += "did you mean 'wheel_speed_fl'? Rename it, or map it"
    empty = (
        f"{file}: yaw_rate has no sample that is a number; look at its column, and at 'range' and 'valid' in "
        "the mapping"
    )
    assert (end.status, end.err) == (0, f"{misspelt}\n{empty}\n")
    mapping = tmp_path / "m.yaml"
    mapping.write_text("channels:\n  wheel_speed_fl: {from: Wheel Speed-FL}\n")
    assert run("estimate", *words, "-m", mapping).err == f"{empty}\n"
    mapping.write_text("channels: {speed: speed, accel_x: accel_x}\nonly_listed: true\n")
    assert run("estimate", *words, "-m", mapping).err == ""


def test_a_refusal_tells_of_a_misspelt_channel(run: Run, tmp_path: Path) -> None:
    file = csv(tmp_path / "log.csv", "time [s],Speed,accel_x", [(0, 1, 0), (1, 1, 0)])
    end = run("estimate", file, "-v", "suv", "-e", "kmbe", "-o", tmp_path / "o")
    assert_refusal(end)
    assert "needs a speed" in end.err
    assert "; column 'Speed' is not used; map the channel" in end.err


def test_a_refusal_tells_of_what_was_left_out_in_its_one_line(run: Run, tmp_path: Path) -> None:
    file = csv(tmp_path / "log.csv", "time [s],speed,accel_x [m/s^2]", [(0, "fast", 0), (1, "slow", 0)])
    words = ("estimate", file, "-v", "suv", "-o", tmp_path / "o")
    end = run(*words, "-e", "kmbe")
    assert_refusal(end)
    assert "; speed was left out (no plain numbers); map the channel" in end.err
    mapping = tmp_path / "m.yaml"
    mapping.write_text("channels:\n  speed: speed\n")
    end = run(*words, "-m", mapping)
    assert_refusal(end)
    what = "speed: 'speed' is there, but was left out (no plain numbers); correct it, or name another signal"
    assert end.err == f"log.csv: {what}\n"
    file = csv(tmp_path / "only.csv", "time [s],speed,v", [(0, "fast", 0), (1, "slow", 0)])
    end = run("estimate", file, "-v", "suv", "-o", tmp_path / "o")
    assert_refusal(end)
    assert "no canonical channel found; speed was left out (no plain numbers); give a mapping" in end.err


def test_samples_that_are_repeated_are_told_of(run: Run, tmp_path: Path) -> None:
    rows = [(0.01 * i, 10.0 + 0.01 * (i // 10) ** 1.5, 0.1 * (i % 7)) for i in range(500)]
    file = csv(tmp_path / "log.csv", "time [s],speed,accel_x", rows)
    words = (file, "-v", "family-car", "-e", "kmbe", "-o", tmp_path / "o")
    end = run("estimate", *words, "--json")
    assert end.err == (
        f"{file}: speed: each sample is repeated for 10 rows; it is taken once; if these are measurements of "
        "their own, set 'time: {held: keep}' in the mapping\n"
    )
    assert end.json["logs"]["log"]["held"] == {"speed": 10}
    mapping = tmp_path / "m.yaml"
    mapping.write_text("time: {held: keep}\n")
    assert run("estimate", *words, "-m", mapping).err == ""


def test_a_channel_that_comes_late_is_named(run: Run, tmp_path: Path) -> None:
    """And is no more, once its delay is set."""
    plan = SpeedPlan((0, 5, 9, 14, 17, 25, 29, 34, 38, 45), (9, 9, 15, 15, 8, 18, 12, 12, 20, 10))
    log = simulate(load_vehicle("family-car"), plan, seed=5)
    late = np.concatenate([np.full(20, np.nan), log["accel_x"][:-20]])
    file = write(Log(log.time, {**log.channels, "accel_x": late}), tmp_path / "drive.csv")
    words = (file, "-v", "family-car", "-e", "kmbe", "-o", tmp_path / "o")
    end = run("estimate", *words, "--json")
    assert end.err.startswith(f"{file}: accel_x: 0.2")
    assert end.err.endswith(" s later than the other channels; add 200 ms to its 'delay' in the mapping\n")
    (found,) = end.json["logs"]["drive"]["late"]
    assert found["channels"] == ["accel_x"]
    assert abs(found["seconds"] - 0.2) < 0.01
    mapping = tmp_path / "m.yaml"
    mapping.write_text("channels:\n  accel_x: {from: accel_x, delay: 200 ms}\n")
    end = run("estimate", *words, "-m", mapping, "--json")
    assert end.err == ""
    assert end.json["logs"]["drive"]["late"] == []
