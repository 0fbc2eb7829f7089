"""Wrong usage, defects, interruption, broken pipes, and help."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from cli_case import Run, assert_refusal

from roadstate import __version__
from roadstate.cli import errors

COMMANDS = ("demo", "channels", "estimate", "compare", "estimators", "vehicles")


@pytest.mark.parametrize(
    ("argv", "fault", "command"),
    [
        (("estimat",), "No such command 'estimat'", ""),
        (("estimate", "a.csv", "-o", "x"), "Missing option '--vehicle' / '-v'", " estimate"),
        (("estimate", "-v", "suv", "-o", "x"), "Missing argument", " estimate"),
        (("channels", "--foo"), "No such option: --foo", " channels"),
        (("vehicles", "extra"), "Got unexpected extra argument", " vehicles"),
        (("channels", "a.csv", "--json", "--suggest"), "give one of '--suggest' and '--json'", " channels"),
    ],
)
def test_wrong_usage_is_one_line(run: Run, argv: tuple[str, ...], fault: str, command: str) -> None:
    end = run(*argv)
    assert_refusal(end)
    assert fault in end.err  # the rest of it is typer's wording
    assert end.err.endswith(f" see 'roadstate{command} --help'\n")


@pytest.mark.parametrize(("option", "value"), [("--rate", "fast"), ("--settle", "soon")])
def test_value_that_is_no_number(run: Run, option: str, value: str) -> None:
    end = run("compare", "a.csv", "--vehicle", "suv", option, value)
    assert_refusal(end)
    assert end.err.startswith(f"Invalid value for '{option}': ")
    assert end.err.endswith("; see 'roadstate compare --help'\n")


def test_negative_settle(run: Run) -> None:
    end = run("compare", "a.csv", "--vehicle", "suv", "--settle", "-3")
    assert_refusal(end)
    assert end.err == "--settle -3 is out of range; give 0 seconds or more\n"


def test_no_command_shows_them_but_is_no_success(run: Run) -> None:
    end = run()
    assert end.status == 2
    assert all(command in end.out for command in COMMANDS)
    assert end.err == "no command given; they are listed above\n"


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_fits_80_columns(run: Run, command: str) -> None:
    end = run(*command.split(), "--help")
    assert (end.status, end.err) == (0, "")
    assert end.out.startswith(f"Usage: roadstate {command}".rstrip())
    assert max(len(line) for line in end.out.splitlines()) <= 80
    assert "..." not in end.out.partition("Commands:")[2]  # no summary is cut off


def test_version(run: Run) -> None:
    assert run("--version").out == f"roadstate {__version__}\n"


def test_defect_is_one_line_and_exit_1(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise RuntimeError("two\nlines")

    monkeypatch.setattr("roadstate.vehicles.presets", broken, raising=False)
    end = run("vehicles")
    assert (end.status, end.out) == (1, "")
    assert end.err == (
        "defect in roadstate: RuntimeError: two lines; set ROADSTATE_TRACEBACK=1 for the traceback\n"
    )
    monkeypatch.setenv("ROADSTATE_TRACEBACK", "1")
    assert errors.run(["vehicles"]) == 1


def test_traceback_on_request(
    run: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ROADSTATE_TRACEBACK", "1")
    assert errors.run(["channels", "nowhere.csv"]) == 2
    printed = capsys.readouterr().err
    assert printed.startswith("Traceback (most recent call last):")
    assert printed.endswith("nowhere.csv: no such file; check the path\n")


def test_interruption(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("roadstate.vehicles.presets", interrupted, raising=False)
    end = run("vehicles")
    assert (end.status, end.out, end.err) == (130, "", "interrupted\n")


def test_missing_optional_package_says_how_to_install_it(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    import importlib.util

    found = importlib.util.find_spec
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "bokeh" else found(name))
    end = run("demo", "--out", tmp_path / "demo")
    assert_refusal(end)
    assert end.err == (
        "this needs the package 'bokeh', which is not installed; pip install 'roadstate[report]'\n"
    )
    assert not (tmp_path / "demo").exists()


def test_module_runs_as_the_program_does() -> None:
    end = subprocess.run(
        [sys.executable, "-m", "roadstate", "estimate", "x.csv"], capture_output=True, text=True, check=False
    )
    assert (end.returncode, end.stdout) == (2, "")
    assert end.stderr.endswith("see 'roadstate estimate --help'\n")
    assert end.stderr.count("\n") == 1


def test_broken_pipe_is_quiet() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    end = subprocess.run(
        [sys.executable, "-m", "roadstate", "vehicles", "--json"],
        stdout=writer,
        stderr=subprocess.PIPE,
        check=False,
    )
    os.close(writer)
    assert end.returncode == 141
    assert end.stderr == b""


def test_start_imports_nothing_heavy() -> None:
    heavy = "jax, pandas, pyarrow, asammdf, cantools, bokeh, pint, rich, yaml, scipy, matplotlib"
    program = (
        "import sys; from roadstate.cli import main; status = main(['estimate', '--help']); "
        f"print(sorted(set(sys.modules) & set('{heavy}'.split(', '))), file=sys.stderr); sys.exit(status)"
    )
    end = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert end.stderr.strip() in ("[]", "['rich']")  # older typers draw their help with rich
