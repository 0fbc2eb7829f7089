"""What a mapping makes of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recordings import can, mapping_of, recording

from roadstate.core import CHANNELS, InputError, Recording
from roadstate.io.mapping import DEFAULT_MAPPING, Mapping
from roadstate.io.plausible import limit_of


def apply(content: dict[str, Any], raw: Recording, **options: Any) -> Recording:
    return Mapping.model_validate(content).apply(raw, **options)


def refusal(content: dict[str, Any], raw: Recording, **options: Any) -> str:
    with pytest.raises(InputError) as caught:
        apply(content, raw, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


# --- without a mapping file ------------------------------------------------------------------------------


def test_canonical_names_are_taken_with_their_units_and_the_rest_is_ignored() -> None:
    raw = recording(speed=([36.0, 72.0], "km/h"), yaw_rate=[0.1, 0.2], other=([1, 2], "bar"))
    out = DEFAULT_MAPPING.apply(raw)
    assert set(out.signals) == {"speed", "yaw_rate"}
    np.testing.assert_allclose(out["speed"].values, [10.0, 20.0])
    assert out["speed"].unit == "m/s"
    np.testing.assert_array_equal(out["yaw_rate"].values, [0.1, 0.2])
    assert out.metadata["mapped"] == {"speed": "speed", "yaw_rate": "yaw_rate"}
    assert out.metadata["sources"] == {"speed": ["speed"], "yaw_rate": ["yaw_rate"]}
    assert out.metadata["format"] == "CSV"


def test_a_canonical_name_in_a_unit_of_another_kind_is_refused_by_name() -> None:
    text = refusal({}, recording(accel_x=([1.0], "bar")))
    assert text.startswith("drive.csv:accel_x as accel_x: unit 'bar' cannot be converted to 'm/s^2'")


def test_unlisted_canonical_signals_are_taken_unless_only_listed() -> None:
    raw = recording(speed=[1.0], a=[2.0])
    assert set(apply({"channels": {"accel_x": "a"}}, raw).signals) == {"accel_x", "speed"}
    assert set(apply({"channels": {"accel_x": "a"}, "only_listed": True}, raw).signals) == {"accel_x"}


def test_time_is_never_a_channel() -> None:
    assert list(DEFAULT_MAPPING.apply(recording(time_s=[0.0], time=[0.0], speed=[1.0])).signals) == ["speed"]


# --- which signal ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "candidate",
    [
        "ESP_02.YawRate",
        "YawRate",
        {"glob": "*yaw*rate*"},
        {"glob": "ESP_??.Yaw*"},
        {"regex": "ESP_.*Rate"},
        {"regex": "(?i)yawrate"},
        ["no such", "YawRate"],
        [{"regex": "Yaw"}, "YawRate"],  # a regex matches the whole name or not at all
        {"signal": "YawRate", "message": "ESP_02"},
        {"signal": "YawRate", "message": "ESP_02", "bus": 1},
        {"glob": "*Rate", "bus": 1},
    ],
)
def test_a_candidate_finds_its_signal(candidate: Any) -> None:
    raw = recording(
        **{
            "ESP_02.YawRate": can([1.0], "ESP_02", bus=1),
            "EPS.Angle": can([2.0], "EPS", bus=1),
            "speed": [3.0],
        }
    )
    out = apply({"channels": {"yaw_rate": {"from": candidate}}}, raw)
    np.testing.assert_array_equal(out["yaw_rate"].values, [1.0])
    assert out.metadata["mapped"]["yaw_rate"] == "ESP_02.YawRate"


def test_the_first_candidate_that_matches_wins() -> None:
    raw = recording(a=[1.0], b=[2.0])
    np.testing.assert_array_equal(apply({"channels": {"accel_x": ["b", "a"]}}, raw)["accel_x"].values, [2.0])


@pytest.mark.parametrize("candidate", ["Rate", {"glob": "*.Rate*"}, {"regex": r".*Rate(?:@\d)?"}])
def test_two_matches_are_an_error_that_names_both(candidate: Any) -> None:
    raw = recording(**{"A.Rate": can([1.0], "A"), "B.Rate": can([2.0], "B")})
    text = refusal({"channels": {"yaw_rate": {"from": candidate}}}, raw)
    assert text.startswith("drive.csv: yaw_rate: candidate ")
    assert "matches 2 signals: 'A.Rate', 'B.Rate'" in text
    assert "'message:' or 'bus:'" in text


def test_a_later_candidate_does_not_mend_an_earlier_one_that_matches_twice() -> None:
    raw = recording(a1=[1.0], a2=[2.0])
    assert "matches 2 signals" in refusal({"channels": {"speed": {"from": [{"glob": "a*"}, "a1"]}}}, raw)


@pytest.mark.parametrize(
    ("candidate", "value"),
    [
        ({"signal": "Rate", "message": "B"}, 2.0),
        ({"signal": "Rate", "bus": 2}, 3.0),
        ("A.Rate@1", 1.0),
        ({"signal": "A.Rate", "bus": 2}, 3.0),
        ({"glob": "*rate*", "message": "B"}, 2.0),
    ],
)
def test_message_bus_and_full_name_tell_signals_apart(candidate: Any, value: float) -> None:
    raw = recording(
        **{
            "A.Rate@1": can([1.0], "A", bus=1),
            "A.Rate@2": can([3.0], "A", bus=2),
            "B.Rate": can([2.0], "B", bus=1),
        }
    )
    assert apply({"channels": {"yaw_rate": {"from": candidate}}}, raw)["yaw_rate"].values[0] == value


def test_a_full_name_outranks_equal_last_parts() -> None:
    raw = recording(**{"v": [1.0], "gps.v": can([2.0], "gps"), "obd.v": can([3.0], "obd")})
    assert apply({"channels": {"speed": "v"}}, raw)["speed"].values[0] == 1.0


def test_no_match_names_channel_candidates_and_the_closest_signals() -> None:
    raw = recording(wheel_speed_front=[1.0], engine_rpm=[2.0], veh_speed=[3.0])
    text = refusal({"channels": {"speed": {"from": ["vehspeed", {"glob": "*tacho*"}]}}}, raw)
    assert text.startswith("drive.csv: speed: no signal matches 'vehspeed' or glob '*tacho*'")
    assert "closest: 'veh_speed'" in text


def test_no_match_in_a_small_recording_lists_what_there_is() -> None:
    assert "the file has 'a', 'b'" in refusal({"channels": {"speed": "qqqq"}}, recording(a=[1.0], b=[1.0]))


def test_optional_channels_may_be_missing() -> None:
    raw = recording(a=[1.0])
    out = apply({"channels": {"speed": {"from": "b", "optional": True}, "accel_x": "a"}}, raw)
    assert set(out.signals) == {"accel_x"}


def test_one_signal_may_be_two_channels() -> None:
    out = apply({"channels": {"drive_torque_fl": "t", "drive_torque_fr": "t"}}, recording(t=[5.0]))
    assert out["drive_torque_fl"].values[0] == out["drive_torque_fr"].values[0] == 5.0


def test_settings_without_a_name_look_for_the_channel_itself() -> None:
    out = apply({"channels": {"speed": {"unit": "km/h"}}}, recording(speed=[36.0]))
    np.testing.assert_allclose(out["speed"].values, [10.0])


# --- units -----------------------------------------------------------------------------------------------


def test_the_mappings_unit_outranks_the_files() -> None:
    out = apply({"channels": {"yaw_rate": {"from": "r", "unit": "deg/s"}}}, recording(r=([90.0], "rad/s")))
    np.testing.assert_allclose(out["yaw_rate"].values, [np.pi / 2])


@pytest.mark.parametrize("unit", [None, "", "[]"])
def test_no_unit_means_the_channels_own(unit: str | None) -> None:
    out = apply({"channels": {"accel_x": "a"}}, recording(a=([1.5], unit)))
    assert out["accel_x"].values[0] == 1.5


@pytest.mark.parametrize(("unit", "message"), [("foo", "unknown unit 'foo'"), ("kg", "'kg' cannot be")])
def test_a_bad_unit_of_the_file_names_signal_and_channel(unit: str, message: str) -> None:
    text = refusal({"channels": {"accel_x": "ax"}}, recording(ax=([1.0], unit)))
    assert text.startswith("drive.csv:ax as accel_x: ")
    assert message in text


def test_sign_scale_and_offset_apply_in_this_order_in_si() -> None:
    spec = {"from": "w", "unit": "deg", "sign": -1, "scale": 2.0, "offset": "90 deg"}
    out = apply({"channels": {"steering_wheel": spec}}, recording(w=[10.0]))
    np.testing.assert_allclose(out["steering_wheel"].values, [-2 * np.radians(10) + np.pi / 2])


@pytest.mark.parametrize(
    ("unit", "scale"), [("%", "320 N*m"), ("%", "3.2 N*m/%"), (None, "3.2 Nm"), ("-", "0.0032 kN*m")]
)
def test_a_scale_with_a_unit_turns_a_dimensionless_signal_into_the_channels(
    unit: str | None, scale: str
) -> None:
    out = apply({"channels": {"engine_torque": {"from": "t", "scale": scale}}}, recording(t=([50.0], unit)))
    np.testing.assert_allclose(out["engine_torque"].values, [160.0])


def test_a_scale_with_a_unit_refuses_a_signal_that_has_one_of_its_own() -> None:
    spec = {"engine_torque": {"from": "t", "scale": "3 N*m"}}
    assert "unit 'bar' cannot be converted to '-'" in refusal({"channels": spec}, recording(t=([1.0], "bar")))


@pytest.mark.parametrize(("unit", "value"), [("%", 10.0), ("-", 0.1), ("rad", np.arctan(0.1))])
def test_slopes_become_angles(unit: str, value: float) -> None:
    out = apply({"reference": {"ref_grade": {"from": "s", "unit": unit}}}, recording(s=[value]))
    np.testing.assert_allclose(out["ref_grade"].values, [np.arctan(0.1)])


@pytest.mark.parametrize(("unit", "value"), [("m/s", 12.0), ("km/h", 43.2)])
def test_wheel_speeds_along_the_road_are_divided_by_the_radius(unit: str, value: float) -> None:
    raw = recording(v=([value], unit))
    out = apply({"channels": {"wheel_speed_fl": "v"}}, raw, wheel_radius=0.3)
    np.testing.assert_allclose(out["wheel_speed_fl"].values, [40.0])
    text = refusal({"channels": {"wheel_speed_fl": "v"}}, raw)
    assert "--vehicle" in text
    assert "scale" in text


@pytest.mark.parametrize(("unit", "value"), [("rad/s", 40.0), ("rpm", 381.97186342), (None, 40.0)])
def test_wheel_speeds_about_the_axle_need_no_radius(unit: str | None, value: float) -> None:
    out = apply({"channels": {"wheel_speed_fl": "v"}}, recording(v=([value], unit)))
    np.testing.assert_allclose(out["wheel_speed_fl"].values, [40.0])


@pytest.mark.parametrize("radius", [0.0, -0.3, np.nan, 30.0])
def test_a_wheel_radius_that_is_none_is_refused(radius: float) -> None:
    raw = recording(v=([1.0], "m/s"))
    assert "out of range" in refusal({"channels": {"wheel_speed_fl": "v"}}, raw, wheel_radius=radius)


# --- magnitudes ------------------------------------------------------------------------------------------


def test_the_message_of_an_implausible_channel() -> None:
    values = np.full(6000, 50.0)
    values[1231:1543] = 260.0
    raw = recording(time=np.arange(6000) / 100, wheel_speed_fl=values)
    assert refusal({}, raw) == (
        "drive.csv:wheel_speed_fl as wheel_speed_fl: 312 of 6000 samples exceed 250 rad/s "
        "(first at t=12.31 s); is the unit km/h? Set 'unit: km/h' in the mapping"
    )


@pytest.mark.parametrize(
    ("name", "typical", "unit"),
    [
        ("speed", 130.0, "km/h"),
        ("accel_x", 1000.0, "mg"),
        ("yaw_rate", 20.0, "deg/s"),
        ("steering_wheel", 180.0, "deg"),
        ("steer", 20.0, "deg"),
        ("ref_grade", 6.0, "%"),
        ("engine_speed", 3000.0, "rpm"),
    ],
)
def test_the_unit_that_would_explain_it_is_named(name: str, typical: float, unit: str) -> None:
    raw = recording(**{name: np.full(200, typical)})
    text = refusal({}, raw)
    assert "200 of 200 samples exceed" in text
    assert f"Set 'unit: {unit}' in the mapping" in text
    mended = apply({"channels": {name: {"unit": unit}}}, raw)
    assert np.isfinite(mended[name].values).all()


def test_a_few_spikes_stay() -> None:
    values = np.full(1000, 20.0)
    values[:10] = 1e6
    assert DEFAULT_MAPPING.apply(recording(speed=values))["speed"].values[0] == 1e6
    values[10] = 1e6
    assert "11 of 1000 samples exceed 120 m/s" in refusal({}, recording(speed=values))


@pytest.mark.parametrize("name", ["ref_grade", "ref_velocity_x", "ref_friction_fl"])
def test_one_impossible_sample_of_a_reference_is_refused(name: str) -> None:
    """It would be all that an error comes to."""
    values = np.full(1000, 0.01)
    values[500] = 1e30
    text = refusal({}, recording(**{name: values}))
    assert "1 of 1000 samples exceed" in text
    assert "leave them out by 'range: [least, largest]' in the mapping" in text
    mended = apply({"channels": {name: {"range": [-1, 1]}}}, recording(**{name: values}))
    assert np.isnan(mended[name].values[500])


def test_where_no_unit_explains_it_none_is_named() -> None:
    assert "check unit and scale" in refusal({}, recording(speed=np.full(10, 1e9)))


def test_every_channel_but_the_brake_has_a_limit() -> None:
    assert {n for n in CHANNELS if limit_of(n) is None} == {"time", "brake"}


def upright(z: float, count: int = 200) -> dict[str, Any]:
    """What an accelerometer reads on a rough, slightly hilly road, if gravity reads ``z``."""
    random = np.random.default_rng(0)
    spread = random.normal(size=(3, count)) * abs(z) / 9.81
    return {"accel_x": 0.3 * spread[0], "accel_y": 0.5 * spread[1], "accel_z": z + 2.0 * spread[2]}


@pytest.mark.parametrize("z", [0.97, -1.02])
def test_accelerations_in_g_without_a_unit_are_told_by_gravity(z: float) -> None:
    raw = recording(**upright(z))
    text = refusal({}, raw)
    assert text.startswith("drive.csv:accel_z as accel_z: the median is ")
    assert text.endswith(
        "m/s^2, where gravity alone makes 9.81; is the unit g? Set 'unit: g' in the mapping, or write "
        "'accel_z [g]' in the table's header; look at accel_x and accel_y, too"
    )
    mended = apply({"channels": {f"accel_{a}": {"unit": "g"} for a in "xyz"}}, raw)
    assert abs(np.median(mended["accel_z"].values)) == pytest.approx(9.81, rel=0.1)
    axes = {"imu": {"accel": {a: f"accel_{a}" for a in "xyz"}}}
    assert "is the unit g?" in refusal(axes, raw)
    axes["imu"]["accel"]["unit"] = "g"
    assert set(apply(axes, raw).signals) == {"accel_x", "accel_y", "accel_z"}


def test_accelerations_in_si_called_g_are_told_by_gravity() -> None:
    raw = recording(**{name: (values, "g") for name, values in upright(9.81).items()})
    assert "is the unit m/s^2? Set 'unit: m/s^2' in the mapping" in refusal({}, raw)


@pytest.mark.parametrize("z", [9.81, -9.6, 11.0, 3.0, np.nan])
def test_what_gravity_does_not_disprove_stays(z: float) -> None:
    assert "accel_z" in apply({}, recording(**upright(z))).signals


def test_vertical_accelerations_without_gravity_are_not_taken_for_g() -> None:
    shaken = 1.5 * np.random.default_rng(1).normal(size=500)
    assert 0.8 < np.median(np.abs(shaken)) < 1.2
    assert "accel_z" in DEFAULT_MAPPING.apply(recording(accel_z=shaken)).signals


# --- references ------------------------------------------------------------------------------------------


def test_a_grade_derived_from_height(tmp_path: Path) -> None:
    t = np.arange(0.0, 200.0)
    height = 100 + 0.05 * 20 * t
    height[50] = -5400.0
    raw = recording(
        **{
            "alt.H": can(height, "alt", "m", time=t),
            "alt.Valid": can(np.where(t == 50, 0.0, 1.0), "alt", time=t),
            "gps.V": can(np.full(200, 72.0), "gps", "km/h", time=t),
        }
    )
    content = """
reference:
  ref_grade:
    slope_of: {from: H, valid: {signal: Valid, equals: 1}, delay: 0.4 s}
    speed: {from: V, delay: 0.4 s}
    over: 200 m
"""
    out = mapping_of(tmp_path, content).apply(raw)
    grade = out["ref_grade"]
    np.testing.assert_allclose(grade.time, t - 0.4)
    inside = np.isfinite(grade.values)
    assert not inside[[0, 50, 199]].any()
    assert inside.sum() > 180
    np.testing.assert_allclose(grade.values[inside], np.arctan(0.05), rtol=1e-9)
    assert out.metadata["mapped"]["ref_grade"] == "slope of alt.H over gps.V"
    assert out.metadata["sources"]["ref_grade"] == ["alt.H", "gps.V"]
    assert out.metadata["reference_std"]["ref_grade"] < 1e-6


def test_a_reference_that_cannot_be_derived_leaves_no_standard_error() -> None:
    raw = recording(h=np.full(9, np.nan), v=np.full(9, 20.0))
    out = apply({"reference": {"ref_grade": {"slope_of": "h", "speed": "v", "over": 100}}}, raw)
    assert np.isnan(out["ref_grade"].values).all()
    assert "reference_std" not in out.metadata


def test_the_standard_error_of_a_reference_goes_with_that_reference() -> None:
    raw = recording(ref_grade=[0.1, 0.1], slope=[0.1, 0.1])
    told = {"mapped": {"x": "y"}, "sources": {"x": ["y"]}, "reference_std": {"ref_grade": 0.01, "bank": 1}}
    written = Recording(raw.signals, {**raw.metadata, **told})
    for content in ({}, {"reference": {"ref_grade": "ref_grade"}}):
        assert apply(content, written).metadata["reference_std"] == {"ref_grade": 0.01}
    for spec in ("slope", {"from": "ref_grade", "scale": 2}, {"from": "ref_grade", "unit": "deg"}):
        assert "reference_std" not in apply({"reference": {"ref_grade": spec}}, written).metadata
    listed = apply({"channels": {"speed": "slope"}, "only_listed": True}, written)
    assert "reference_std" not in listed.metadata
    assert set(listed.metadata["mapped"]) == {"speed"}


def test_a_derived_reference_may_be_optional() -> None:
    spec = {"slope_of": {"from": "h", "optional": True}, "speed": "v", "over": 100}
    assert "ref_grade" not in apply({"reference": {"ref_grade": spec}}, recording(v=[1.0])).signals
    del spec["slope_of"]["optional"]  # type: ignore[attr-defined]
    text = refusal({"reference": {"ref_grade": spec}}, recording(v=[1.0]))
    assert text.startswith("drive.csv: ref_grade.slope_of: no signal matches 'h'")
