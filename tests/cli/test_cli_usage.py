"""Wrong usage, defects, interruption, broken pipes, and help."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
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


def test_interruption_while_modules_are_imported() -> None:
    """Ctrl-C that comes with the first module which takes long to import."""
    program = """
import sys
class Stop:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] == 'numpy':
            raise KeyboardInterrupt
sys.meta_path.insert(0, Stop())
from roadstate.cli import main
sys.exit(main(['vehicles']))
"""
    end = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (end.returncode, end.stdout, end.stderr) == (130, "", "interrupted\n")


def test_the_package_imports_nothing_heavy_but_has_its_names() -> None:
    program = """
import json, sys
import roadstate, roadstate.cli
before = 'numpy' in sys.modules
from roadstate import *
from roadstate.core import Estimates as same
names = sorted(set(roadstate.__all__) & set(dir(roadstate)) & set(globals()))
from roadstate.estimators import build
import jax.numpy
print(json.dumps([before, names, same is Estimates, str(jax.numpy.zeros(1).dtype), hasattr(roadstate, 'x')]))
"""
    bare = {k: v for k, v in os.environ.items() if k != "JAX_ENABLE_X64"}
    end = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env=bare, check=True
    )
    names = ["Estimates", "InputError", "Log", "Recording", "Validity", "__version__"]
    assert json.loads(end.stdout) == [False, names, True, "float64", False]


def test_termination_cleans_up(
    run: Run, drive_csv: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[str] = []

    def told_twice(*args: object, **named: object) -> None:
        seen.extend(path.name[:11] for path in tmp_path.iterdir())
        try:
            os.kill(os.getpid(), signal.SIGTERM)
        finally:
            os.kill(os.getpid(), signal.SIGTERM)  # as by timeout(1): must not disturb the cleaning up

    def mine(*args: object) -> None:
        seen.append("mine")

    before = signal.signal(signal.SIGTERM, mine)
    try:
        monkeypatch.setattr("roadstate.cli.runs.run_log", told_twice)
        end = run("estimate", drive_csv, "-v", "family-car", "-o", tmp_path / "o")
    finally:
        after = signal.signal(signal.SIGTERM, before)
    assert (end.status, end.out, end.err) == (143, "", "terminated\n")
    assert seen == [".roadstate-"]
    assert list(tmp_path.iterdir()) == []
    assert after is mine


def test_other_threads_and_ignored_terminations_stay_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[object] = []
    monkeypatch.setattr(errors, "_run", lambda argv: seen.append(signal.getsignal(signal.SIGTERM)) or 0)
    before = signal.getsignal(signal.SIGTERM)
    thread = threading.Thread(target=errors.run, args=([],))
    thread.start()
    thread.join()
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        assert errors.run([]) == 0
    finally:
        signal.signal(signal.SIGTERM, before)
    assert errors.run([]) == 0
    assert seen[:2] == [before, signal.SIG_IGN]
    assert seen[2] not in (before, signal.SIG_IGN)


@pytest.mark.parametrize(
    "words",
    [
        ("estimate", "a.csv", "-v", "suv", "-o"), ("demo", "--out"), ("simulate", "braking", "-o"),
        ("calibrate", "a.csv", "-v", "suv", "-o"), ("papers", "none", "-o"), ("papers", "none", "--markdown"),
        ("tire", "a.tir", "--plot"),
    ],
)  # fmt: skip
def test_an_empty_path_to_write_is_refused(
    run: Run, words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    end = run(*words, "")
    assert_refusal(end)
    assert end.err.endswith(f": the path is empty; see 'roadstate {words[0]} --help'\n")


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


def test_broken_pipe_of_a_table_is_quiet_too() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    program = [sys.executable, "-m", "roadstate", "vehicles"]
    end = subprocess.run(program, stdout=writer, stderr=subprocess.PIPE, check=False)
    os.close(writer)
    assert (end.returncode, end.stderr) == (141, b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no device that is always full")
@pytest.mark.parametrize("words", [("vehicles",), ("estimators", "--json"), ("--help",)])
def test_a_full_standard_output_is_no_defect(words: tuple[str, ...]) -> None:
    with open("/dev/full", "w") as full:
        program = [sys.executable, "-m", "roadstate", *words]
        end = subprocess.run(program, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    said = "cannot write standard output (No space left on device)\n"
    assert (end.returncode, end.stderr) == (2, said)


def test_start_imports_nothing_heavy() -> None:
    heavy = "jax, pandas, pyarrow, asammdf, cantools, bokeh, pint, rich, yaml, scipy, matplotlib"
    program = (
        "import sys; from roadstate.cli import main; status = main(['estimate', '--help']); "
        f"print(sorted(set(sys.modules) & set('{heavy}'.split(', '))), file=sys.stderr); sys.exit(status)"
    )
    end = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert end.stderr.strip() in ("[]", "['rich']")  # older typers draw their help with rich
