"""Reading and writing by path: choice of format, joining, and paths that hold no log."""

from __future__ import annotations

import os
import subprocess
import sys
import types
from pathlib import Path

import numpy as np
import pytest

import roadstate.io
from roadstate.core import CHANNELS, InputError, Log
from roadstate.io import all_formats, read, read_all, write
from roadstate.io.formats import Format, format_of

SUFFIXES = [".csv", ".csv.gz", ".parquet", ".mf4"]


def example(start: float = 0.0, n: int = 50) -> Log:
    rng = np.random.default_rng(int(start) + n)
    time = start + np.arange(n) * 0.01 + rng.uniform(0, 1e-3, n)
    channels = {name: rng.normal(size=n) * 10.0 ** rng.integers(-8, 8) for name in list(CHANNELS)[1:9]}
    channels["speed"][3] = np.nan
    channels["accel_x"][:] = np.nan
    return Log(time, channels, {"vehicle": "compact"})


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_written_log_reads_back_the_same_with_its_units(tmp_path: Path, suffix: str) -> None:
    log = example()
    path = tmp_path / f"drive{suffix}"
    assert write(log, path) == path
    recording = read(path)
    assert set(recording) == set(log.channels)
    assert recording.is_common_base
    for name, values in log.channels.items():
        np.testing.assert_array_equal(recording[name].values, values)
        np.testing.assert_array_equal(recording[name].time, log.time)
        assert recording[name].unit == CHANNELS[name].unit
        assert recording[name].source == f"{path.name}:{name}"
    assert recording.metadata["files"] == [str(path)]
    assert recording.metadata["format"] in {"CSV", "MF4", "Parquet"}
    assert "start_time" not in recording.metadata
    again = recording.resample()
    np.testing.assert_array_equal(again.time, log.time)
    assert os.listdir(tmp_path) == [path.name], "nothing is left beside the file"


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_content_tells_the_format_whatever_the_name(tmp_path: Path, suffix: str) -> None:
    path = write(example(), tmp_path / f"drive{suffix}")
    renamed = path.rename(tmp_path / "drive.log")
    assert read(renamed)["speed"].unit == "m/s"


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_same_log_gives_the_same_numbers_over_an_older_file(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"drive{suffix}"
    path.write_bytes(b"old")
    write(example(), path)
    assert len(read(path)) == 8
    assert path.stat().st_mode & 0o400


def test_files_of_several_formats_join_in_time_order(tmp_path: Path) -> None:
    parts = [example(start) for start in (0.0, 10.0, 20.0, 30.0)]
    paths = [write(p, tmp_path / f"part{i}{s}") for i, (p, s) in enumerate(zip(parts, SUFFIXES, strict=True))]
    together = read_all(paths[::-1])
    np.testing.assert_array_equal(together["speed"].time, np.concatenate([p.time for p in parts]))
    np.testing.assert_array_equal(together["steer"].values, np.concatenate([p["steer"] for p in parts]))
    assert together.metadata["files"] == [str(p) for p in paths]
    with pytest.raises(InputError, match="give files of one drive"):
        read_all([paths[0], paths[0]])
    with pytest.raises(InputError, match="no log file given"):
        read_all([])


def test_every_format_is_discovered_and_complete() -> None:
    names = {f.name for f in all_formats()}
    assert names == {"CSV", "MF4", "Parquet"}
    for f in all_formats():
        assert f.suffixes
        assert all(s.startswith(".") and s == s.lower() for s in f.suffixes)
        assert f.description
        assert "\n" not in f.description


def test_a_module_without_a_format_is_a_defect(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "half.py").write_text("")
    monkeypatch.setattr(roadstate.io.formats, "__path__", [*roadstate.io.formats.__path__, str(tmp_path)])
    all_formats.cache_clear()
    try:
        with pytest.raises(TypeError, match=r"half must define FORMAT"):
            all_formats()
    finally:
        all_formats.cache_clear()


def test_a_new_format_is_one_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "lines.py").write_text(
        "import numpy as np\n"
        "from roadstate.core import Recording, Signal\n"
        "from roadstate.io.formats import Format\n"
        "def read(path, options):\n"
        "    values = np.array(path.read_text().split()[1:], dtype=float)\n"
        "    return Recording({'speed': Signal(np.arange(len(values)) * 1.0, values, 'm/s')})\n"
        "FORMAT = Format('lines', 'a number a line', ('.lines',), lambda h: h.startswith(b'LINES'), read)\n"
    )
    log = tmp_path / "a.lines"
    log.write_text("LINES\n1\n2\n")
    monkeypatch.setattr(roadstate.io.formats, "__path__", [*roadstate.io.formats.__path__, str(tmp_path)])
    all_formats.cache_clear()
    try:
        assert [f.name for f in all_formats()] == ["CSV", "MF4", "Parquet", "lines"]
        recording = read(log)
        assert recording.metadata == {"files": [str(log)], "format": "lines"}
        np.testing.assert_array_equal(recording["speed"].values, [1, 2])
        with pytest.raises(InputError, match="cannot tell the format"):
            write(example(), tmp_path / "b.lines")
    finally:
        all_formats.cache_clear()


def test_a_path_that_is_no_log_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "empty.csv").touch()
    (tmp_path / "noise.bin").write_bytes(np.random.default_rng(0).bytes(3000))
    os.mkfifo(tmp_path / "pipe.csv")
    for name, message in {
        "none.csv": "no such file; check the path",
        ".": "is a folder; name a file in it",
        "empty.csv": "the file is empty",
        "pipe.csv": "not a regular file",
        "noise.bin": "the content is of no known log format; convert it to one of CSV (.csv)",
        "x" * 300: "cannot be read (file name too long)",
    }.items():
        path = tmp_path / name
        with pytest.raises(InputError) as refusal:
            read(path)
        assert str(refusal.value).startswith(f"{path}: {message}")


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may read everything")
def test_a_file_without_the_right_to_read_it_is_refused(tmp_path: Path) -> None:
    path = write(example(), tmp_path / "drive.csv")
    path.chmod(0)
    with pytest.raises(
        InputError, match=r"cannot be read \(permission denied\); check the path and its rights"
    ):
        read(path)


def test_a_right_that_is_missing_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(example(), tmp_path / "drive.csv")

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(InputError, match=r"drive\.csv: cannot be read \(permission denied\)"):
        read(path)


def test_a_name_that_promises_another_format_is_mentioned(tmp_path: Path) -> None:
    path = tmp_path / "drive.mf4"
    path.write_text("hello\nworld\n")
    with pytest.raises(InputError) as refusal:
        read(path)
    assert "(its content looks like CSV)" in str(refusal.value)
    assert format_of(path).name == "CSV"


@pytest.mark.parametrize("name", ["drive.xlsx", "drive", "drive.mf3"])
def test_an_unknown_suffix_cannot_be_written(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"cannot tell the format from .*; use \.csv, \.csv\.gz"):
        write(example(), tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_folder_that_does_not_exist_is_named(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(InputError, match="cannot write"):
        write(example(), tmp_path / "none" / f"drive{suffix}")


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".mf4"])
def test_a_write_that_fails_leaves_nothing(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"drive{suffix}"
    path.write_bytes(b"old")

    def fail(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(OSError, match="No space left"):
        write(example(), path)
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == [path.name]


def test_a_single_dbc_need_not_be_in_a_list(tmp_path: Path) -> None:
    path = write(example(), tmp_path / "drive.mf4")
    with pytest.raises(InputError, match=r"bus\.dbc: no such file"):
        read(path, dbc=str(tmp_path / "bus.dbc"))


def test_a_submodule_does_not_hide_the_function_of_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    module = types.ModuleType("roadstate.io.suggest")
    module.suggest = len  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "roadstate.io.suggest", module)
    roadstate.io.suggest = module  # type: ignore[assignment]  # as an import of the submodule does
    assert roadstate.io.suggest is len


def test_names_are_exported_lazily() -> None:
    assert isinstance(all_formats()[0], Format)
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = roadstate.io.nothing


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_log_in_si_units_loads_neither_pandas_nor_the_unit_library(suffix: str, tmp_path: Path) -> None:
    """Half a second of whoever waits for a short log."""
    speed = 10 + np.arange(300) / 100
    channels = {"speed": speed.copy(), "wheel_speed_rl": speed / 0.3, "accel_z": np.full(300, 9.81)}
    channels["speed"][7] = np.nan
    path = write(Log(np.arange(300) / 100, channels), tmp_path / f"a{suffix}")
    program = (
        "import sys; from roadstate.io import read; from roadstate.io.mapping import DEFAULT_MAPPING; "
        "log = DEFAULT_MAPPING.apply(read(sys.argv[1]), wheel_radius=0.3).resample(); "
        "print(len(log), sorted(log.channels), sorted({'pandas', 'pint'} & set(sys.modules)))"
    )
    end = subprocess.run([sys.executable, "-c", program, path], capture_output=True, text=True, check=True)
    assert end.stdout.strip() == f"300 {sorted(channels)} []"
