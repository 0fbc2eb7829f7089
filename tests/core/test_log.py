"""Logs: what they refuse, and the way to pandas and Parquet and back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadstate.core import CHANNELS, InputError, Log

NAN = np.nan
TIME = np.array([0.0, 0.01, 0.5, 7.0])
METADATA = {"vehicle": "suv", "files": ["a.csv"], "rate": 100.0, "nested": {"list": [1, 2.5, None, True]}}


@pytest.fixture
def log() -> Log:
    channels = {
        "speed": np.array([1.0, NAN, 3.0, 1 / 3]),
        "brake": np.ones(4),
        "ref_grade": np.full(4, 1e-300),
    }
    return Log(TIME, channels, METADATA)


def same(a: Log, b: Log) -> None:
    np.testing.assert_array_equal(a.time, b.time)
    assert list(a.channels) == list(b.channels)
    for name in a.channels:
        np.testing.assert_array_equal(a[name], b[name])
        assert b[name].dtype == np.float64
    assert dict(a.metadata) == dict(b.metadata)


@pytest.mark.parametrize(
    ("time", "channels", "message"),
    [
        ([], {}, "a log needs at least one sample"),
        ([[0.0]], {}, "at least one sample"),
        ([0, 1, 1], {}, "time does not increase at row 2; sort the log and drop repeated rows"),
        ([0, 2, 1], {}, "time does not increase at row 2"),
        ([0, NAN, 1], {}, "time does not increase at row 1"),
        ([0, 1, np.inf], {}, "time does not increase at row 2"),
        ([0, np.inf, np.inf], {}, "time does not increase at row 1"),
        ([NAN], {}, "time does not increase at row 0"),
        ([0, 1], {"spede": np.zeros(2)}, "'spede' is not a canonical channel; did you mean 'speed'"),
        ([0, 1], {"speed": np.zeros(3)}, r"speed has shape \(3,\), time has \(2,\)"),
        ([0, 1], {"time": np.zeros(2)}, "time cannot be a channel beside itself"),
    ],
)
def test_what_is_no_log_is_refused(time: list[Any], channels: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Log(np.array(time, dtype=float), channels)


def test_numbers_of_any_kind_become_float64_and_arrays_of_it_stay() -> None:
    made = Log([0, 1, 2], {"speed": [1, 2, None], "brake": (True, False, True)})  # type: ignore[arg-type]
    channels = {"speed": np.array([1, 2, NAN]), "brake": np.array([1.0, 0, 1])}
    same(made, Log(np.array([0.0, 1.0, 2.0]), channels))
    assert made.time.dtype == np.float64
    speed = np.ones(4)
    assert Log(TIME, {"speed": speed})["speed"] is speed


@pytest.mark.parametrize(
    ("time", "channels", "message"),
    [
        (["a", "b"], {}, "^time holds what is no number; give numbers, NaN where one is missing$"),
        ([0, 1], {"speed": ["1", "2"]}, "^speed holds what is no number"),
        ([0, 1], {"speed": [[1], [2, 3]]}, "^speed holds what is no number"),
        ([0, 1], {"speed": [1, 10**400]}, "^speed holds what is no number"),
        (np.array(["2020-01-01", "2020-01-02"], "datetime64[s]"), {}, "^time holds what is no number"),
        ([0, 1], {"speed": 1.0}, r"^speed has shape \(\), time has \(2,\)"),
        (1.0, {}, "at least one sample"),
        ([0, 1], [1.0, 2.0], "^channels that are a list; give {name: values}$"),
    ],
)
def test_what_holds_no_numbers_is_refused(time: Any, channels: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Log(time, channels)


def test_access(log: Log) -> None:
    assert log["time"] is log.time
    assert "speed" in log
    assert "time" not in log
    assert len(log) == 4
    assert log.duration == 7
    assert set(log.references) == {"ref_grade"}
    silent = log.with_channels({"altitude": np.full(4, NAN)})
    assert silent.available == {"speed", "brake", "ref_grade"}
    assert list(silent.select(["altitude", "speed", "yaw_rate"]).channels) == ["speed", "altitude"]
    assert "altitude" not in log  # a log never changes


def test_between_is_half_open(log: Log) -> None:
    part = log.between(0.01, 7.0)
    np.testing.assert_array_equal(part.time, [0.01, 0.5])
    np.testing.assert_array_equal(part["speed"], [NAN, 3])
    with pytest.raises(InputError, match="at least one sample"):
        log.between(8, 9)


def test_pandas_round_trip(log: Log) -> None:
    frame = log.to_pandas()
    assert frame.index.name == "time [s]"
    assert list(frame.columns) == ["speed [m/s]", "brake [-]", "ref_grade [rad]"]
    same(log, Log.from_pandas(frame))


def test_parquet_round_trip(log: Log, tmp_path: Path) -> None:
    path = log.to_parquet(tmp_path / "a.parquet")
    same(log, Log.from_parquet(path))
    schema = pq.read_schema(path)
    assert {f.name: f.metadata[b"unit"].decode() for f in schema} == {
        "time": "s",
        "speed": "m/s",
        "brake": "-",
        "ref_grade": "rad",
    }


@given(
    st.dictionaries(
        st.sampled_from(sorted(set(CHANNELS) - {"time"})),
        st.lists(st.floats(width=64, allow_nan=True, allow_infinity=True), min_size=3, max_size=3),
        max_size=4,
    )
)
def test_any_values_survive(
    tmp_path_factory: pytest.TempPathFactory, channels: dict[str, list[float]]
) -> None:
    log = Log(np.array([0.1, 0.2, 0.30000000000000004]), {n: np.array(v) for n, v in channels.items()})
    same(log, Log.from_parquet(log.to_parquet(tmp_path_factory.mktemp("p") / "x.parquet")))
    same(log, Log.from_pandas(log.to_pandas()))


HOSTILE_METADATA = {
    "note": "</script><script>alert(1)</script> \x1b[31m \n\r\t \" ' \\ \u2028 \U0001f697 %s {x}",
    "__class__": "x",
    "": "",
    "units": {"speed": "km/h"},
}


def test_metadata_is_data_whatever_its_text(log: Log, tmp_path: Path) -> None:
    hostile = Log(log.time, log.channels, HOSTILE_METADATA)
    same(hostile, Log.from_parquet(hostile.to_parquet(tmp_path / "a.parquet")))
    same(hostile, Log.from_pandas(hostile.to_pandas()))


def test_metadata_that_is_no_json_is_written_as_text(log: Log, tmp_path: Path) -> None:
    odd = Log(log.time, log.channels, {"path": Path("a.csv"), "when": np.datetime64("2020-01-01")})
    back = Log.from_parquet(odd.to_parquet(tmp_path / "a.parquet"))
    assert back.metadata == {"path": "a.csv", "when": "2020-01-01"}


def test_other_units_are_converted(tmp_path: Path) -> None:
    frame = pd.DataFrame(
        {
            "time [ms]": [0, 10],
            "speed [km/h]": [36, 72],
            "yaw_rate [deg/s]": [180.0, NAN],
            "brake": [True, False],
        }
    )
    log = Log.from_pandas(frame)
    np.testing.assert_allclose(log.time, [0, 0.01])
    np.testing.assert_allclose(log["speed"], [10, 20])
    np.testing.assert_allclose(log["yaw_rate"], [np.pi, NAN])
    np.testing.assert_array_equal(log["brake"], [1, 0])

    fields = [pa.field("time", pa.int64(), metadata={b"unit": b"ms"}), pa.field("speed [km/h]", pa.float32())]
    table = pa.table([pa.array([0, 10]), pa.array([36, None], pa.float32())], schema=pa.schema(fields))
    pq.write_table(table, tmp_path / "b.parquet")
    log = Log.from_parquet(tmp_path / "b.parquet")
    np.testing.assert_allclose(log.time, [0, 0.01])
    np.testing.assert_allclose(log["speed"], [10, NAN])


def table(**columns: Any) -> pd.DataFrame:
    return pd.DataFrame({"time [s]": [0.0, 1.0], **columns})


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (pd.DataFrame({"speed": [1.0]}), r"no 'time \[s\]' column; add one, in seconds"),
        (table(spede=[1, 2]), "'spede' is not a canonical channel; did you mean"),
        (table(speed=["a", "b"]), "speed: not numeric; remove text from the column"),
        (table(**{"speed [rad]": [1, 2]}), "speed: unit 'rad' cannot be converted to 'm/s'"),
        (table(**{"speed [furlong^9^9]": [1, 2]}), r"speed: unknown unit 'furlong\^9\^9'"),
        (table(**{"speed [m/s]": [1, 2], "speed [km/h]": [1, 2]}), "two columns are named 'speed'"),
        (table(speed=[1, 2]).set_axis(["time [s]", "time [ms]"], axis=1), "two columns are named 'time'"),
        (table(speed=[1, 2]).iloc[::-1], "time does not increase at row 1"),
        (
            pd.DataFrame({"speed": [1.0]}, index=pd.DatetimeIndex(["2020-01-01"], name="time")),
            "time: holds dates or durations; give numbers in s",
        ),
    ],
)
def test_a_frame_or_file_that_is_no_log_is_refused_with_its_place(
    frame: pd.DataFrame, message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=f"^data frame: {message}"):
        Log.from_pandas(frame)
    path = tmp_path / "bad.parquet"
    fields = [str(c) for c in frame.columns]
    arrays = [pa.array(frame.iloc[:, i]) for i in range(len(fields))]
    if isinstance(frame.index, pd.DatetimeIndex):
        fields, arrays = [*fields, "time"], [*arrays, pa.array(frame.index.to_numpy())]
    pq.write_table(pa.Table.from_arrays(arrays, fields), path)
    with pytest.raises(InputError, match=f"^{path}: {message}"):
        Log.from_parquet(path)


def test_a_frame_may_name_no_index() -> None:
    frame = table(speed=[1, 2])
    frame.index.name = None
    assert len(Log.from_pandas(frame)) == 2
