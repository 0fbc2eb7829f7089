"""``estimate --smooth``: what it writes, what it says, what it refuses."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from cli_case import Run

from contracts.plausible import plausible_log
from roadstate.core import Estimates
from roadstate.estimators import all_estimators, build, runnable
from roadstate.io import read_all, write
from roadstate.io.mapping import DEFAULT_MAPPING
from roadstate.run import smooth
from roadstate.vehicles import load_vehicle


def test_the_files_are_those_of_the_library(run: Run, drive_csv: Path, tmp_path: Path) -> None:
    options = ("-v", "family-car", "-e", "kmbe", "--out", tmp_path, "--smooth")
    end = run("estimate", drive_csv, *options, "--json")
    assert (end.status, end.err) == (0, "")
    written = Estimates.from_parquet(tmp_path / "drive.kmbe.parquet")
    log = DEFAULT_MAPPING.apply(read_all([drive_csv])).resample()
    expected = smooth(build("kmbe", load_vehicle("family-car"), log.available), log)
    np.testing.assert_allclose(written.values["grade"], expected.values["grade"], rtol=1e-12)
    np.testing.assert_allclose(written.std["grade"], expected.std["grade"], rtol=1e-12)
    smoothed = ["grade", "speed", "altitude", "accel_x_bias"]
    assert written.metadata["smoothed"] == smoothed
    assert end.json["settings"]["smooth"] is True
    assert end.json["logs"]["drive"]["estimators"]["kmbe"]["smoothed"] == smoothed
    assert json.loads((tmp_path / "summary.json").read_text()) == end.json
    table = run("estimate", drive_csv, *options).out
    assert "smoothed: accel_x_bias, altitude, grade, speed; the rest as known" in table


def test_without_names_all_run_that_can(run: Run, drive_csv: Path, tmp_path: Path) -> None:
    end = run("estimate", drive_csv, "-v", "family-car", "--out", tmp_path, "--smooth", "--json")
    able = [name for name, kind in all_estimators().items() if kind.smoothable is not None]
    log = DEFAULT_MAPPING.apply(read_all([drive_csv])).resample()
    names = [name for name in runnable(log.available) if name in able]
    assert list(end.json["logs"]["drive"]["estimators"]) == names


def test_an_estimator_that_cannot_is_refused(refused: Callable[..., str], tmp_path: Path) -> None:

    log = write(plausible_log(load_vehicle("family-car"), 50), tmp_path / "all.csv")
    line = refused(log, "--estimator", "friction-ukf", "--smooth")
    assert line.endswith("'friction-ukf' cannot be smoothed; these can be: debe, joint, kmbe, tfobe")
