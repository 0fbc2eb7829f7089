"""Estimates: validity labels, and the way to pandas and Parquet and back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from roadstate.core import Estimates, InputError, Validity

NAN = np.nan


@pytest.fixture
def estimates() -> Estimates:
    random = np.random.default_rng(0)
    return Estimates(
        time=np.arange(7) * 0.1,
        values={"grade": random.normal(size=7), "speed": random.normal(size=7)},
        std={"grade": random.random(7) + 0.1, "speed": random.random(7) + 0.1},
        validity=np.arange(7, dtype=np.int8),
        sensors=("wheel_speed_front", "wheel_speed_rear"),
        innovation=np.where(random.random((7, 2)) < 0.3, NAN, random.normal(size=(7, 2))),
        innovation_std=random.random((7, 2)),
        nis=np.array([NAN, 1, 2, 3, 4, 5, 6.0]),
        metadata={"estimator": "kmbe", "note": 'a "b" <c>\n', "settings": {"bias": False}},
        sensor_units={"wheel_speed_front": "m/s"},
    )


def same(a: Estimates, b: Estimates) -> None:
    for name in ("time", "innovation", "innovation_std", "nis", "validity"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    for x, y in ((a.values, b.values), (a.std, b.std)):
        assert list(x) == list(y)
        for name in x:
            np.testing.assert_array_equal(x[name], y[name])
    assert b.validity.dtype == np.int8
    assert a.sensors == b.sensors
    assert dict(a.metadata) == dict(b.metadata)
    assert dict(a.sensor_units) == dict(b.sensor_units)


def test_labels_name_the_codes(estimates: Estimates) -> None:
    assert list(estimates.labels()) == [
        "excited",
        "low_excitation",
        "standstill",
        "sensor_missing",
        "diverged",
        "braking",
        "gear_shift",
    ]
    assert [v.label for v in Validity] == [*estimates.labels(), "sensor_fault"]
    assert len(estimates) == 7


def test_pandas_round_trip(estimates: Estimates) -> None:
    frame = estimates.to_pandas()
    assert list(frame.columns[:5]) == [
        "grade [rad]",
        "grade_std [rad]",
        "speed [m/s]",
        "speed_std [m/s]",
        "validity",
    ]
    assert frame["validity"].iloc[2] == "standstill"
    same(estimates, Estimates.from_pandas(frame))


def test_parquet_round_trip(estimates: Estimates, tmp_path: Path) -> None:
    path = estimates.to_parquet(tmp_path / "e.parquet")
    same(estimates, Estimates.from_parquet(path))
    units = {f.name: (f.metadata or {}).get(b"unit") for f in pq.read_schema(path)}
    assert units["grade"] == units["grade_std"] == b"rad"
    assert units["nis"] == b"-"


def test_without_innovations(tmp_path: Path) -> None:
    plain = Estimates(np.arange(2.0), {"grade": np.zeros(2)}, {"grade": np.ones(2)}, np.zeros(2, np.int8))
    same(plain, Estimates.from_parquet(plain.to_parquet(tmp_path / "e.parquet")))
    same(plain, Estimates.from_pandas(plain.to_pandas()))


def test_other_units_are_converted(estimates: Estimates) -> None:
    frame = estimates.to_pandas().rename(
        columns={"grade [rad]": "grade [deg]", "grade_std [rad]": "grade_std [deg]"}
    )
    read = Estimates.from_pandas(frame)
    np.testing.assert_allclose(read.values["grade"], np.deg2rad(estimates.values["grade"]))
    np.testing.assert_allclose(read.std["grade"], np.deg2rad(estimates.std["grade"]))


def rewrite(path: Path, *, drop: tuple[str, ...] = (), metadata: Any = None, **columns: Any) -> Path:
    """The file again with columns dropped or replaced, and other metadata: a stranger's."""
    table = pq.read_table(path)
    header = json.dumps(metadata).encode() if metadata is not None else table.schema.metadata[b"roadstate"]
    table = table.drop_columns(list(drop))
    for name, values in columns.items():
        array = pa.array(values)
        index = table.schema.get_field_index(name)
        table = table.append_column(name, array) if index < 0 else table.set_column(index, name, array)
    pq.write_table(table.replace_schema_metadata({b"roadstate": header}), path)
    return path


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"drop": ("time",)}, "no 'time' column; is this a file of estimates"),
        ({"drop": ("validity",)}, "no 'validity' column"),
        ({"validity": ["fine"] * 7}, "unknown validity 'fine'"),
        ({"validity": [None] * 7}, "unknown validity 'None'"),
        ({"gradient": [0.0] * 7}, "'gradient' is not a quantity; did you mean 'grade'"),
        ({"grade": ["x"] * 7}, "grade: not numeric"),
        ({"nis": ["x"] * 7}, "nis: not numeric"),
        ({"innovation_wheel_speed_rear": ["x"] * 7}, "innovation_wheel_speed_rear: not numeric"),
        ({"drop": ("innovation_wheel_speed_rear_std",)}, "no 'innovation_wheel_speed_rear_std' column"),
        ({"metadata": {"sensors": ["other"]}}, "no 'innovation_other' column"),
    ],
)
def test_a_file_that_holds_no_estimates_is_refused(
    estimates: Estimates, tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    path = rewrite(estimates.to_parquet(tmp_path / "e.parquet"), **changes)
    with pytest.raises(InputError, match=f"^{path}: {message}"):
        Estimates.from_parquet(path)


@pytest.mark.parametrize("sensors", [5, None, "abc", {"a": 1}])
def test_sensors_that_are_no_list_count_as_none(
    estimates: Estimates, tmp_path: Path, sensors: object
) -> None:
    path = rewrite(estimates.to_parquet(tmp_path / "e.parquet"), metadata={"sensors": sensors})
    assert Estimates.from_parquet(path).sensors == ()


def test_a_log_is_no_estimates() -> None:
    with pytest.raises(InputError, match=r"^data frame: no 'validity' column"):
        Estimates.from_pandas(pd.DataFrame({"time [s]": [0.0], "speed [m/s]": [1.0]}))
