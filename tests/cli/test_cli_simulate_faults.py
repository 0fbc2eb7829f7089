"""``roadstate simulate`` with faults in its sensors, and with a page of the drive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_case import Run, assert_refusal

from roadstate.core import Log
from roadstate.io import read

WORDS = ("simulate", "double-lane-change", "--plant", "seven-dof")


def simulated(run: Run, path: Path, *faults: str) -> Log:
    words = [w for fault in faults for w in ("--fault", fault)]
    end = run(*WORDS, "--out", path, *words)
    assert (end.status, end.err) == (0, "")
    return read(path).resample(100.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("faults")


def test_faults_act_where_and_when_they_are_told_to(run: Run, folder: Path) -> None:
    sound = simulated(run, folder / "a.parquet")
    faulty = simulated(
        run, folder / "b.parquet", "dropout:wheel_speed_f*:4:1.5", "drift:accel_y:2::0.1", "sign:yaw_rate"
    )
    t = sound.time
    gone = (t > 4.01) & (t < 5.49)
    for wheel in ("fl", "fr"):
        assert np.isnan(faulty[f"wheel_speed_{wheel}"][gone]).all()
        np.testing.assert_array_equal(
            faulty[f"wheel_speed_{wheel}"][~gone][10:400], sound[f"wheel_speed_{wheel}"][~gone][10:400]
        )
    for name in ("wheel_speed_rl", "accel_x", "ref_velocity_y"):
        np.testing.assert_array_equal(faulty[name], sound[name])
    drift = faulty["accel_y"] - sound["accel_y"]
    assert drift[t < 1.99] == pytest.approx(0)
    assert drift[t > 2.01] == pytest.approx(0.1 * (t[t > 2.01] - 2.0), abs=2e-3)
    np.testing.assert_array_equal(faulty["yaw_rate"], -sound["yaw_rate"])


def test_a_jump_of_a_sensors_clock_leaves_a_gap_and_moves_what_follows(run: Run, folder: Path) -> None:
    """On the log's one time base: the fault acts before the signals come to it."""
    sound = simulated(run, folder / "a.parquet")
    late = simulated(run, folder / "b.parquet", "time_jump:steering_wheel:5::0.25")
    at = np.searchsorted(late.time, [6.0, 8.0])
    moved = late["steering_wheel"][at[0] + 25 : at[1] + 25]
    np.testing.assert_array_equal(moved, sound["steering_wheel"][at[0] : at[1]])
    assert np.isnan(late["steering_wheel"][502:524]).all()


def test_faults_are_told_and_stand_in_the_log(run: Run, folder: Path) -> None:
    path = folder / "c.parquet"
    end = run(*WORDS, "--out", path, "--json", "--fault", "spike:speed:3:2:5", "--fault", "stuck:brake")
    assert [f["kind"] for f in end.json["faults"]] == ["spike", "stuck"]
    wanted = {"channel": "speed", "start": 3.0, "duration": 2.0, "size": 5.0}
    assert wanted.items() <= end.json["faults"][0].items()
    assert Log.from_parquet(path).metadata["faults"] == end.json["faults"]
    assert run(*WORDS, "--out", path, "--json").json["faults"] == []


@pytest.mark.parametrize(
    ("fault", "what"),
    [
        ("dropout", "'dropout' is no fault; write KIND:CHANNEL"),
        ("dropout:", "is no fault"),
        ("drop:yaw_rate", "did you mean 'dropout'?"),
        ("spike:yaw_rat:3", "no measured channel is called 'yaw_rat'; did you mean 'yaw_rate'"),
        ("dropout:ref_*", "no measured channel is called 'ref_*'"),
        ("dropout:wheel_speed_x*", "no measured channel is called"),
        ("dropout:steer", "no signal 'steer' for a fault"),
        ("spike:yaw_rate:soon", "'soon' is no number"),
        ("spike:yaw_rate:1:1:1:1", "is no fault"),
        ("spike:yaw_rate:nan", "impossible figures"),
        ("dropout:yaw_rate:3:-1", "impossible figures"),
        ("dropout:yaw_rate:99", "begins at 99 s, the drive lasts from 0 to 13.37 s"),
        ("dropout:yaw_rate:-1", "begins at -1 s"),
        ("dropout:yaw_rate:3:1:5", "a dropout has no size"),
        ("time_jump:yaw_rate:3:1:5", "a time_jump is for good"),
    ],
)
def test_what_is_no_fault_is_one_line(run: Run, tmp_path: Path, fault: str, what: str) -> None:
    end = run(*WORDS, "--out", tmp_path / "x.csv", "--fault", fault)
    assert_refusal(end)
    assert what in end.err
    assert not list(tmp_path.iterdir())


def test_page_stands_beside_the_log(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("bokeh")
    end = run(*WORDS, "--out", tmp_path / "lane.csv.gz", "--report", "--json", "--fault", "stuck:brake:1")
    assert (end.status, end.err) == (0, "")
    assert end.json["report"] == str(tmp_path / "lane.html")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["lane.csv.gz", "lane.html"]
    page = (tmp_path / "lane.html").read_text("utf-8")
    assert "stuck:brake:1" in page
    assert "Friction circles" in page
    told = run(*WORDS, "--out", tmp_path / "lane.csv", "--report")
    assert f"report: {tmp_path / 'lane.html'}" in told.out


def test_report_without_bokeh_begins_nothing(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import importlib.util

    real = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *a: None if name == "bokeh" else real(name, *a)
    )
    end = run(*WORDS, "--out", tmp_path / "lane.csv", "--report")
    assert_refusal(end)
    assert "roadstate[report]" in end.err
    assert not list(tmp_path.iterdir())


def test_another_format_is_refused_before_the_drive(run: Run, tmp_path: Path) -> None:
    end = run(*WORDS, "--out", tmp_path / "lane.xlsx", "--report")
    assert_refusal(end)
    assert "cannot tell the format" in end.err
    assert not list(tmp_path.iterdir())
