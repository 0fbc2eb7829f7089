"""The parts that commands are made of."""

from __future__ import annotations

import errno
import io
import json
import math
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadstate.cli import progress
from roadstate.cli.console import figure, plain, to_json
from roadstate.cli.logs import Source, stem
from roadstate.cli.outputs import staged, staged_file
from roadstate.core import InputError


@pytest.mark.parametrize(
    ("value", "digits", "shown"),
    [
        (0.012345, 3, "0.0123"), (1.2345, 3, "1.23"), (123456.0, 3, "123456"), (0.0, 3, "0"),
        (-0.5, 3, "-0.500"), (math.nan, 3, "-"), (None, 3, "-"), (1e9, 3, "1.00e+09"), (3e-6, 2, "3.0e-06"),
        (-math.inf, 3, "-"),
    ],
)  # fmt: skip
def test_figure(value: float | None, digits: int, shown: str) -> None:
    assert figure(value, digits) == shown


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.012345, "0.012"), (-0.5, "-0.500"), (12.345, "12.3"), (1234.5, "1234"), (3e-6, "0.000"),
        (9999999.0, "9999999"), (5e26, "5.00e+26"), (-1e30, "-1.00e+30"),
    ],
)  # fmt: skip
def test_figure_with_so_many_decimals_at_most(value: float, shown: str) -> None:
    assert figure(value, most=3) == shown


@given(st.floats(-1e300, 1e300))
def test_figure_is_short_and_near(value: float) -> None:
    shown = figure(value)
    assert len(shown) <= 10
    assert float(shown) == pytest.approx(value, rel=5.1e-3)


def test_json_of_numpy_values() -> None:
    content = {
        "a": np.float64(1.5),
        "b": np.arange(2),
        "c": math.inf,
        "d": (np.bool_(True), Path("x")),
        "e": None,
    }
    assert json.loads(to_json(content)) == {"a": 1.5, "b": [0, 1], "c": None, "d": [True, "x"], "e": None}
    assert plain({1: float("nan")}) == {"1": None}


@pytest.mark.parametrize(
    ("name", "expected"),
    [("drive.csv", "drive"), ("drive.CSV.GZ", "drive"), ("a.b.mf4", "a.b"), (".csv", ".csv"), ("log", "log")],
)
def test_stem(name: str, expected: str) -> None:
    assert stem(Path("folder") / name) == expected


def test_one_drive_is_named_after_its_first_file() -> None:
    files = (Path("b.csv"), Path("a.csv"))
    assert Source(files).groups() == {"b": files}
    assert Source(files, separate=True).groups() == {"b": files[:1], "a": files[1:]}


def test_staged_files_appear_together(tmp_path: Path) -> None:
    out = tmp_path / "a" / "b"
    with staged(out) as folder:
        (folder / "x").write_text("1")
        assert not out.exists()
    assert [f.name for f in out.iterdir()] == ["x"]
    assert [f.name for f in tmp_path.iterdir()] == ["a"]


def test_staged_files_vanish_together(tmp_path: Path) -> None:
    (tmp_path / "x").write_text("before")

    def interrupted() -> None:
        with staged(tmp_path) as folder:
            (folder / "x").write_text("after")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert [f.name for f in tmp_path.iterdir()] == ["x"]
    assert (tmp_path / "x").read_text() == "before"


def test_full_disk_is_bad_input_and_other_failures_are_not(tmp_path: Path) -> None:
    message = r"cannot write \(no space left on device\); choose another folder"
    with pytest.raises(InputError, match=message), staged(tmp_path / "o"):
        raise OSError(errno.ENOSPC, "No space left on device")
    with pytest.raises(ConnectionError), staged(tmp_path / "o"):
        raise ConnectionError


def test_a_staged_file_appears_with_its_folders_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b.yaml"

    def interrupted() -> None:
        with staged_file(path) as temporary:
            temporary.write_text("1")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []
    with staged_file(path) as temporary:
        temporary.write_text("2")
    assert path.read_text() == "2"
    assert [f.name for f in tmp_path.rglob("*")] == ["a", "b.yaml"]
    with pytest.raises(InputError, match="is a folder; give the name of a file in it"), staged_file(tmp_path):
        pass


def test_a_name_that_cannot_be_one_is_bad_input(tmp_path: Path) -> None:
    for block in (staged(tmp_path / ("x" * 300)), staged_file(tmp_path / ("x" * 300))):
        with pytest.raises(InputError, match=r"cannot write \(file name too long\)"), block as made:
            Path(made).write_text("1")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_the_way_is_found_before_anything_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "b.parquet").mkdir()
    (tmp_path / "a.parquet").write_text("before")

    def write() -> None:
        with staged(tmp_path) as folder:
            for name in ("a.parquet", "b.parquet", "summary.json"):
                (folder / name).write_text("after")

    with pytest.raises(InputError, match=r"b\.parquet: is a folder; move it, or choose another folder"):
        write()
    assert sorted(f.name for f in tmp_path.iterdir()) == ["a.parquet", "b.parquet"]
    assert (tmp_path / "a.parquet").read_text() == "before"


@pytest.mark.parametrize("target", ["nowhere", "out"])
def test_a_link_to_nothing_is_refused_before_the_work(tmp_path: Path, target: str) -> None:
    out = tmp_path / "out"
    out.symlink_to(tmp_path / target)
    for place in (out, out / "deeper"):
        message = r"out: is a link to nothing; name a folder with --out"
        with pytest.raises(InputError, match=message), staged(place):
            pytest.fail("the work has begun")


@pytest.mark.parametrize("number", [errno.EEXIST, errno.ELOOP, errno.ENOTDIR])
def test_a_folder_that_another_took_meanwhile_is_bad_input(tmp_path: Path, number: int) -> None:
    with pytest.raises(InputError, match="cannot write"), staged(tmp_path / "o"):
        raise OSError(number, "in the way")


class Terminal(io.StringIO):
    """A standard error that is a terminal."""

    def isatty(self) -> bool:
        return True


def test_short_work_shows_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stderr", screen := Terminal())
    with progress.working() as work:
        work.begin("reading")
        work.advance(1, 2)
    assert screen.getvalue() == ""


def test_long_work_shows_itself_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "_PATIENCE", 0.0)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("sys.stderr", screen := Terminal())
    with progress.working() as work:
        work.begin("drive: kmbe [odd name]")
        for _ in range(500):
            if work._bar is not None:
                break
            time.sleep(0.01)
        work.advance(50, 100)
    assert "drive: kmbe [odd name]" in screen.getvalue()


def test_long_work_shows_nothing_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "_PATIENCE", 0.0)
    monkeypatch.setattr("sys.stderr", stream := io.StringIO())
    with progress.working() as work:
        work.begin("reading")
        time.sleep(0.05)
    assert stream.getvalue() == ""
