"""MF4: named signals, raw CAN frames, real logs, and files that are damaged."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from asammdf import MDF, Signal
from asammdf.blocks import v4_constants
from asammdf.blocks.conversion_utils import from_dict
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mdf_files import DBC, raw_group, save

from roadstate.core import CHANNELS, InputError, Log
from roadstate.io import read, read_all, write
from roadstate.io.formats.mdf import _gather


@pytest.fixture
def dbc(tmp_path: Path) -> Path:
    path = tmp_path / "bus.dbc"
    path.write_text(DBC)
    return path


def test_signals_keep_units_conversions_and_one_time_base_per_group(tmp_path: Path) -> None:
    fast, slow = np.arange(5) * 0.01, np.arange(3) * 0.02
    path = save(
        tmp_path / "a.mf4",
        [
            Signal(
                np.array([0, 1, 2, 3, 4], np.uint16),
                fast,
                name="speed",
                unit="km/h",
                conversion=from_dict({"a": 0.5, "b": -1.0}),
            ),
            Signal(np.array([-1, 0, 1, 2, 3], np.int8), fast, name="gear"),
            Signal(np.array([b"P", b"R", b"N", b"D", b"D"]), fast, name="label", encoding="latin-1"),
        ],
        [
            Signal(
                np.array([0, 1, 0], np.uint8),
                slow,
                name="brake",
                conversion=from_dict(
                    {"val_0": 0, "text_0": b"off", "val_1": 1, "text_1": b"on", "default": b"?"}
                ),
            ),
            Signal(np.array([1.5, 2.5, np.nan]), slow, name="altitude", unit="m"),
        ],
    )
    recording = read(path)
    np.testing.assert_array_equal(recording["speed"].values, [-1, -0.5, 0, 0.5, 1])
    np.testing.assert_array_equal(recording["gear"].values, [-1, 0, 1, 2, 3])
    np.testing.assert_array_equal(recording["brake"].values, [0, 1, 0])
    np.testing.assert_array_equal(recording["altitude"].values, [1.5, 2.5, np.nan])
    assert (recording["speed"].unit, recording["gear"].unit) == ("km/h", None)
    assert recording["speed"].time is recording["gear"].time
    assert recording["brake"].time is recording["altitude"].time
    np.testing.assert_array_equal(recording["speed"].time, fast)
    assert recording.metadata["skipped"] == ["label"]
    assert recording["altitude"].source == "a.mf4:altitude"


def test_invalidated_samples_are_missing(tmp_path: Path) -> None:
    time = np.arange(4.0)
    path = save(
        tmp_path / "a.mf4",
        [
            Signal(np.arange(4.0), time, name="a", invalidation_bits=np.array([False, True, False, True])),
            Signal(np.arange(4), time, name="b"),
        ],
    )
    recording = read(path)
    np.testing.assert_array_equal(recording["a"].values, [0, np.nan, 2, np.nan])
    np.testing.assert_array_equal(recording["b"].values, [0, 1, 2, 3])


@pytest.mark.parametrize(
    ("names", "expected"),
    [(["front", "rear"], {"front.v", "rear.v", "w"}), (["same", "same"], {"v#0", "v#1", "w"})],
)
def test_one_name_in_two_groups_is_told_apart(tmp_path: Path, names: list[str], expected: set[str]) -> None:
    time = np.arange(3.0)
    path = save(
        tmp_path / "a.mf4",
        [Signal(time, time, name="v")],
        [Signal(time + 1, time + 0.5, name="v"), Signal(time, time + 0.5, name="w")],
        names=names,
    )
    recording = read(path)
    assert set(recording) == expected
    assert sorted(s.values[0] for n, s in recording.signals.items() if "v" in n) == [0, 1]


def test_groups_against_something_else_than_time_are_left_out(tmp_path: Path) -> None:
    time = np.arange(3.0)
    angle = Signal(time, time, name="pressure")
    angle.master_metadata = ("crank", v4_constants.SYNC_TYPE_ANGLE)
    path = save(tmp_path / "a.mf4", [Signal(time, time, name="v")], [angle])
    recording = read(path)
    assert list(recording) == ["v"]
    assert recording.metadata["skipped"] == ["pressure: no time"]


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    values=st.lists(st.floats(), min_size=1, max_size=30),
    names=st.sets(st.sampled_from(sorted(set(CHANNELS) - {"time"})), min_size=1, max_size=5),
)
def test_every_float_survives(tmp_path: Path, values: list[float], names: set[str]) -> None:
    log = Log(np.cumsum(np.full(len(values), 0.1)), {n: np.array(values) for n in names})
    recording = read(write(log, tmp_path / "a.mf4"))
    assert set(recording) == names
    for name in names:
        np.testing.assert_array_equal(recording[name].values, values)
        np.testing.assert_array_equal(recording[name].time, log.time)
        assert recording[name].unit == CHANNELS[name].unit


def test_the_start_time_survives_and_none_is_made_up(tmp_path: Path) -> None:
    log = Log(np.arange(3.0), {"speed": np.ones(3)}, {"start_time": "2021-07-26T04:40:54.123456789"})
    assert read(write(log, tmp_path / "a.mf4")).metadata["start_time"] == log.metadata["start_time"]
    assert "start_time" not in read(write(Log(log.time, log.channels), tmp_path / "b.mf4")).metadata


@pytest.mark.parametrize("fields", ["full", "short", "least"])
def test_raw_frames_decode_through_a_dbc(tmp_path: Path, dbc: Path, fields: str) -> None:
    data = np.zeros((4, 8), np.uint8)
    data[:, :2] = np.array([100, -100, 0, 981], "<i2").view(np.uint8).reshape(4, 2)
    data[:, 2:4] = np.array([5, 6, 7, -8], ">i2").view(np.uint8).reshape(4, 2)
    path = save(tmp_path / "a.mf4", raw_group([256] * 4, data, fields=fields))
    recording = read(path, dbc=[dbc])
    assert list(recording) == ["imu.x", "imu.y"]
    np.testing.assert_allclose(recording["imu.x"].values, [1, -1, 0, 9.81])
    np.testing.assert_allclose(recording["imu.y"].values, [0.05, 0.06, 0.07, -0.08])
    np.testing.assert_allclose(recording["imu.x"].time, [0, 0.01, 0.02, 0.03])
    assert recording["imu.x"].bus == (0 if fields == "least" else 1)
    assert recording["imu.x"].source == "a.mf4:imu.x"


def test_frames_of_several_groups_come_together_in_time_order(tmp_path: Path, dbc: Path) -> None:
    data, later = np.zeros((2, 3, 8), np.uint8)
    data[:, 0], later[:, 0] = [4, 5, 6], [1, 2, 3]
    wide = np.zeros((2, 64), np.uint8)
    path = save(
        tmp_path / "a.mf4",
        raw_group([256] * 3, later, start=1.0),
        raw_group([256] * 3, data, start=0.0),
        raw_group([5, 5], wide, bus=2),
    )
    recording = read(path, dbc=[dbc])
    np.testing.assert_allclose(recording["imu.x"].values, np.array([4, 5, 6, 1, 2, 3]) / 100)
    recording["imu.x"].check_time()
    assert recording.metadata["undecoded"] == ["0x005"]


@settings(max_examples=100, deadline=None)
@given(
    payloads=st.lists(st.binary(max_size=64), min_size=1, max_size=12),
    astray=st.lists(st.integers(0, 2**64 - 1), max_size=2),
    cut=st.integers(0, 30),
)
def test_bytes_kept_beside_the_records_are_followed_only_while_they_exist(
    payloads: list[bytes], astray: list[int], cut: int
) -> None:
    entries = [len(p).to_bytes(4, "little") + p for p in payloads]
    starts = np.cumsum([0, *map(len, entries)])[:-1].tolist()
    block = b"".join(entries)
    block = block[: len(block) - cut]
    data = _gather(np.frombuffer(block, np.uint8), np.array([*starts, *astray], np.uint64))
    whole = [p for p, s in zip(payloads, starts, strict=True) if s + 4 + len(p) <= len(block)]
    assert len(whole) <= len(data) <= len(payloads) + len(astray)
    for row, payload in zip(data, whole, strict=False):
        assert row[: len(payload)].tobytes() == payload
        assert not row[len(payload) :].any()


def test_named_signals_beside_frames_read_without_a_dbc(tmp_path: Path, dbc: Path) -> None:
    time = np.arange(3.0)
    path = save(
        tmp_path / "a.mf4", [Signal(time, time, name="v", unit="m/s")], raw_group([256], np.ones((1, 8)))
    )
    alone = read(path)
    assert list(alone) == ["v"]
    assert alone.metadata["skipped"] == ["CAN frames: no DBC given"]
    assert set(read(path, dbc=[dbc])) == {"v", "imu.x", "imu.y"}


def test_frames_without_a_dbc_give_obd_or_ask_for_one(tmp_path: Path, dbc: Path) -> None:
    reply = np.frombuffer(bytes.fromhex("03410D35AAAAAAAA"), np.uint8).reshape(1, 8)
    path = save(tmp_path / "obd.mf4", raw_group([0x7E8], reply))
    np.testing.assert_array_equal(read(path)["obd.vehicle_speed"].values, [53])
    with pytest.raises(InputError, match=r"the log has 0x7E8; the DBC has 0x100"):
        read(path, dbc=[dbc])
    silent = save(tmp_path / "raw.mf4", raw_group([0x123], reply))
    with pytest.raises(InputError, match=r"raw CAN frames without a DBC \(ids 0x123\); name one with --dbc"):
        read(silent)


def test_a_file_without_samples_is_refused(tmp_path: Path) -> None:
    path = save(tmp_path / "a.mf4", [Signal(np.array([]), np.array([]), name="v")])
    with pytest.raises(InputError, match=r"a\.mf4: holds no samples; was anything recorded\?"):
        read(path)


def test_an_older_version_is_named(tmp_path: Path) -> None:
    with MDF(version="3.30") as mdf:
        mdf.append([Signal(np.ones(3), np.arange(3.0), name="v")])
        path = mdf.save(tmp_path / "old.mdf")
    with pytest.raises(InputError, match=r"MDF version 3\.30 is not read; convert it to MDF 4"):
        read(path)


def test_a_missing_asammdf_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(Log(np.arange(3.0), {"speed": np.ones(3)}), tmp_path / "a.mf4")
    monkeypatch.setitem(sys.modules, "asammdf", None)
    with pytest.raises(InputError, match=r"a\.mf4: MF4 files need asammdf; install 'roadstate\[mdf\]'"):
        read(path)
    with pytest.raises(InputError, match="install 'roadstate"):
        write(Log(np.arange(3.0), {"speed": np.ones(3)}), tmp_path / "b.mf4")


def test_a_real_drive_of_five_files_joins(shared_data: Path) -> None:
    folder = shared_data / "css_mf4"
    files = sorted(folder.glob("0000000*.MF4"))
    drive = read_all(files[::-1], dbc=[folder / "canmod-gps.dbc"])
    assert drive.metadata["start_time"] == "2021-07-26T04:40:54.000000000"
    assert drive.metadata["files"] == [str(f) for f in files]
    assert drive.metadata["undecoded"] == ["0x17F00010"]
    acceleration = drive["gnss_imu.AccelerationX"]
    acceleration.check_time()
    assert (acceleration.time[-1] - acceleration.time[0]) / 60 == pytest.approx(39.54, abs=0.01)
    assert np.median(acceleration.values) == pytest.approx(9.65, abs=0.2)
    assert (acceleration.unit, acceleration.message, acceleration.bus) == ("m/s^2", "gnss_imu", 2)
    assert acceleration.time is drive["gnss_imu.AngularRateZ"].time
    assert drive["obd.vehicle_speed"].values.max() == pytest.approx(87, abs=3)
    # two independent speeds of one car, in km/h
    gnss = drive["gnss_speed.Speed"]
    there = np.interp(drive["obd.vehicle_speed"].time, gnss.time, gnss.values * 3.6)
    assert np.median(np.abs(there - drive["obd.vehicle_speed"].values)) < 2


def test_a_real_drive_decodes_as_cantools_decodes_it(shared_data: Path) -> None:
    import cantools.database

    folder = shared_data / "css_mf4"
    oracle = cantools.database.load_file(folder / "canmod-gps.dbc")
    path = folder / "00000005-60FEB5A8.MF4"
    ours = read(path, dbc=[folder / "canmod-gps.dbc"])
    with MDF(path) as mdf:
        ids = mdf.get("CAN_DataFrame.ID").samples
        data = mdf.get("CAN_DataFrame.DataBytes").samples
        lengths = mdf.get("CAN_DataFrame.DataLength").samples
        rows = {message.name: np.flatnonzero(ids == message.frame_id) for message in oracle.messages}  # type: ignore[union-attr]
    compared = 0
    for message in oracle.messages:  # type: ignore[union-attr]
        for i, row in enumerate(rows[message.name][:200]):
            decoded = message.decode(data[row][: lengths[row]].tobytes(), decode_choices=False)
            for name, value in decoded.items():  # type: ignore[union-attr]
                assert ours[f"{message.name}.{name}"].values[i] == pytest.approx(value, rel=1e-14)
                compared += 1
    assert compared > 2000


def test_real_j1939_decodes_and_uds_says_why_not(shared_data: Path) -> None:
    folder = shared_data / "css_mf4" / "other"
    truck = read(folder / "j1939_fcbf0606.MF4", dbc=[folder / "CSS-Electronics-SAE-J1939-DEMO.dbc"])
    assert set(truck) == {"EEC1.EngineSpeed", "CCVS1.WheelBasedVehicleSpeed"}
    assert len(truck["EEC1.EngineSpeed"]) == 577
    assert truck.metadata["start_time"] == "2021-06-01T11:43:49.000000000", "the header says 13:43:49+02:00"
    with pytest.raises(InputError, match=r"Battery: 62 bytes sent in several frames \(transport protocol\)"):
        read(folder / "uds_00000170.MF4", dbc=[folder / "tp_uds.dbc"])
