"""Headers with units, files that appear whole or not at all, and Parquet files of strangers."""

from __future__ import annotations

import os
import stat
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadstate.core import InputError, Log
from roadstate.core.tabular import Column, atomic_path, from_parquet, split_header, to_parquet


@pytest.mark.parametrize(
    ("text", "name", "unit"),
    [
        ("speed [km/h]", "speed", "km/h"),
        ("speed[km/h]", "speed", "km/h"),
        ("  speed   [km/h]  ", "speed", "km/h"),
        ("speed", "speed", None),
        ("speed []", "speed", ""),
        ("[km/h]", "", "km/h"),
        ("", "", None),
        ("a [b] [c]", "a [b]", "c"),
        ("a [b] c", "a [b] c", None),
        ("speed [km/h", "speed [km/h", None),
        ("speed km/h]", "speed km/h]", None),
        ("x [a]]", "x [a]]", None),
        ("Wheel speed\nfront [rad/s]", "Wheel speed front", "rad/s"),
    ],
)
def test_a_header_is_a_name_and_a_unit(text: str, name: str, unit: str | None) -> None:
    assert split_header(text) == (name, unit)


@given(st.text(max_size=50))
def test_any_header_is_split(text: str) -> None:
    name, unit = split_header(text)
    assert name == name.strip()
    assert unit is None or not set(unit) & set("[]")


@pytest.mark.parametrize(
    "text", [" " * 100_000 + "[", "a" + " " * 100_000 + "b", "[" * 100_000, "[ " * 50_000]
)
def test_a_hostile_header_takes_no_time(text: str) -> None:
    start = time.perf_counter()
    split_header(text)
    assert time.perf_counter() - start < 0.5


class TestAtomicPath:
    def test_the_file_appears_with_the_block_done(self, tmp_path: Path) -> None:
        path = tmp_path / "out.txt"
        path.write_text("old")
        with atomic_path(path) as temporary:
            temporary.write_text("new")
            assert path.read_text() == "old"
            assert temporary.parent == tmp_path
        assert path.read_text() == "new"
        assert os.listdir(tmp_path) == ["out.txt"]

    @pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt, SystemExit])
    def test_a_failure_leaves_nothing(self, tmp_path: Path, failure: type[BaseException]) -> None:
        path = tmp_path / "out.txt"

        def fail() -> None:
            with atomic_path(path) as temporary:
                temporary.write_text("half")
                raise failure

        with pytest.raises(failure):
            fail()
        assert os.listdir(tmp_path) == []
        path.write_text("old")
        with pytest.raises(failure):
            fail()
        assert path.read_text() == "old"

    def test_permissions_are_those_of_any_new_file(self, tmp_path: Path) -> None:
        plain = tmp_path / "plain"
        plain.touch()
        with atomic_path(tmp_path / "out"):
            pass
        assert stat.S_IMODE((tmp_path / "out").stat().st_mode) == stat.S_IMODE(plain.stat().st_mode)

    def test_the_longest_name_a_file_can_have(self, tmp_path: Path) -> None:
        with atomic_path(tmp_path / ("x" * 255)):
            pass
        assert os.listdir(tmp_path) == ["x" * 255]

    def test_where_nothing_can_be_written_it_says_so(self, tmp_path: Path) -> None:
        for path, message in [
            (
                tmp_path / "no" / "out.txt",
                r"out.txt: cannot write \(No such file or directory\); choose another",
            ),
            (tmp_path, "is a folder; give the name of a file in it"),
        ]:
            with pytest.raises(InputError, match=message), atomic_path(path):
                pytest.fail("the block must not run")


def test_a_failed_write_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = Log(np.arange(3.0), {"speed": np.ones(3)})

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pq, "write_table", full)
    with pytest.raises(OSError, match="No space left"):
        log.to_parquet(tmp_path / "a.parquet")
    assert os.listdir(tmp_path) == []


class TestForeignParquet:
    @pytest.mark.parametrize("content", [b"", b"PAR1", b"PAR1" + b"\0" * 100 + b"PAR1", b"time,speed\n0,1\n"])
    def test_no_parquet_file(self, tmp_path: Path, content: bytes) -> None:
        path = tmp_path / "x.parquet"
        path.write_bytes(content)
        with pytest.raises(InputError, match=f"^{path}: not a readable Parquet file; is it cut short"):
            from_parquet(path)

    def test_cut_short(self, tmp_path: Path) -> None:
        path = Log(np.arange(1000.0), {"speed": np.random.default_rng(0).normal(size=1000)}).to_parquet(
            tmp_path / "x.parquet"
        )
        whole = path.read_bytes()
        for keep in (10, len(whole) // 2, len(whole) - 1):
            path.write_bytes(whole[:keep])
            with pytest.raises(InputError, match="not a readable Parquet file"):
                from_parquet(path)

    def test_missing_or_a_folder(self, tmp_path: Path) -> None:
        for path in (tmp_path / "x.parquet", tmp_path):
            with pytest.raises(InputError, match=f"^{path}: no such file; check the path"):
                from_parquet(path)

    @pytest.mark.parametrize(
        "metadata", [b"", b"{", b"[1]", b'"x"', b"null", b"\xff\xfe", b"[" * 200_000, b'{"a":' * 100_000]
    )
    def test_metadata_that_is_no_object_is_left_out(self, tmp_path: Path, metadata: bytes) -> None:
        schema = pa.schema([pa.field("time", pa.float64())], metadata={b"roadstate": metadata})
        pq.write_table(pa.Table.from_arrays([pa.array([0.0])], schema=schema), tmp_path / "x.parquet")
        assert from_parquet(tmp_path / "x.parquet")[1] == {}

    def test_two_columns_of_one_name(self, tmp_path: Path) -> None:
        arrays = [pa.array([0.0])] * 2
        pq.write_table(pa.Table.from_arrays(arrays, ["speed [m/s]", "speed [km/h]"]), tmp_path / "x.parquet")
        with pytest.raises(InputError, match=r"two columns are named 'speed'; rename one"):
            from_parquet(tmp_path / "x.parquet")

    def test_a_unit_that_is_no_text(self, tmp_path: Path) -> None:
        schema = pa.schema([pa.field("time", pa.float64(), metadata={b"unit": b"\xff\xfe"})])
        pq.write_table(pa.Table.from_arrays([pa.array([0.0])], schema=schema), tmp_path / "x.parquet")
        with pytest.raises(InputError, match="unknown unit"):
            Log.from_parquet(tmp_path / "x.parquet")


def test_text_columns_survive(tmp_path: Path) -> None:
    text = np.array(["a", "b", "a"], dtype=object)
    path = to_parquet(tmp_path / "x.parquet", {"t": Column(text, "")}, {})
    column = from_parquet(path)[0]["t"]
    assert list(column.values) == ["a", "b", "a"]
    assert column.unit == ""
