"""Which samples a mapping takes, when they were measured, and along which axes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from recordings import can, recording

from roadstate.core import InputError, Recording, Signal
from roadstate.io.mapping import DEFAULT_MAPPING, Mapping


def apply(content: dict[str, Any], raw: Recording, **options: Any) -> Recording:
    return Mapping.model_validate(content).apply(raw, **options)


def refusal(content: dict[str, Any], raw: Recording) -> str:
    with pytest.raises(InputError) as caught:
        apply(content, raw)
    return str(caught.value)


# --- validity --------------------------------------------------------------------------------------------


def test_invalid_values_and_ranges_are_in_raw_units() -> None:
    raw = recording(a=([-64.0, 9.81, 64.0, 1e9, np.inf, np.nan], "m/s^2"))
    spec = {"from": "a", "invalid": [-64], "range": [-100, 100], "sign": -1}
    out = apply({"channels": {"accel_x": spec}}, raw)
    np.testing.assert_allclose(out["accel_x"].values, [np.nan, -9.81, -64.0, np.nan, np.nan, np.nan])


def test_invalid_values_are_compared_with_a_tolerance() -> None:
    raw = recording(a=np.array([-64.0000001, -63.99], dtype=float))
    out = apply({"channels": {"accel_x": {"from": "a", "invalid": -64}}}, raw)
    np.testing.assert_array_equal(np.isnan(out["accel_x"].values), [True, False])


@pytest.mark.parametrize(
    ("conditions", "expected"),
    [
        ({"signal": "ok", "equals": 1}, [True, False, True, False]),
        ({"signal": "acc", "max": 3}, [True, True, False, True]),
        ({"signal": "acc", "min": 2}, [False, True, True, True]),
        ([{"signal": "ok", "equals": 1}, {"signal": "acc", "max": 3}], [True, False, False, False]),
    ],
)
def test_conditions_on_companions(conditions: Any, expected: list[bool]) -> None:
    raw = recording(h=[1.0, 2.0, 3.0, 4.0], ok=[1.0, 0.0, 1.0, np.nan], acc=[1.0, 2.0, 4.0, 3.0])
    out = apply({"channels": {"altitude": {"from": "h", "valid": conditions}}}, raw)
    np.testing.assert_array_equal(np.isfinite(out["altitude"].values), expected)


def test_a_companion_on_another_time_base_counts_from_its_sample_on() -> None:
    raw = recording(
        v=Signal(np.array([0.0, 1.0, 2.0, 3.0, 4.0]), np.arange(5.0)),
        ok=Signal(np.array([0.5, 2.0, 3.5]), np.array([1.0, 0.0, 1.0])),
    )
    out = apply({"channels": {"speed": {"from": "v", "valid": {"signal": "ok", "equals": 1}}}}, raw)
    # nothing is known before 0.5 s; at 2 s the flag falls, at 3.5 s it rises
    np.testing.assert_array_equal(np.isfinite(out["speed"].values), [False, True, False, False, True])


def test_the_delay_does_not_part_a_signal_from_its_companion() -> None:
    raw = recording(v=[1.0, 2.0], ok=[0.0, 1.0])
    spec = {"from": "v", "delay": "0.5 s", "valid": {"signal": "ok", "equals": 1}}
    out = apply({"channels": {"speed": spec}}, raw)["speed"]
    np.testing.assert_array_equal(out.values, [np.nan, 2.0])
    np.testing.assert_allclose(out.time, [-0.5, 0.5])


def test_a_message_s_own_flag_is_meant_before_others_of_that_name() -> None:
    raw = recording(
        **{
            "A.v": can([1.0], "A"),
            "A.Valid": can([1.0], "A"),
            "B.Valid": can([0.0], "B"),
            "C.v2": can([1.0], "C"),
        }
    )
    flag = {"signal": "Valid", "equals": 1}
    assert apply({"channels": {"speed": {"from": "A.v", "valid": flag}}}, raw)["speed"].values[0] == 1.0
    text = refusal({"channels": {"speed": {"from": "C.v2", "valid": flag}}}, raw)
    assert text.startswith("drive.csv: speed.valid: candidate 'Valid' matches 2 signals")


def test_a_missing_companion_is_an_error() -> None:
    spec = {"from": "v", "valid": {"signal": "vvalid", "equals": 1}}
    text = refusal({"channels": {"speed": spec}}, recording(v=[1.0], v_valid=[1.0]))
    assert text.startswith("drive.csv: speed.valid: no signal matches 'vvalid'; closest: 'v_valid'")


# --- time ------------------------------------------------------------------------------------------------


def test_a_delay_moves_time_earlier_and_keeps_shared_bases_shared() -> None:
    raw = recording(time=[0.0, 0.5, 1.0], a=[1.0, 2.0, 3.0], b=[4.0, 5.0, 6.0], speed=[7.0, 8.0, 9.0])
    late = {"delay": "120 ms"}
    out = apply({"channels": {"accel_x": {"from": "a", **late}, "accel_y": {"from": "b", **late}}}, raw)
    np.testing.assert_allclose(out["accel_x"].time, [-0.12, 0.38, 0.88])
    assert out["accel_x"].time is out["accel_y"].time
    assert out["speed"].time is raw["speed"].time


@pytest.mark.parametrize("bad", [[0.0, 1.0, 1.0, 2.0], [0.0, 2.0, 1.0, 3.0], [0.0, np.nan, 1.0, 2.0]])
def test_bad_time_is_refused_or_repaired_as_asked(bad: list[float]) -> None:
    raw = recording(time=bad, speed=[1.0, 2.0, 3.0, 4.0], yaw_rate=[0.0, 0.0, 0.0, 0.0])
    text = refusal({}, raw)
    assert "time: {repair: drop}" in text
    out = apply({"time": {"repair": "drop"}}, raw)
    assert (np.diff(out["speed"].time) > 0).all()
    assert len(out["speed"]) == 3
    assert out["speed"].time is out["yaw_rate"].time
    out.resample()


def test_repair_tells_how_many_samples_it_left_out() -> None:
    time = np.arange(6000) * 0.01
    time[[100, 3000]] = 1e4, np.nan
    raw = recording(time=time, speed=np.ones(6000), yaw_rate=np.zeros(6000), other=np.zeros(6000))
    out = apply({"time": {"repair": "drop"}}, raw)
    assert len(out["speed"]) == 5998
    assert out["speed"].time is out["yaw_rate"].time
    assert out.metadata["dropped"] == {"speed": 2, "yaw_rate": 2}
    clean = apply({"time": {"repair": "drop"}}, recording(speed=[1.0, 2.0]))
    assert "dropped" not in clean.metadata


def test_repair_that_would_cost_a_good_part_of_the_log_is_refused() -> None:
    time = np.r_[np.arange(900) * 0.01, np.arange(100) * 0.01]  # the clock was set back
    text = refusal({"time": {"repair": "drop"}}, recording(time=time, speed=np.ones(1000)))
    assert "speed: the time of 100 of 1000 samples is out of order: too many to leave out; sort the" in text
    repeats = np.repeat(np.arange(500) * 0.01, 2)  # stamps coarser than the samples
    out = apply({"time": {"repair": "drop"}}, recording(time=repeats, speed=np.ones(1000)))
    assert len(out["speed"]) == out.metadata["dropped"]["speed"] == 500


def test_time_of_signals_that_are_not_taken_does_not_matter() -> None:
    bad = Signal(np.array([1.0, 0.0]), np.zeros(2))
    assert "speed" in DEFAULT_MAPPING.apply(recording(speed=[1.0, 2.0], junk=bad)).signals


# --- an IMU of its own axes ------------------------------------------------------------------------------


def test_named_axes_move_signals_without_mixing_them() -> None:
    axes = {"x": "ax", "y": "ay", "z": "az"}
    raw = recording(ax=[9.81], ay=[-2.0], az=[-3.0])
    out = apply({"rotation": {"forward": "-Y", "up": "X"}, "imu": {"accel": axes}}, raw)
    assert [out[f"accel_{a}"].values[0] for a in "xyz"] == [2.0, 3.0, 9.81]
    assert out.metadata["mapped"] == {"accel_x": "ay", "accel_y": "az", "accel_z": "ax"}


def test_settings_beside_the_axes_hold_for_those_that_do_not_say_otherwise() -> None:
    axes = {"x": "ax", "y": {"from": "ay", "sign": -1}, "z": {"from": "az", "unit": "m/s^2"}, "unit": "g"}
    out = apply({"imu": {"accel": axes}}, recording(ax=[1.0], ay=[1.0], az=[1.0]))
    np.testing.assert_allclose([out[f"accel_{a}"].values[0] for a in "xyz"], [9.80665, -9.80665, 1.0])


def test_a_mounting_angle_mixes_the_axes_and_names_all_of_them() -> None:
    raw = recording(ax=[0.0], ay=[0.0], az=[9.81], gx=[0.0], gy=[0.0], gz=[1.0])
    content = {
        "rotation": {"pitch": "3 deg"},
        "imu": {"accel": {a: f"a{a}" for a in "xyz"}, "gyro": {a: f"g{a}" for a in "xyz"}},
    }
    out = apply(content, raw)
    np.testing.assert_allclose(out["accel_x"].values, [9.81 * np.sin(np.radians(3))])
    np.testing.assert_allclose(out["accel_z"].values, [9.81 * np.cos(np.radians(3))])
    np.testing.assert_allclose(out["yaw_rate"].values, [np.cos(np.radians(3))])
    assert out.metadata["mapped"]["accel_x"] == "ax, az"
    assert out.metadata["sources"]["accel_x"] == ["ax", "az"]


def test_axes_on_different_time_bases_are_brought_together_where_they_mix() -> None:
    t = np.arange(0.0, 10.0, 0.1)
    raw = recording(ax=Signal(t, 0.5 * t), ay=Signal(t + 0.03, 0.2 * (t + 0.03)))
    out = apply({"rotation": {"yaw": "30 deg"}, "imu": {"accel": {"x": "ax", "y": "ay", "z": "ax"}}}, raw)
    signal = out["accel_x"]
    expected = (0.5 * np.cos(np.pi / 6) - 0.2 * np.sin(np.pi / 6)) * signal.time
    np.testing.assert_allclose(signal.values[1:], expected[1:], rtol=1e-9, atol=1e-12)
    assert np.isnan(signal.values[0])  # before the other axis' first sample


def test_an_imu_gives_what_its_axes_suffice_for() -> None:
    raw = recording(gz=[0.5])
    out = apply({"rotation": {"forward": "X", "up": "-Z"}, "imu": {"gyro": {"z": "gz"}}}, raw)
    assert set(out.signals) == {"yaw_rate"}
    assert out["yaw_rate"].values[0] == -0.5
    tilted = {"rotation": {"roll": "10 deg"}, "imu": {"gyro": {"z": "gz"}}}
    assert "imu.gyro: of its axes only z are there" in refusal(tilted, raw)


def test_an_imu_outranks_signals_that_carry_a_canonical_name() -> None:
    raw = recording(accel_x=[1.0], accel_y=[2.0], accel_z=[3.0])
    content = {
        "rotation": {"forward": "-X", "up": "Z"},
        "imu": {"accel": {"x": "accel_x", "y": "accel_y", "z": "accel_z"}},
    }
    out = apply(content, raw)
    assert [out[f"accel_{a}"].values[0] for a in "xyz"] == [-1.0, -2.0, 3.0]


def test_samples_that_a_table_repeats_are_taken_once() -> None:
    speed = 20 + np.sin(np.arange(100.0))
    raw = recording(speed=np.repeat(speed, 5), ref_velocity_x=np.repeat(speed, 5))
    out = apply({}, raw)
    assert out.metadata["held"] == {"speed": 5}
    assert np.isfinite(out["speed"].values).sum() == 100
    np.testing.assert_array_equal(out["speed"].values[::5], speed)
    assert np.isfinite(out["ref_velocity_x"].values).all()
    kept = apply({"time": {"held": "keep"}}, raw)
    assert "held" not in kept.metadata
    assert np.isfinite(kept["speed"].values).all()


def test_turned_axes_are_made_of_whole_rows() -> None:
    """Axes held for as long, but taken at other moments."""
    along, across = np.sin(np.arange(100.0)), np.cos(np.arange(100.0))
    raw = recording(a=np.repeat(along, 5), b=np.roll(np.repeat(across, 5), 2), c=np.zeros(500))
    accel = {"x": "a", "y": "b", "z": "c"}
    content = {"imu": {"accel": accel}, "rotation": {"forward": "x", "left": "y", "yaw": "30 deg"}}
    out = apply(content, raw)
    assert np.isfinite(out["accel_x"].values).sum() >= 100
