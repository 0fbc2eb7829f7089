"""Running commands in this process, and small logs to run them on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cli_case import NOISE, Outcome, Run, assert_refusal

from roadstate.cli import main
from roadstate.core import Log
from roadstate.io import write
from roadstate.sim import SpeedPlan, simulate
from roadstate.vehicles import load_vehicle


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """Call the command line in this process, as a terminal of 80 columns would show it."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.delenv("ROADSTATE_TRACEBACK", raising=False)

    def call(*argv: str | Path) -> Outcome:
        capsys.readouterr()
        status = main([str(word) for word in argv])
        printed = capsys.readouterr()
        return Outcome(status, printed.out, printed.err)

    return call


@pytest.fixture
def refused(run: Run, tmp_path: Path) -> Callable[..., str]:
    """The one line with which ``estimate`` refuses; checks that it does so cleanly."""

    def call(*argv: str | Path, vehicle: str | Path = "family-car") -> str:
        out = tmp_path / "results"
        end = run("estimate", *argv, "--vehicle", vehicle, "--out", out)
        assert_refusal(end)
        assert not out.exists()
        assert not list(tmp_path.glob(".roadstate-*"))
        return end.err.rstrip("\n").replace(f"{tmp_path}/", "")

    return call


@pytest.fixture(scope="session")
def drive() -> Log:
    """Ten seconds of a simulated drive."""
    return simulate(load_vehicle("family-car"), SpeedPlan((0.0, 5.0, 10.0), (9.0, 9.0, 12.0)), seed=5)


@pytest.fixture(scope="session")
def drive_csv(drive: Log, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same as a file that needs no mapping."""
    return write(drive, tmp_path_factory.mktemp("logs") / "drive.csv")


@pytest.fixture(scope="session")
def two_parts(drive: Log, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The same in two files, the later half first."""
    folder = tmp_path_factory.mktemp("parts")
    later = write(drive.between(5.0, 11.0), folder / "b_later.csv")
    return later, write(drive.between(0.0, 5.0), folder / "a_earlier.csv")


@pytest.fixture(scope="session")
def noisy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A minute of driving with a speed signal of known noise."""
    random = np.random.default_rng(5)
    time = np.arange(0.0, 60.0, 0.05)
    speed = 20 + 5 * np.sin(0.3 * time) + NOISE * random.normal(size=len(time))
    accel = 1.5 * np.cos(0.3 * time) + 0.13 * random.normal(size=len(time))
    return write(
        Log(time, {"speed": speed, "accel_x": accel}), tmp_path_factory.mktemp("noisy") / "noisy.csv"
    )
