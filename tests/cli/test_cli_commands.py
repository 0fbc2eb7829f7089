"""What the commands print and write."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_case import Run, csv, steady

from roadstate import __version__
from roadstate.cli import compare as compare_command
from roadstate.cli import runs
from roadstate.cli.console import console, figure
from roadstate.core import Estimates, is_bound
from roadstate.estimators import all_estimators, build, runnable
from roadstate.io import read_all, write
from roadstate.io.mapping import DEFAULT_MAPPING
from roadstate.metrics import Metrics, evaluate
from roadstate.run import scan
from roadstate.sim import simulate
from roadstate.vehicles import load_vehicle, presets

pytestmark = pytest.mark.usefixtures("optimised")

METRICS = {"mae", "rmse", "max", "nees", "coverage95", "settle_s", "n"}
FIGURES = {"unit", "mean", "std", "min", "max", "final", "final_std", "mean_std"}


def fits(text: str) -> bool:
    """Whether no line is wider than the terminal."""
    return max(len(line) for line in text.splitlines()) <= 80


def by_estimator(text: str) -> dict[str, list[str]]:
    """Rows of a table of :func:`metrics_table` under the name of each estimator."""
    found: dict[str, list[str]] = {}
    for line in map(str.rstrip, text.splitlines()):
        if line in all_estimators():
            found[line] = []
        elif found and line.startswith("  "):
            found[list(found)[-1]].append(line)
    return found


def test_compare_prints_one_object_with_the_figures_of_the_library(run: Run, drive_csv: Path) -> None:
    end = run("compare", drive_csv, "--vehicle", "family-car", "--settle", "2", "--json")
    assert (end.status, end.err) == (0, "")
    assert set(end.json) == {"drive"}
    log = DEFAULT_MAPPING.apply(read_all([drive_csv])).resample()
    assert set(end.json["drive"]) == set(runnable(log.available)) >= {"kmbe", "debe"}
    estimates = scan(build("kmbe", load_vehicle("family-car"), log.available), log)
    expected = evaluate(estimates, log, settle=2.0)
    assert end.json["drive"]["kmbe"] == {q: m.to_json() for q, m in expected.items()}
    for of in end.json["drive"].values():
        assert {"grade", "speed"} <= set(of)
        for figures in of.values():
            assert set(figures) > METRICS
            assert figures["n"] == 800


def test_compare_table_is_for_people(run: Run, drive_csv: Path) -> None:
    end = run("compare", drive_csv, "--vehicle", "family-car", "--estimator", "kmbe")
    assert (end.status, end.err) == (0, "")
    assert fits(end.out)
    assert "drive: 1000 samples from the start" in end.out
    assert compare_command.LEGEND in end.out
    row = by_estimator(end.out)["kmbe"][0]
    figures = run("compare", drive_csv, "--vehicle", "family-car", "-e", "kmbe", "--json").json["drive"][
        "kmbe"
    ]
    assert row.split()[:4] == [
        "grade",
        "%",
        f"{figures['grade']['mae']:.3f}",
        f"{figures['grade']['rmse']:.3f}",
    ]
    assert "debe" not in end.out


def test_no_figure_of_a_full_table_is_cut_off(capsys: pytest.CaptureFixture[str]) -> None:
    """Of the longest names there are, with figures as wide as they come."""
    errors = Metrics(
        unit="N", mae=1234.5, rmse=1345.6, max=12345.6, bias=-0.0123, mae_bias_removed=0.01234,
        correlation=-0.98765, nees=0.0012345, coverage95=1.0, settle_s=123.4, n=999999,
    )  # fmt: skip
    longest = {"friction_peak_right": replace(errors, unit="-"), "force_x_front": errors}
    console().print(compare_command.metrics_table("drive", {"friction-ukf": longest}, 0.0))
    shown = capsys.readouterr().out
    assert fits(shown)
    for row in [line for line in shown.splitlines() if "100%" in line]:
        figures = ["1234", "1346", "12346", "-0.012", "0.012", "-0.988", "0.001", "100%", "123.4"]
        assert row.split()[-9:] == figures
    assert shown.count("100%") == 2


def test_a_table_of_errors_beyond_all_use_keeps_its_columns(capsys: pytest.CaptureFixture[str]) -> None:
    errors = Metrics(
        unit="N", mae=1.234e30, rmse=5e26, max=1e30, bias=-1e30, mae_bias_removed=1e30,
        correlation=-0.98765, nees=1e60, coverage95=1.0, settle_s=123.4, n=999999,
    )  # fmt: skip
    missing = replace(errors, mae=math.inf, bias=math.nan, correlation=math.nan, coverage95=math.nan)
    found = {"friction_peak_right": replace(errors, unit="-"), "grade": replace(missing, settle_s=math.inf)}
    console().print(compare_command.metrics_table("drive", {"friction-ukf": found}, 0.0))
    shown = capsys.readouterr().out
    assert fits(shown)
    assert "1.2e+30 5.0e+26 1.0e+30 -1.0e+30 1.0e+30 -0.988 1.0e+60 100%  123.4" in shown
    assert next(x for x in shown.splitlines() if x.startswith("  grade")).split()[2:] == [
        "-", "5.0e+26", "1.0e+30", "-", "1.0e+30", "-", "1.0e+60", "-", "-",
    ]  # fmt: skip


def test_a_table_without_anything_to_compare_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    console().print(compare_command.metrics_table("drive", {}, 0.0))
    assert "drive: 0 samples from the start" in capsys.readouterr().out


@pytest.mark.parametrize("odd", [math.inf, -math.inf, math.nan])
def test_figures_that_are_not_finite_are_shown_as_none(
    run: Run, drive_csv: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, odd: float
) -> None:
    usual = runs._run_together

    def spoilt(*args: Any) -> list[Estimates]:
        [found] = usual(*args)
        grade, std = (np.array(of["grade"]) for of in (found.values, found.std))
        grade[100:200], std[50:] = odd, odd
        return [replace(found, values={**found.values, "grade": grade}, std={**found.std, "grade": std})]

    monkeypatch.setattr(runs, "_run_together", spoilt)
    words = ("estimate", drive_csv, "-v", "family-car", "-e", "kmbe", "-o", tmp_path / "o")
    end = run(*words)
    assert (end.status, end.err) == (0, "")
    [row] = [line.split() for line in end.out.splitlines() if line.startswith("grade %")]
    assert row[-1] == "-"
    assert all(math.isfinite(float(x)) for x in row[2:5])
    grade = run(*words, "--json").json["logs"]["drive"]["estimators"]["kmbe"]["quantities"]["grade"]
    assert (grade["final_std"], grade["mean_std"]) == (None, None)
    assert math.isfinite(grade["mean"])
    found = run("compare", drive_csv, "-v", "family-car", "-e", "kmbe", "--json").json["drive"]["kmbe"]
    assert found["grade"]["n"] == 900
    assert run("compare", drive_csv, "-v", "family-car", "-e", "kmbe").status == 0


def test_estimate_writes_files_and_a_summary_that_agree(run: Run, drive_csv: Path, tmp_path: Path) -> None:
    out = tmp_path / "new" / "results"
    end = run("estimate", drive_csv, "--vehicle", "family-car", "--out", out, "--json")
    assert (end.status, end.err) == (0, "")
    names = runnable(DEFAULT_MAPPING.apply(read_all([drive_csv])).resample().available)
    assert sorted(f.name for f in out.iterdir()) == [*(f"drive.{n}.parquet" for n in names), "summary.json"]
    summary = json.loads((out / "summary.json").read_text())
    assert summary == end.json
    assert summary["versions"]["roadstate"] == __version__
    assert summary["settings"]["vehicle"] == "family-car"
    assert summary["vehicle"]["mass"] == load_vehicle("family-car").mass
    log = summary["logs"]["drive"]
    assert (log["samples"], log["files"]) == (1000, ["drive.csv"])
    assert log["duration_s"] == pytest.approx(9.99)
    assert log["rate_hz"] == pytest.approx(100)
    for name in names:
        estimates = Estimates.from_parquet(out / f"drive.{name}.parquet")
        said = log["estimators"][name]
        assert set(said["quantities"]) == set(estimates.values)
        assert sum(said["validity"].values()) == pytest.approx(1)
        for quantity, figures in said["quantities"].items():
            values = estimates.values[quantity]
            assert set(figures) == FIGURES
            assert figures["mean"] == pytest.approx(np.mean(values))
            assert figures["final"] == values[-1]
            final = None if is_bound(quantity) else estimates.std[quantity][-1]
            assert figures["final_std"] == final
        assert said["nis_mean"] == pytest.approx(np.nanmean(estimates.nis))
        assert set(said["rejected"]) == set(estimates.sensors)
        assert log["metrics"][name]["grade"]["n"] == 1000


def test_estimate_prints_a_table_and_the_files(run: Run, drive_csv: Path, tmp_path: Path) -> None:
    out = tmp_path / "o"
    end = run("estimate", drive_csv, "--vehicle", "family-car", "-e", "kmbe", "--out", out)
    assert (end.status, end.err) == (0, "")
    table, legend, files = end.out.strip().split("\n\n")
    assert fits(table)
    assert fits(legend)
    assert re.match(r"drive, kmbe: .*excited \d+ %", table)
    assert "grade %" in table
    assert "grade deg" in table
    assert files.split() == [str(out / "drive.kmbe.parquet"), str(out / "summary.json")]


def test_bounds_stand_beside_what_they_bound(run: Run, drive_csv: Path, tmp_path: Path) -> None:
    end = run("estimate", drive_csv, "-v", "family-car", "-e", "joint", "-o", tmp_path / "o")
    assert (end.status, end.err) == (0, "")
    assert fits(end.out.partition("\n\n")[0])
    found = json.loads((tmp_path / "o" / "summary.json").read_text())["logs"]["drive"]["estimators"]["joint"]
    of = found["quantities"]
    row = next(line.split() for line in end.out.splitlines() if line.startswith("friction_peak_rear "))
    keys = [of["friction_peak_rear"][k] for k in ("mean", "min", "max", "mean_std")]
    bounds = [of[f"friction_peak_rear_{end}"]["mean"] for end in ("lower", "upper")]
    assert row[1:] == [figure(v) for v in (*keys, *bounds)]
    assert not [line for line in end.out.splitlines() if "_lower" in line or "_upper" in line]


def test_estimate_writes_a_report(run: Run, drive_csv: Path, tmp_path: Path) -> None:
    pytest.importorskip("bokeh")
    end = run("estimate", drive_csv, "-v", "family-car", "-e", "kmbe", "-o", tmp_path / "o", "--report")
    assert (end.status, end.err) == (0, "")
    page = (tmp_path / "o" / "drive.html").read_text(encoding="utf-8")
    assert page.lstrip().lower().startswith("<!doctype html>")
    assert "drive.csv" in page


def test_estimator_may_be_repeated(run: Run, drive_csv: Path, tmp_path: Path) -> None:
    out = tmp_path / "o"
    run("estimate", drive_csv, "-v", "family-car", "-e", "debe", "-e", "debe", "-e", "kmbe", "-o", out)
    found = json.loads((out / "summary.json").read_text())["logs"]["drive"]["estimators"]
    assert list(found) == ["debe", "kmbe"]


def test_files_of_one_drive_are_joined_in_time_order(
    run: Run, drive_csv: Path, two_parts: tuple[Path, Path]
) -> None:
    whole = run("compare", drive_csv, "-v", "family-car", "-e", "kmbe", "--json").json["drive"]
    joined = run("compare", *two_parts, "-v", "family-car", "-e", "kmbe", "--json").json
    assert joined == {"b_later": whole}


def test_separate_files_are_logs_of_their_own(run: Run, two_parts: tuple[Path, Path]) -> None:
    found = run("compare", *two_parts, "-v", "family-car", "-e", "kmbe", "--separate", "--json").json
    assert [(name, found[name]["kmbe"]["grade"]["n"]) for name in found] == [
        ("b_later", 500),
        ("a_earlier", 500),
    ]


def test_rate_resamples(run: Run, drive_csv: Path) -> None:
    found = run("compare", drive_csv, "-v", "family-car", "-e", "kmbe", "--rate", "20", "--json").json
    assert found["drive"]["kmbe"]["grade"]["n"] in (200, 201)


def test_mapping_names_channels_and_uses_the_wheel_radius(run: Run, tmp_path: Path) -> None:
    time = 0.01 * np.arange(300)
    file = csv(tmp_path / "trip.csv", "t [s],v_fl [km/h],a,slope [%]", [(t, 36.0, 0.0, 0.0) for t in time])
    mapping = tmp_path / "m.yaml"
    mapping.write_text(
        "time: {column: t}\n"
        "channels:\n  wheel_speed_fl: {from: v_fl}\n  accel_x: {from: a, unit: m/s^2}\n"
        "reference:\n  ref_grade: {from: slope}\n"
    )
    found = run(
        "estimate", file, "-v", "suv", "-m", mapping, "-e", "kmbe", "-o", tmp_path / "o", "--json"
    ).json
    quantities = found["logs"]["trip"]["estimators"]["kmbe"]["quantities"]
    assert quantities["speed"]["final"] == pytest.approx(10.0, abs=0.05)
    assert found["logs"]["trip"]["metrics"]["kmbe"]["grade"]["mae"] < 1.0
    assert found["settings"]["mapping"] == str(mapping)


def test_channels_table(run: Run, drive_csv: Path) -> None:
    end = run("channels", drive_csv)
    assert (end.status, end.err) == (0, "")
    assert fits(end.out)
    row = next(line for line in end.out.splitlines() if line.startswith("altitude"))
    assert row.split()[:4] == ["altitude", "✓", "m", "100"]
    assert row.endswith("99 %")
    assert "✓ by name" in end.out


def test_channels_json(run: Run, tmp_path: Path) -> None:
    speed = np.r_[np.full(10, np.nan), np.full(40, 5.0)]
    file = write(steady(speed=speed), tmp_path / "log.csv")
    found = run("channels", file, "--json").json
    assert found["files"] == [str(file)]
    assert found["problem"] is None
    signal = found["channels"]["speed"]
    assert signal["channels"] == ["speed"]
    assert (signal["unit"], signal["samples"], signal["min"], signal["max"]) == ("m/s", 50, 5.0, 5.0)
    assert signal["rate_hz"] == pytest.approx(100)
    assert signal["missing"] == pytest.approx(0.2)
    assert (signal["first_s"], signal["last_s"]) == (0.0, pytest.approx(0.49))


def test_channels_shows_what_a_mapping_makes_of_signals(run: Run, tmp_path: Path) -> None:
    file = csv(tmp_path / "log.csv", "time [s],v [km/h],speed [m/s]", [(0, 36, 10), (1, 36, 10)])
    mapping = tmp_path / "m.yaml"
    mapping.write_text("channels:\n  ref_velocity_x: {from: v}\n")
    found = run("channels", file, "--mapping", mapping, "--json").json["channels"]
    assert (found["v"]["channels"], found["speed"]["channels"]) == (["ref_velocity_x"], ["speed"])
    end = run("channels", file, "--mapping", mapping)
    assert " → ref_velocity_x" in end.out
    assert "2 signals, 2 canonical channels" in end.out


def test_channels_shows_a_log_that_cannot_be_used(run: Run, tmp_path: Path) -> None:
    file = csv(tmp_path / "log.csv", "time [s],speed [m/s]", [(0, 1), (2, 1), (1, 1)])
    end = run("channels", file)
    assert end.status == 0
    assert "not usable as it is: " in end.out
    assert "time runs backward at row 2" in " ".join(end.out.split())


def test_channels_points_to_the_draft_mapping(run: Run, tmp_path: Path) -> None:
    file = csv(tmp_path / "log.csv", "time [s],v [m/s]", [(0, 1), (2, 1)])
    assert "'roadstate channels FILE --suggest' drafts a mapping" in run("channels", file).out


def test_suggest_prints_a_mapping_that_works(run: Run, tmp_path: Path) -> None:
    rows = [(0.01 * i, 36.0, 0.1) for i in range(300)]
    file = csv(tmp_path / "log.csv", "time [s],VehicleSpeed [km/h],LongitudinalAcceleration [m/s^2]", rows)
    draft = run("channels", file, "--suggest")
    assert (draft.status, draft.err) == (0, "")
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text(draft.out)
    end = run("estimate", file, "-v", "suv", "-m", mapping, "-o", tmp_path / "o", "--json")
    assert (end.status, end.err) == (0, "")
    assert end.json["logs"]["log"]["channels"] == ["accel_x", "speed"]


def test_estimators_lists_all(run: Run) -> None:
    end = run("estimators")
    assert fits(end.out)
    assert {line.split()[0] for line in end.out.splitlines() if line[:1].isalpha()} >= set(all_estimators())
    found = run("estimators", "--json").json
    assert {n: e["summary"] for n, e in found.items()} == {n: e.summary for n, e in all_estimators().items()}
    assert all(need["what"] and need["alternatives"] for e in found.values() for need in e["needs"])


def test_vehicles_lists_all(run: Run) -> None:
    end = run("vehicles")
    assert fits(end.out)
    assert {line.split()[0] for line in end.out.splitlines() if line[:1].isalpha()} >= set(presets())
    assert {n: v["mass"] for n, v in run("vehicles", "--json").json.items()} == {
        n: v.mass for n, v in presets().items()
    }


def test_demo_needs_nothing_and_its_log_gives_its_table(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("bokeh")
    monkeypatch.chdir(tmp_path)
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    end = run("demo", "--open")
    assert (end.status, end.err) == (0, "")
    out = tmp_path / "roadstate-demo"
    assert sorted(f.name for f in out.iterdir()) == [
        "drive.csv", "drive.debe.parquet", "drive.joint.parquet", "drive.kmbe.parquet", "report.html",
        "summary.json",
    ]  # fmt: skip
    assert opened == [(out / "report.html").as_uri()]
    assert "a longitudinal point-mass model, not the full vehicle simulator" in " ".join(end.out.split())
    assert fits(end.out.partition("\n\nreport: ")[0])
    shown = by_estimator(end.out)
    assert [(name, len(rows)) for name, rows in shown.items()] == [("joint", 2), ("kmbe", 2), ("debe", 2)]
    again = run(*end.out.split("roadstate compare ")[-1].split("\n")[0].join(("compare ", "")).split())
    assert again.status == 0
    assert {name: by_estimator(again.out)[name] for name in shown} == shown


def test_demo_seed_changes_the_noise_only(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("bokeh")
    assert run("demo", "--out", tmp_path / "d", "--seed", "1").status == 0
    log = DEFAULT_MAPPING.apply(read_all([tmp_path / "d" / "drive.csv"])).resample()
    usual, same = (simulate(load_vehicle("family-car"), seed=seed) for seed in (0, 1))
    assert not np.allclose(log["accel_x"], usual["accel_x"], equal_nan=True)
    np.testing.assert_array_equal(log["accel_x"], same["accel_x"])
    np.testing.assert_array_equal(log["ref_grade"], usual["ref_grade"])
