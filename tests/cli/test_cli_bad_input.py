"""Bad input, end to end: exit 2, one line that says what, where and how to mend it, and no file left."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cli_case import Run, assert_refusal, csv, steady

from roadstate.core import Log
from roadstate.io import write

Refused = Callable[..., str]
HEADER = "time [s],speed [m/s],accel_x [m/s^2]"
SORT = "sort the log, or set 'time: {repair: drop}' in the mapping to leave such samples out"
PRESETS = "compact-car, family-car, in-wheel-ev, suv, truck"
NOT_EVEN_SPEED = (
    "no estimator can run on the channels there (debe needs a speed and a drive torque; "
    "joint needs the longitudinal accelerometer and a speed; "
    "kmbe needs a speed and the longitudinal accelerometer); map the missing ones"
)


@pytest.fixture
def good(tmp_path: Path) -> Path:
    return write(steady(), tmp_path / "good.csv")


def test_wrong_path(refused: Refused) -> None:
    assert refused("nowhere.csv") == "nowhere.csv: no such file; check the path"


def test_folder_for_a_file(refused: Refused, tmp_path: Path) -> None:
    assert refused(tmp_path).endswith(": is a folder; name a file in it")


def test_empty_file(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "empty.csv").touch()
    assert refused(tmp_path / "empty.csv") == (
        "empty.csv: the file is empty; was the recording stopped too early?"
    )


def test_empty_mapping(refused: Refused, good: Path, tmp_path: Path) -> None:
    (tmp_path / "m.yaml").touch()
    assert refused(good, "--mapping", tmp_path / "m.yaml") == (
        "m.yaml: the file is empty; start from what 'roadstate channels FILE --suggest' prints"
    )


def test_a_column_without_numbers_is_named(refused: Refused, tmp_path: Path) -> None:
    """It was said to be missing, and to be mapped, which it was."""
    file = csv(tmp_path / "log.csv", HEADER, [(0, 1, "NaN"), (1, 2, "NaN")])
    assert refused(file, "--estimator", "kmbe") == (
        "log.csv: 'kmbe' needs the longitudinal accelerometer (accel_x), and accel_x has no sample that is a "
        "number; look at its column, and at 'range' and 'valid' in the mapping"
    )


def test_csv_without_time(refused: Refused, tmp_path: Path) -> None:
    file = csv(tmp_path / "log.csv", "speed [m/s],accel_x [m/s^2]", [(1, 2), (3, 4)])
    assert refused(file) == (
        "log.csv: no time column; there are 'speed [m/s]', 'accel_x [m/s^2]'; "
        "call it 'time [s]', or name it in the mapping ('time: {column: NAME}')"
    )


@pytest.mark.parametrize(
    ("times", "fault"),
    [
        ((0, 1, 1, 2), "time repeats at row 2 (1 s, then 1 s; 1 such rows)"),
        ((0, 1, 0.5, 2), "time runs backward at row 2 (1 s, then 0.5 s; 1 such rows)"),
    ],
)
def test_time_that_does_not_increase(
    refused: Refused, tmp_path: Path, times: tuple[float, ...], fault: str
) -> None:
    file = csv(tmp_path / "log.csv", HEADER, [(t, 10, 0) for t in times])
    assert refused(file) == f"log.csv:speed: {fault}; {SORT}"


def test_unknown_unit(refused: Refused, tmp_path: Path) -> None:
    file = csv(tmp_path / "log.csv", "time [s],speed [warp],accel_x [m/s^2]", [(0, 1, 2), (1, 3, 4)])
    assert refused(file) == (
        "log.csv:speed as speed: unknown unit 'warp'; "
        "write it like 'km/h', 'deg/s', 'N*m', 'bar' or '-' (no unit)"
    )


def test_unit_of_something_else(refused: Refused, tmp_path: Path) -> None:
    file = csv(tmp_path / "log.csv", "time [s],speed [kg],accel_x [m/s^2]", [(0, 1, 2), (1, 3, 4)])
    assert refused(file) == (
        "log.csv:speed as speed: unit 'kg' cannot be converted to 'm/s'; "
        "give the signal's true unit with 'unit:'"
    )


def test_units_that_gravity_and_the_wheels_disprove(run: Run, refused: Refused, tmp_path: Path) -> None:
    rows = [(0.01 * i, 36.0, 32.0, 1.0) for i in range(100)]
    file = csv(tmp_path / "log.csv", "time [s],speed,wheel_speed_fl [rad/s],accel_z", rows)
    assert refused(file).startswith("log.csv:accel_z as accel_z: the median is 1 m/s^2, where gravity alone")
    file = csv(tmp_path / "log.csv", "time [s],speed,wheel_speed_fl [rad/s],accel_z [g]", rows)
    assert refused(file).startswith("log.csv:speed as speed: is 3.6")
    # where no vehicle is known, its wheels are neither small nor large
    for radius in (0.25, 0.6):
        turned = [(t, 10.0, 10.0 / radius, z) for t, _, _, z in rows]
        file = csv(tmp_path / "log.csv", "time [s],speed,wheel_speed_fl [rad/s],accel_z [g]", turned)
        assert run("channels", file, "--json").json["problem"] is None


def test_two_columns_of_one_name(refused: Refused, tmp_path: Path) -> None:
    file = csv(tmp_path / "log.csv", "time [s],speed [m/s],speed [km/h]", [(0, 1, 2), (1, 3, 4)])
    assert refused(file) == "log.csv: two columns are named 'speed'; rename one of them"


def test_two_channels_matching_one_name(refused: Refused, tmp_path: Path) -> None:
    file = csv(tmp_path / "log.csv", "time [s],ESP.Speed [m/s],Dash.Speed [m/s]", [(0, 1, 2), (1, 3, 4)])
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text("channels:\n  speed: {from: Speed}\n")
    assert refused(file, "--mapping", mapping) == (
        "log.csv: speed: candidate 'Speed' matches 2 signals: 'ESP.Speed', 'Dash.Speed'; two matches are an "
        "error, not a guess: give an exact name, or add 'message:' or 'bus:'"
    )


def test_mapping_with_a_typo(refused: Refused, tmp_path: Path, good: Path) -> None:
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text("channels:\n  speed: {form: Speed}\n")
    assert refused(good, "--mapping", mapping) == (
        "mapping.yaml, line 2: channels.speed: unknown key 'form'; did you mean 'from'?"
    )


def test_mapping_that_is_not_there(refused: Refused, good: Path) -> None:
    assert refused(good, "--mapping", "nowhere.yaml") == "nowhere.yaml: no such file; check the path"


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_truncated_mf4(refused: Refused, tmp_path: Path, drive: Log, share: float) -> None:
    pytest.importorskip("asammdf")
    whole = write(drive, tmp_path / "whole.mf4").read_bytes()
    (tmp_path / "cut.mf4").write_bytes(whole[: int(share * len(whole))])
    line = refused(tmp_path / "cut.mf4")
    assert line.startswith("cut.mf4: the MDF file is ")
    assert line.endswith("cut short; copy it again from the logger") or re.search(
        r"cut short \(asammdf: .*\); copy it again from the logger$", line
    )


def test_dbc_that_does_not_fit(refused: Refused, tmp_path: Path, shared_data: Path) -> None:
    pytest.importorskip("cantools")
    log = sorted((shared_data / "css_mf4").glob("*.MF4"))[0]
    dbc = tmp_path / "other.dbc"
    dbc.write_text('VERSION ""\nNS_ :\nBS_:\nBU_: X\nBO_ 1999 A: 8 X\n SG_ B : 0|8@1+ (1,0) [0|0] "km/h" X\n')
    line = refused(log, "--dbc", dbc)
    assert f"{log}: no id of the log is in other.dbc: the log has 0x7E8, " in line
    assert line.endswith("the DBC has 0x7CF; give the DBC of this car's bus")


def test_dbc_that_is_none(refused: Refused, tmp_path: Path, shared_data: Path) -> None:
    pytest.importorskip("cantools")
    log = sorted((shared_data / "css_mf4").glob("*.MF4"))[0]
    (tmp_path / "bad.dbc").write_text("this is no dbc")
    assert refused(log, "--dbc", tmp_path / "bad.dbc") == (
        "bad.dbc: not a readable DBC file: invalid syntax at line 1, column 1; is it complete?"
    )


def test_channel_of_nothing_but_nan_counts_as_missing(refused: Refused, tmp_path: Path) -> None:
    file = write(steady(accel_x=np.full(50, np.nan)), tmp_path / "log.csv")
    accel = "needs the longitudinal accelerometer"
    least = f"debe needs a drive torque; joint {accel}; kmbe {accel}"
    said = f"log.csv: no estimator can run on the channels there ({least}); map the missing ones"
    assert refused(file) == said


def test_nan_blocks_are_no_error(run: Run, tmp_path: Path) -> None:
    speed, accel = np.full(500, 10.0), np.zeros(500)
    speed[100:300], accel[200:400] = np.nan, np.nan
    file = write(steady(500, speed=speed, accel_x=accel), tmp_path / "log.csv")
    end = run("estimate", file, "--vehicle", "family-car", "--out", tmp_path / "results", "--json")
    assert (end.status, end.err) == (0, "")
    speeds = end.json["logs"]["log"]["estimators"]["kmbe"]["quantities"]["speed"]
    assert speeds["min"] > 9.0
    assert speeds["max"] < 11.0


def test_vehicle_file_with_a_typo(refused: Refused, tmp_path: Path, good: Path) -> None:
    line = refused(good, vehicle=edited(tmp_path, r"^mass:", "masss:"))
    assert re.fullmatch(r"car\.yaml, line \d+: masss: unknown key; did you mean 'mass' or '\w+'\?", line)


def test_vehicle_of_negative_mass(refused: Refused, tmp_path: Path, good: Path) -> None:
    line = refused(good, vehicle=edited(tmp_path, r"^mass:.*$", "mass: -1500 kg"))
    assert re.fullmatch(
        r"car\.yaml, line \d+: mass: -1500 kg is outside 50 to 200000 kg; it cannot be negative", line
    )


def edited(folder: Path, pattern: str, replacement: str) -> Path:
    """A preset's file with one line changed."""
    from importlib import resources

    preset = resources.files("roadstate.vehicles").joinpath("presets", "family-car.yaml").read_text()
    changed, count = re.subn(pattern, replacement, preset, flags=re.MULTILINE)
    assert count == 1
    (folder / "car.yaml").write_text(changed)
    return folder / "car.yaml"


def test_vehicle_that_is_not_known(refused: Refused, good: Path) -> None:
    assert refused(good, vehicle="famly-car") == (
        "vehicle: 'famly-car' is neither a preset vehicle nor a file; did you mean 'family-car' or "
        f"'compact-car'? presets: {PRESETS}; or give the path of a vehicle file"
    )


def test_estimator_whose_channels_are_missing(refused: Refused, good: Path) -> None:
    line = refused(good, "--estimator", "debe")
    assert line.startswith("good.csv: 'debe' needs a drive torque (drive_torque_fl+drive_torque_fr or ")
    assert line.endswith("; map the channel, or use an estimator these channels do for: joint, kmbe")


def test_no_estimator_can_run(refused: Refused, tmp_path: Path) -> None:
    file = csv(tmp_path / "log.csv", "time [s],yaw_rate [deg/s]", [(0, 1), (1, 3)])
    assert refused(file) == f"log.csv: {NOT_EVEN_SPEED}"


def test_no_channel_is_recognised(refused: Refused, tmp_path: Path) -> None:
    file = csv(tmp_path / "log.csv", "time [s],v [m/s]", [(0, 1), (1, 3)])
    assert refused(file) == (
        "log.csv: no canonical channel found; give a mapping ('roadstate channels FILE --suggest')"
    )


def test_unknown_estimator(refused: Refused, good: Path) -> None:
    assert refused(good, "--estimator", "kmbee") == (
        "good.csv: no estimator is called 'kmbee'; did you mean 'kmbe'?"
    )


def test_rate_out_of_range(refused: Refused, good: Path) -> None:
    assert refused(good, "--rate", "-1") == (
        "good.csv: a rate of -1 Hz is out of range; choose 0.1 to 10000 Hz"
    )


def test_parts_that_overlap(refused: Refused, tmp_path: Path) -> None:
    a, b = (write(steady(), tmp_path / name) for name in ("a.csv", "b.csv"))
    line = refused(a, b)
    assert line.startswith("b.csv:speed: ")
    assert line.endswith(", or say '--separate' if each file is a log of its own")


def test_two_logs_of_one_name(refused: Refused, tmp_path: Path, good: Path) -> None:
    (tmp_path / "other").mkdir()
    second = write(steady(), tmp_path / "other" / "good.csv")
    assert refused(good, second, "--separate") == (
        "other/good.csv: another log is called 'good', too; rename one of the files"
    )


def test_one_bad_log_of_several_leaves_nothing_behind(refused: Refused, tmp_path: Path, good: Path) -> None:
    bad = csv(tmp_path / "bad.csv", HEADER, [(0, 1, 2), (0, 3, 4)])
    assert refused(good, bad, "--separate").startswith("bad.csv:speed: time repeats at row 1")


def test_out_is_a_file(run: Run, good: Path, tmp_path: Path) -> None:
    for out in (good, good / "deeper"):
        end = run("estimate", good, "--vehicle", "family-car", "--out", out)
        assert_refusal(end)
        assert end.err == f"{good}: is a file; name a folder with --out\n"


def test_failure_leaves_earlier_results_alone(run: Run, good: Path, tmp_path: Path) -> None:
    out = tmp_path / "results"
    assert run("estimate", good, "--vehicle", "family-car", "--out", out).status == 0
    before = {f.name: f.read_bytes() for f in out.iterdir()}
    bad = csv(tmp_path / "bad.csv", HEADER, [(0, 1, 2), (0, 3, 4)])
    assert_refusal(run("estimate", good, bad, "--separate", "--vehicle", "family-car", "--out", out))
    assert {f.name: f.read_bytes() for f in out.iterdir()} == before


def test_log_without_a_reference(run: Run, good: Path) -> None:
    end = run("compare", good, "--vehicle", "family-car")
    assert_refusal(end)
    assert end.err == (
        f"{good}: no reference to compare with (ref_grade, ref_velocity_x, ref_friction_* of a wheel …); "
        "map one under 'reference:' in "
        "the mapping file, or use 'roadstate estimate'\n"
    )


def test_settle_longer_than_the_log(run: Run, drive_csv: Path) -> None:
    end = run("compare", drive_csv, "--vehicle", "family-car", "--settle", "60")
    assert_refusal(end)
    assert "is left to compare after 60 s; use a shorter settle; the last one lies at 9.99 s" in end.err


def test_control_characters_of_a_file_do_not_reach_the_terminal(run: Run, tmp_path: Path) -> None:
    file = csv(tmp_path / "log.csv", "time [s],\x1b[31mred [m/s]", [(0, 1), (1, 2)])
    end = run("channels", file)
    assert end.status == 0
    assert "\x1b" not in end.out
