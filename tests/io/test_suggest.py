"""Drafts of mapping files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recordings import can, mapping_of, recording

from roadstate.core import WHEELS, Recording
from roadstate.core.yaml_text import read_yaml
from roadstate.io.files import read, read_all
from roadstate.io.mapping import DEFAULT_MAPPING, Mapping
from roadstate.io.suggest import suggest

TIME = np.arange(0.0, 50.0, 0.1)
WAVE = np.sin(TIME)


def drafted(raw: Recording) -> tuple[Mapping, Recording, str]:
    """The mapping that the draft is, what it makes of the recording, and its text."""
    text = suggest(raw)
    mapping = Mapping.model_validate(read_yaml(text, "draft").data)
    return mapping, mapping.apply(raw, wheel_radius=0.3), text


def channel_of(name: str, values: Any = None, unit: str | None = None) -> set[str]:
    """The channels that a lone signal of this name is drafted for."""
    values = WAVE if values is None else values
    _, out, _ = drafted(recording(time=TIME, **{name: (values, unit)}))
    return set(out.signals)


@pytest.mark.parametrize(
    ("name", "channel"),
    [
        ("vWheelFL", "wheel_speed_fl"),
        ("WHL_SPD_FR", "wheel_speed_fr"),
        ("wheel_speed_rl_mps", "wheel_speed_rl"),
        ("ABS.WheelSpeedRearRight", "wheel_speed_rr"),
        ("Raddrehzahl_VL", "wheel_speed_fl"),
        ("ESP_Rad_HR_Geschw", "wheel_speed_rr"),
        ("gnss_speed.Speed", "speed"),
        ("VehicleSpeed", "speed"),
        ("Fahrzeuggeschwindigkeit", "speed"),
        ("vx", "speed"),
        ("v_mps", "speed"),
        ("STEER_ANGLE", "steering_wheel"),
        ("SteeringWheelAngle", "steering_wheel"),
        ("LWI_Lenkradwinkel", "steering_wheel"),
        ("delta", "steer"),
        ("FrontWheelAngle", "steer"),
        ("ESP_Laengsbeschl", "accel_x"),
        ("Längsbeschleunigung", "accel_x"),
        ("car_ax_raw_mps2", "accel_x"),
        ("LongAccel", "accel_x"),
        ("ACCEL_X", "accel_x"),
        ("ESP_Querbeschleunigung", "accel_y"),
        ("LatAcc", "accel_y"),
        ("imu.AccelerationY", "accel_y"),
        ("Gierrate", "yaw_rate"),
        ("yawRate", "yaw_rate"),
        ("yaw_rate_rad_s", "yaw_rate"),
        ("GyroZ", "yaw_rate"),
        ("imu_gz_dps", "yaw_rate"),
        ("PitchRate", "pitch_rate"),
        ("Nickrate", "pitch_rate"),
        ("gyro_x", "roll_rate"),
        ("engine_rpm", "engine_speed"),
        ("RPM", "engine_speed"),
        ("Motordrehzahl", "engine_speed"),
        ("EngineSpeed", "engine_speed"),
        ("engine_torque_Nm", "engine_torque"),
        ("Motormoment", "engine_torque"),
        ("gear_ratio", "gear_ratio"),
        ("BrakePedalPressed", "brake"),
        ("Bremslichtschalter", "brake"),
        ("gnss_pos.Latitude", "latitude"),
        ("lat_deg", "latitude"),
        ("lon", "longitude"),
        ("gnss_altitude.Altitude", "altitude"),
        ("alt_m", "altitude"),
        ("VerticalSpeed", "vertical_speed"),
        ("BrakePressureFL", "brake_pressure_fl"),
        ("Bremsmoment_HL", "brake_torque_rl"),
        ("DriveTorque_RR", "drive_torque_rr"),
        ("yaw_rate", "yaw_rate"),
    ],
)
def test_names_in_use_are_known(name: str, channel: str) -> None:
    assert channel_of(name) == {channel}


@pytest.mark.parametrize(
    "name",
    [
        "SpeedAccuracy",
        "gnss_speed.SpeedValid",
        "wheel_speed_counter_fl",
        "target_speed",
        "speed_limit",
        "FanSpeed",
        "alt_acc_m",
        "SteerTorque",
        "steer_rate",
        "gnss_attitude.Pitch",
        "heading_deg",
        "yawAngAcc",
        "intake_temperature",
        "gas_pedal",
        "AcceleratorPedal",
        "gnss_gap_s",
        "gnss_time.Epoch",
        "Geofence1",
        "radio_station",
    ],
)
def test_names_of_other_things_are_not_taken(name: str) -> None:
    assert channel_of(name) == set()


def test_a_unit_in_the_name_is_written_down() -> None:
    raw = recording(time=TIME, car_yaw_rate_dps=90 * WAVE, steer_angle_deg=90 * WAVE, v_veh_kmh=50 + WAVE)
    _, out, text = drafted(raw)
    assert "yaw_rate: {from: car_yaw_rate_dps, unit: deg/s}" in text
    assert "steering_wheel: {from: steer_angle_deg, unit: deg}" in text
    assert "speed: {from: v_veh_kmh, unit: km/h}" in text
    np.testing.assert_allclose(out["yaw_rate"].values, np.pi / 2 * WAVE)


def test_the_files_unit_is_left_to_speak() -> None:
    text = suggest(recording(time=TIME, yaw_rate_raw=(WAVE, "deg/s")))
    assert "  yaw_rate: yaw_rate_raw\n" in text


def test_a_unit_is_guessed_from_the_magnitude_and_said_to_be() -> None:
    raw = recording(time=TIME, VehicleSpeed=180 + 10 * WAVE)
    _, out, text = drafted(raw)
    assert "speed: {from: VehicleSpeed, unit: km/h}  # unit guessed from the magnitude" in text
    np.testing.assert_allclose(out["speed"].values, (180 + 10 * WAVE) / 3.6)


def test_without_any_unit_the_draft_says_what_it_takes() -> None:
    assert "yaw_rate: Gierrate  # no unit given: taken to be in rad/s" in suggest(recording(Gierrate=[0.1]))


def test_a_tie_is_left_to_the_reader() -> None:
    raw = recording(time=TIME, a=WAVE, gps_speed_mps=10 + WAVE, obd_speed_mps=10 + WAVE)
    _, out, text = drafted(raw)
    assert "speed" not in out.signals
    assert "# speed: 2 signals fit equally well; keep one:" in text
    assert "# speed: {from: gps_speed_mps, unit: m/s}" in text
    assert "# speed: {from: obd_speed_mps, unit: m/s}" in text


def test_a_clear_winner_is_taken_and_the_others_named() -> None:
    raw = recording(time=TIME, speed_mps=10 + WAVE, backup_speed=10 + WAVE)
    mapping, out, text = drafted(raw)
    assert set(out.signals) == {"speed"}
    assert mapping.channels["speed"].from_[0].signal == "speed_mps"
    assert "# speed could also be backup_speed" in text


def test_a_unit_that_does_not_fit_stands_as_a_doubt() -> None:
    raw = recording(time=TIME, **{"obd.actual_engine_torque": can(50 + WAVE, "obd", "%", time=TIME)})
    _, out, text = drafted(raw)
    assert not out.signals
    assert "# engine_torque: obd.actual_engine_torque  # per cent of a torque: give that as scale" in text


def test_the_flag_of_a_message_becomes_its_condition() -> None:
    raw = recording(
        **{
            "pos.Latitude": can([56.0, 0.0], "pos", "deg"),
            "pos.PositionValid": can([1.0, 0.0], "pos"),
            "other.Valid": can([1.0, 1.0], "other"),
        }
    )
    _, out, text = drafted(raw)
    assert "latitude: {from: pos.Latitude, valid: {signal: pos.PositionValid, equals: 1}}" in text
    np.testing.assert_array_equal(out["latitude"].values, [56.0, np.nan])


def test_an_imu_on_its_side_is_not_taken_for_the_cars() -> None:
    raw = recording(
        time=TIME,
        phone_acc_x=9.7 + 0.1 * WAVE,
        phone_acc_y=WAVE,
        phone_acc_z=-0.2 * WAVE,
        phone_gyro_z=WAVE,
        car_yaw_rate=WAVE,
    )
    _, out, text = drafted(raw)
    assert set(out.signals) == {"yaw_rate"}
    assert "# rotation: {up: X, forward: ?}" in text
    assert "#     y: phone_acc_y" in text
    assert "#     z: phone_gyro_z" in text
    upside_down = recording(time=TIME, acc_x=WAVE, acc_z=-9.81 + 0.1 * WAVE)
    assert "# rotation: {up: -Z, forward: ?}" in suggest(upside_down)
    upright = recording(time=TIME, acc_x=WAVE, acc_z=9.81 + 0.1 * WAVE)
    assert set(drafted(upright)[1].signals) == {"accel_x", "accel_z"}


def test_truth_is_named_but_never_an_input() -> None:
    raw = recording(time=TIME, pose_speed_mps=10 + WAVE, ref_slope=0.1 * WAVE, ref_friction_fl=0.5 + 0 * WAVE)
    _, out, text = drafted(raw)
    assert not out.signals
    assert "#   ref_velocity_x: {from: pose_speed_mps, unit: m/s}" in text
    assert "#   ref_grade: ref_slope" in text


def test_a_log_of_canonical_names_maps_to_itself() -> None:
    wheels = {f"wheel_speed_{w}": ((9.81 + WAVE) / 0.3, "rad/s") for w in WHEELS}
    names = ["speed", "accel_x", "accel_z", *wheels]
    raw = recording(time=TIME, speed=9.81 + WAVE, accel_x=(WAVE, "m/s^2"), accel_z=9.81 + WAVE, **wheels)
    _, out, _ = drafted(raw)
    assert set(out.signals) == set(names) == set(DEFAULT_MAPPING.apply(raw).signals)


def test_a_canonical_name_with_a_bad_unit_does_not_spoil_the_draft() -> None:
    _, out, text = drafted(recording(speed=([1.0], "kg"), Gierrate=[0.1]))
    assert set(out.signals) == {"yaw_rate"}
    assert "# speed: speed  # unit 'kg' cannot be converted to 'm/s'" in text


def test_bad_time_is_repaired_in_the_draft() -> None:
    _, out, text = drafted(recording(time=[0.0, 1.0, 1.0], speed_mps=[1.0, 2.0, 3.0]))
    assert "time: {repair: drop}" in text
    assert len(out["speed"]) == 2


def test_an_empty_recording_gives_a_draft_that_loads(tmp_path: Path) -> None:
    raw = Recording({}, {})
    assert not mapping_of(tmp_path, suggest(raw)).apply(raw).signals


odd = st.text(min_size=1, max_size=30) | st.sampled_from(
    [
        "null",
        "~",
        "speed: x",
        "a\nspeed: b",
        "# speed",
        "speed\u2028",
        "*speed",
        "{speed",
        "Speed@1",
        "s'p\"eed",
        "-",
    ]
)
words = st.sampled_from(
    ["speed", "wheel", "fl", "accel_x", "yawRate", "_mps", "_deg", ".", "Valid", "rpm", "lat", "lon"]
)


@given(
    st.dictionaries(
        odd | st.lists(words, min_size=1, max_size=4).map("".join) | st.tuples(odd, words).map("".join),
        st.tuples(
            st.none() | st.sampled_from(["m/s", "%", "", "bar", "nonsense", "deg/s"]),
            st.sampled_from([0.0, 1.0, 9.8, 1e4, np.nan, np.inf]),
        ),
        max_size=8,
    )
)
@settings(max_examples=150, deadline=None)
def test_any_draft_loads_and_applies(signals: dict[str, tuple[str | None, float]]) -> None:
    raw = recording(**{k: ([v, v, 1.0], u) for k, (u, v) in signals.items()})
    mapping, out, text = drafted(raw)
    assert set(out.signals) == set(mapping.channels)
    assert all(spec.from_[0].signal in signals for spec in mapping.channels.values())
    assert not re.search(r"[^\S\n ]", text)  # nothing from a name breaks out of its line


# --- the real recordings ---------------------------------------------------------------------------------


def test_the_draft_for_the_comma2k19_segment(shared_data: Path) -> None:
    raw = read(shared_data / "comma2k19" / "segment40_decoded_50Hz.csv.gz")
    mapping, out, text = drafted(raw)
    chosen = {n: (s.from_[0].signal, s.unit) for n, s in mapping.channels.items()}
    assert chosen == {
        **{f"wheel_speed_{w}": (f"wheel_speed_{w}_mps", "m/s") for w in WHEELS},
        "steering_wheel": ("steering_wheel_angle_deg", "deg"),
        "accel_x": ("car_ax_raw_mps2_signflipped", "m/s^2"),
        "accel_y": ("car_ay_raw_mps2", "m/s^2"),
        "yaw_rate": ("car_yaw_rate_dps", "deg/s"),
        "engine_speed": ("engine_rpm", "rpm"),
        "brake": ("brake_pressure_raw", None),
        "latitude": ("lat_deg", "deg"),
        "longitude": ("lon_deg", "deg"),
    }
    assert "# engine_torque: 2 signals fit equally well" in text
    assert "# rotation: {up: -Z, forward: ?}" in text  # the phone
    assert "ref_grade: ref_grade_vup_over_vh" in text
    assert set(out.signals) == set(chosen)


def test_the_draft_for_the_css_drive(shared_data: Path) -> None:
    folder = shared_data / "css_mf4"
    raw = read_all(sorted(folder.glob("0*.MF4")), dbc=[folder / "canmod-gps.dbc"])
    mapping, out, text = drafted(raw)
    assert set(out.signals) == {"engine_speed", "latitude", "longitude", "altitude"}
    assert mapping.channels["altitude"].valid[0].signal == "gnss_altitude.AltitudeValid"
    assert out["altitude"].values[np.isfinite(out["altitude"].values)].min() > 0
    assert "# speed: 2 signals fit equally well" in text
    assert "# speed: obd.vehicle_speed" in text
    assert "# rotation: {up: X, forward: ?}" in text
