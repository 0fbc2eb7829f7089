"""Parquet of ours and of others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from roadstate.core import InputError, Log
from roadstate.io import read, write


def table(path: Path, columns: dict[str, object], units: dict[str, str] | None = None) -> Path:
    arrays = [pa.array(v) for v in columns.values()]
    fields = [
        pa.field(n, a.type, metadata={"unit": units[n]} if units and n in units else None)
        for n, a in zip(columns, arrays, strict=True)
    ]
    pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), path)
    return path


def test_units_come_from_the_field_or_the_name(tmp_path: Path) -> None:
    path = table(
        tmp_path / "a.parquet",
        {"t": [0.0, 1.0], "v [km/h]": [1, 2], "yaw": [0.1, None], "w": [1.5, 2.5]},
        {"t": "min", "yaw": "deg/s"},
    )
    recording = read(path)
    assert {n: s.unit for n, s in recording.signals.items()} == {"v": "km/h", "yaw": "deg/s", "w": None}
    np.testing.assert_array_equal(recording["v"].time, [0, 60])
    np.testing.assert_array_equal(recording["yaw"].values, [0.1, np.nan])
    assert recording["v"].source == "a.parquet:v"


def test_types_of_all_kinds(tmp_path: Path) -> None:
    import decimal

    path = table(
        tmp_path / "a.parquet",
        {
            "time": pa.array([1627274454500, 1627274455000], pa.timestamp("ms")),
            "flag": [True, False],
            "small": pa.array([1, 2], pa.uint8()),
            "half": pa.array(np.array([0.5, 1.5], np.float32)),
            "money": [decimal.Decimal("1.5"), None],
            "text": ["a", None],
            "kind": pa.array(["x", "y"]).dictionary_encode(),
            "date": pa.array([0, 1], pa.timestamp("s")),
            "list": [[1], [2]],
        },
    )
    recording = read(path)
    assert recording.metadata["skipped"] == ["text", "kind", "date", "list"]
    assert recording.metadata["start_time"] == "2021-07-26T04:40:54.500000000"
    np.testing.assert_array_equal(recording["flag"].time, [0, 0.5])
    for name, expected in {
        "flag": [1, 0],
        "small": [1, 2],
        "half": [0.5, 1.5],
        "money": [1.5, np.nan],
    }.items():
        np.testing.assert_array_equal(recording[name].values, expected)
        assert recording[name].values.dtype == np.float64


def test_unsigned_times_may_run_backward(tmp_path: Path) -> None:
    stamps = pa.array([1627274454500, 1627274454000], pa.uint64())
    recording = read(table(tmp_path / "a.parquet", {"timestamp [ms]": stamps, "v": [1.0, 2.0]}))
    np.testing.assert_array_equal(recording["v"].time, [0, -0.5])
    assert recording.metadata["start_time"] == "2021-07-26T04:40:54.500000000"


def test_a_frame_of_pandas_reads(tmp_path: Path) -> None:
    import pandas as pd

    index = pd.date_range("2024-05-31T12:00:00", periods=3, freq="10ms", name="timestamp")
    pd.DataFrame({"speed [m/s]": [1.0, 2.0, 3.0]}, index=index).to_parquet(tmp_path / "a.parquet")
    recording = read(tmp_path / "a.parquet")
    np.testing.assert_allclose(recording["speed"].time, [0, 0.01, 0.02])
    assert recording.metadata["start_time"] == "2024-05-31T12:00:00.000000000"


def test_metadata_of_a_log_is_kept(tmp_path: Path) -> None:
    log = Log(
        np.arange(3.0), {"speed": np.ones(3)}, {"vehicle": "compact", "start_time": "2024-05-31T12:00:00"}
    )
    metadata = read(write(log, tmp_path / "a.parquet")).metadata
    assert metadata == {
        "vehicle": "compact",
        "start_time": "2024-05-31T12:00:00",
        "files": [str(tmp_path / "a.parquet")],
        "format": "Parquet",
    }


def test_dates_beyond_those_in_ns_are_refused(tmp_path: Path) -> None:
    dates = np.array(["0001-01-01T00:00:01", "0001-01-01T00:00:02"], "datetime64[us]")
    path = table(tmp_path / "a.parquet", {"time": pa.array(dates), "v": [1.0, 2.0]})
    with pytest.raises(InputError, match=r"time: the date 0001-01-01T00:00:01 lies outside 1678 to 2261"):
        read(path)


def test_what_another_reading_left_out_is_no_news(tmp_path: Path) -> None:
    stale = {"skipped": ["note"], "undecoded": ["0x005"], "dropped": {"speed": 3}, "vehicle": "compact"}
    log = Log(np.arange(3.0), {"speed": np.ones(3)}, stale)
    metadata = read(write(log, tmp_path / "a.parquet")).metadata
    assert set(metadata) == {"vehicle", "files", "format"}


def test_a_table_that_would_fill_the_memory_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = table(tmp_path / "a.parquet", {"time": np.arange(1000) * 0.01, "v": np.ones(1000)})
    monkeypatch.setattr("roadstate.core.tabular._MAX_BYTES", 16_000)
    assert len(read(path)["v"]) == 1000
    monkeypatch.setattr("roadstate.core.tabular._MAX_BYTES", 15_999)
    with pytest.raises(InputError, match=r"a\.parquet: 1000 rows of 2 columns are over .*; split it"):
        read(path)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.floats(), min_size=1, max_size=30))
def test_every_float_survives(tmp_path: Path, values: list[float]) -> None:
    log = Log(np.arange(len(values)) / 100, {"accel_x": np.array(values)})
    np.testing.assert_array_equal(read(write(log, tmp_path / "a.parquet"))["accel_x"].values, values)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"a": [1.0], "b": [2.0]}, "no time column; there are 'a', 'b'"),
        ({"time": [0.0], "t": [0.0], "v": [1.0]}, "more than one time column: 'time' and 't'"),
        ({"time": [0.0], "v [m/s]": [1.0], "v": [1.0]}, "two columns are named 'v'"),
        ({"time": pa.array([], pa.float64()), "v": pa.array([], pa.float64())}, "has no rows"),
        ({"time": ["a"], "v": [1.0]}, "time: not numeric; name another time column"),
        ({"time": [0.0], "v": ["a"]}, "no column of numbers beside 'time'"),
    ],
)
def test_what_holds_no_log_is_refused(tmp_path: Path, columns: dict[str, object], message: str) -> None:
    path = table(tmp_path / "a.parquet", columns)
    with pytest.raises(InputError) as refusal:
        read(path)
    assert str(refusal.value).startswith(f"{path}")
    assert message in str(refusal.value)


def test_a_file_cut_anywhere_is_refused(tmp_path: Path) -> None:
    log = Log(np.arange(100.0), {"speed": np.random.default_rng(0).normal(size=100)})
    whole = write(log, tmp_path / "a.parquet").read_bytes()
    for length in [5, 8, 100, len(whole) // 2, len(whole) - 9, len(whole) - 1]:
        (tmp_path / "cut.parquet").write_bytes(whole[:length])
        with pytest.raises(InputError, match=r"cut\.parquet: not a readable Parquet file; is it cut short\?"):
            read(tmp_path / "cut.parquet")


def test_damaged_bytes_read_or_are_refused(tmp_path: Path) -> None:
    log = Log(np.arange(50.0), {"speed": np.ones(50)})
    whole = write(log, tmp_path / "a.parquet").read_bytes()
    rng = np.random.default_rng(4)
    refused = 0
    for _ in range(150):
        damaged = bytearray(whole)
        for position in rng.integers(4, len(whole), rng.integers(1, 8)):
            damaged[position] = rng.integers(256)
        (tmp_path / "a.parquet").write_bytes(damaged)
        try:
            read(tmp_path / "a.parquet")
        except InputError:
            refused += 1
    assert refused > 10
