"""The commands that the documentation shows, run as they stand there."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest
from cli_case import Run

from roadstate.tires.mf_build import PASSENGER

ROOT = Path(__file__).resolve().parent.parent.parent
PAGE = (ROOT / "docs" / "command-line.md").read_text(encoding="utf-8")
COMMANDS = [
    line for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL) for line in block.splitlines() if line
]


def is_real(command: str) -> bool:
    """Whether a command needs a recording that does not come with the project."""
    return "examples/" in command


def test_tutorial_runs(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("bokeh")
    monkeypatch.chdir(tmp_path)
    shutil.copy(PASSENGER, tmp_path / "car.tir")
    commands = [c for c in COMMANDS if not is_real(c)]
    assert len(commands) >= 4
    for command in commands:
        program, *argv = shlex.split(command)
        assert program == "roadstate"
        end = run(*argv)
        assert (end.status, end.err) == (0, ""), command
    assert (tmp_path / "results" / "drive.html").is_file()


@pytest.mark.parametrize("command", [c for c in COMMANDS if is_real(c)], ids=["comma2k19", "css_mf4"])
def test_real_recordings_run(
    run: Run, shared_data: Path, command: str, request: pytest.FixtureRequest
) -> None:
    """Grade of real cars by the shipped mapping and vehicle files.

    The bounds on the bias-removed error of KMBE are what a plain, non-causal difference of accelerometer and
    speed reaches on the same recordings, and a half more.
    """
    pytest.importorskip("asammdf")
    if "css_mf4" in command:  # five long logs of few channels
        request.getfixturevalue("optimised")
    words = [
        str(ROOT / w) if w.startswith("examples/") else str(shared_data / w) if "/" in w else w
        for w in shlex.split(command)[1:]
    ]
    end = run(*words, "--json")
    assert (end.status, end.err) == (0, "")
    [(log, found)] = end.json.items()
    assert set(found) >= {"debe", "kmbe"}
    plain = {"segment40_decoded_50Hz": 0.41, "00000001-60FE3F04": 0.90}[log]
    assert found["kmbe"]["grade"]["mae_bias_removed"] < 1.5 * plain
    assert found["kmbe"]["grade"]["n"] > 2000


def test_every_command_has_a_line_in_the_table(run: Run) -> None:
    listed = re.findall(r"^  (\w+)  ", run("--help").out.partition("Commands:")[2], re.MULTILINE)
    assert len(listed) >= 7
    for command in listed:
        assert re.search(rf"^\| `{command}[ `]", PAGE, re.MULTILINE)
