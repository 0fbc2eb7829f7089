"""MF4 files that are cut short or damaged: read or refused, and never heard of otherwise."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mdf_files import DBC, raw_group, save

from roadstate.core import Log
from roadstate.io import read, write


@pytest.fixture
def dbc(tmp_path: Path) -> Path:
    path = tmp_path / "bus.dbc"
    path.write_text(DBC)
    return path


PROBE = """
import sys
from roadstate.core import InputError
from roadstate.io import read
read_well = 0
for name in sys.stdin.read().split("\\n"):
    try:
        read(name, dbc=sys.argv[1:])
        read_well += 1
    except InputError as refusal:
        assert str(refusal).startswith(name), refusal
print(read_well)
"""


def read_all_alone(contents: list[bytes], folder: Path, dbc: list[Path]) -> int:
    """Reads each content in a process of its own; how many could be read.

    asammdf prints from finalisers and its compiled parts may crash: only another process shows either.
    """
    paths = [folder / f"bad{i}.mf4" for i in range(len(contents))]
    for path, content in zip(paths, contents, strict=True):
        path.write_bytes(content)
    result = subprocess.run(
        [sys.executable, "-c", PROBE, *map(str, dbc)],
        input="\n".join(map(str, paths)),
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (result.returncode, result.stderr) == (0, "")
    return int(result.stdout)


def cut_and_read(source: Path, folder: Path, dbc: list[Path], lengths: list[int]) -> int:
    whole = source.read_bytes()
    return read_all_alone([whole[:length] for length in lengths], folder, dbc)


def some_lengths(size: int, n: int = 25) -> list[int]:
    rng = np.random.default_rng(size)
    fixed = [1, 7, 63, 64, 100, 167, 168, 200, 1000, size - 1000, size - 9, size - 1]
    return sorted({k for k in [*fixed, *rng.integers(1, size, n).tolist()] if 0 < k < size})


def test_a_finished_file_cut_anywhere_is_refused_in_silence(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    log = Log(np.arange(20000) / 100, {n: rng.normal(size=20000) for n in ("speed", "steer", "accel_x")})
    path = write(log, tmp_path / "a.mf4")
    assert cut_and_read(path, tmp_path, [], some_lengths(path.stat().st_size)) == 0


def test_a_raw_log_cut_anywhere_is_refused_in_silence(tmp_path: Path, dbc: Path) -> None:
    data = np.random.default_rng(0).integers(0, 256, (5000, 8))
    path = save(tmp_path / "a.mf4", raw_group([256] * 5000, data))
    assert cut_and_read(path, tmp_path, [dbc], some_lengths(path.stat().st_size)) == 0


def damaged(whole: bytes, count: int, seed: int) -> list[bytes]:
    rng = np.random.default_rng(seed)
    out = []
    for _ in range(count):
        content = bytearray(whole)
        end = len(whole) if rng.random() < 0.5 else min(len(whole), 9000)  # where the structure is
        for position in rng.integers(8, end, rng.integers(1, 10)):
            content[position] = rng.choice([0, 1, 127, 255, rng.integers(256)])
        out.append(bytes(content))
    return out


def test_damaged_bytes_read_or_are_refused(tmp_path: Path, dbc: Path) -> None:
    data = np.random.default_rng(0).integers(0, 256, (50, 8))
    whole = save(tmp_path / "a.mf4", raw_group([256] * 50, data)).read_bytes()
    assert 5 < read_all_alone(damaged(whole, 60, 7), tmp_path, [dbc]) < 55


def test_a_damaged_real_log_reads_or_is_refused(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "css_mf4" / "other"
    whole = (folder / "j1939_fcbf0606.MF4").read_bytes()
    demo = folder / "CSS-Electronics-SAE-J1939-DEMO.dbc"
    assert 10 < read_all_alone(damaged(whole, 60, 1), tmp_path, [demo]) < 59


def test_a_real_finished_file_cut_anywhere_is_refused_in_silence(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "css_mf4"
    path = folder / "00000005-60FEB5A8.MF4"
    lengths = some_lengths(path.stat().st_size, 15)
    assert cut_and_read(path, tmp_path, [folder / "canmod-gps.dbc"], lengths) == 0


def test_an_unfinished_file_gives_what_was_written_before_the_cut(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "css_mf4" / "other"
    source = folder / "j1939_fcbf0606.MF4"
    demo = [folder / "CSS-Electronics-SAE-J1939-DEMO.dbc"]
    whole = read(source, dbc=demo)["EEC1.EngineSpeed"]
    assert cut_and_read(source, tmp_path, demo, [12000, 40000, 72819]) == 3
    (tmp_path / "cut.mf4").write_bytes(source.read_bytes()[:40000])
    part = read(tmp_path / "cut.mf4", dbc=demo)["EEC1.EngineSpeed"]
    assert 0 < len(part) < len(whole)
    np.testing.assert_array_equal(part.time, whole.time[: len(part)])
    assert cut_and_read(source, tmp_path, demo, [1, 63, 100, 500, 3000, 7000]) == 0
