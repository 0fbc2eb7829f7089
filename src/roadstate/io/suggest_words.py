"""The words by which people call a car's signals, in English and German, and which of them make a channel."""

from __future__ import annotations

import re
from dataclasses import dataclass

from roadstate.core import WHEELS

# Patterns over a name in lower case whose words are set off by '_' on both sides: '_whl_spd_fl_'.
WORDS: dict[str, re.Pattern[str]] = {
    name: re.compile(pattern)
    for name, pattern in {
        "fl": r"_fl(?=_)|_vl(?=_)|_lf(?=_)|front_?left|left_?front|vorne?_?links",
        "fr": r"_fr(?=_)|_vr(?=_)|_rf(?=_)|front_?right|right_?front|vorne?_?rechts",
        "rl": r"_rl(?=_)|_hl(?=_)|_lr(?=_)|rear_?left|left_?rear|hinten?_?links",
        "rr": r"_rr(?=_)|_hr(?=_)|rear_?right|right_?rear|hinten?_?rechts",
        "steering_wheel": r"steer(?:ing)?_?(?:wheel|whl)|lenkrad|_str_?whl|_swa(?=_)|_sas(?=_)|_lwi(?=_)",
        "road_wheel": r"road_?wheel|front_?wheel|radlenk|radeinschlag",
        "delta": r"^_delta_(?=$|rad_$|deg_$|f_$|front_$)",
        "wheel": r"wheel|whl|_rad(?=dreh|geschw|_(?:vl|vr|hl|hr|dreh|geschw))",
        "steer": r"steer|lenk|_strg(?=_)|_str(?=_)",
        "angle": r"angle|angl|_ang(?=_)|winkel|_wnkl(?=_)|einschlag",
        "speed": r"speed|spd|velocity|_vel(?=_)|_v(?=_)|geschw|tempo|_vfzg(?=_)|_vx(?=_)",
        "turning": r"drehz|_omega(?=_)|_n(?=_)|_rpm(?=_)",
        "accel": r"_acc(?=_)|accel|_accl(?=_)|beschl|_a(?=_)",
        "a_x": r"_ax(?=_)",
        "a_y": r"_ay(?=_)",
        "a_z": r"_az(?=_)",
        "x": r"_x(?=_)|laengs|longitud|_long(?=_)|_lon(?=_)|_lgt(?=_)|_fwd(?=_)|forward",
        "y": r"_y(?=_)|quer|lateral|_lat(?=_)|_latl(?=_)",
        "z": r"_z(?=_)|vertical|vertikal|_vert(?=_)",
        "gyro": r"gyro|_gyr(?=_)|angular_rate|_ang_rate|drehrate|angular_vel(?:ocity)?|_omega(?=_)",
        "g_x": r"_gx(?=_)|_wx(?=_)",
        "g_y": r"_gy(?=_)|_wy(?=_)",
        "g_z": r"_gz(?=_)|_wz(?=_)",
        "rate": r"rate|_vel(?=_)|speed|geschw",
        "roll": r"_roll|wank",
        "pitch": r"_pitch|nick",
        "yaw": r"_yaw|gier|_psi(?=_)|_psip(?=_)",
        "engine": r"engine|_eng(?=_)|motor|_mot(?=_)|kurbelwelle|crank",
        "rpm": r"_rpm(?=_)|engine_?rpm|motordrehz\w*|_nmot(?=_)|_n_?mot(?=_)",
        "torque": r"torque|_trq(?=_)|_tq(?=_)|moment|_md(?=_)|_mom(?=_)",
        "drive": r"drive|antrieb|propul",
        "brake": r"brake|_brk(?=_)|brems",
        "pressure": r"pressure|_press(?=_)|_prs(?=_)|druck",
        "gear_ratio": r"gear_?ratio|uebersetzung|transmission_?ratio",
        "latitude": r"latitude|_lat(?=_)|breitengrad",
        "longitude": r"longitude|_lon(?=_)|_lng(?=_)|_long(?=_)|laengengrad",
        "altitude": r"altitude|_alt(?=_)|height|hoehe|elevation|_elev(?=_)",
        "climb": r"vertical|vertikal|climb|_up(?=_)|_vup(?=_)|steig",
        "grade": r"grade|slope|gradient|steigung|neigung|_gradt(?=_)",
    }.items()
}
NEUTRAL = re.compile(
    r"_(?:car|veh|vehicle|fzg|fahrzeug|gnss|gps|imu|obd|can|sensor|signal|sig|value|val|wert|actual|act|ist"
    r"|measured|meas|raw|abs|esp|esc|body|chassis|h)(?=_)"
)
"""Words that say nothing of which channel it is."""
ASIDE = re.compile(
    r"valid|status|_state|quality|_qual|accuracy|_std(?=_)|sigma|varian|counter|_cnt(?=_)|_crc|checksum|alive"
    r"|error|_err(?=_)|_fail|fault|offset|_bias|uncal|target|desired|request|demand|_req(?=_)|_soll|_max|_min"
    r"|limit|temp(?!o)|_gap(?=_)|_time|epoch|display|predict|estimat|_cruise|_fan|turbine|pedal|idle|_wind|_mag"
)
"""Words of signals about a signal, or of something else that moves."""
TRUTH = re.compile(r"_ref|truth|_true|_pose|ground_|_gt(?=_)|reference")
"""Words of signals to compare with, which are not measured by the car."""

AXES = ("accel", "gyro", "roll", "pitch", "yaw", "a_x", "a_y", "a_z", "g_x", "g_y", "g_z", "x", "y", "z")
"""Words that name a sensor's axis rather than the sensor."""
UNIT_WORDS = {
    "mps2": "m/s^2",
    "mpss": "m/s^2",
    "ms2": "m/s^2",
    "dps": "deg/s",
    "degps": "deg/s",
    "degs": "deg/s",
    "radps": "rad/s",
    "rads": "rad/s",
    "kmh": "km/h",
    "kph": "km/h",
    "mph": "mph",
    "mps": "m/s",
    "rpm": "rpm",
    "nm": "N*m",
    "pct": "%",
    "percent": "%",
    "kpa": "kPa",
    "mpa": "MPa",
    "mbar": "mbar",
}
"""Units as words of a name, wherever they stand in it."""
SPLIT_UNITS = {
    "_rad_s_": "_radps_",
    "_deg_s_": "_dps_",
    "_m_s2_": "_mps2_",
    "_m_s_2_": "_mps2_",
    "_km_h_": "_kmh_",
    "_m_s_": "_mps_",
    "_n_m_": "_nm_",
    "_1_min_": "_rpm_",
}
"""Units that fall apart into words at the end of a name, and the one word for them."""
LAST_UNIT_WORDS = {"deg": "deg", "rad": "rad", "g": "g", "bar": "bar", "pa": "Pa", "m": "m"}
"""Units that are other words too: taken for one only at the end of a name."""


@dataclass(frozen=True)
class Rule:
    """What a signal's name must say to be taken for a channel.

    Attributes:
        channel: canonical name.
        ways: sets of words, any of which is enough.
        never: words that rule it out.
    """

    channel: str
    ways: tuple[tuple[str, ...], ...]
    never: tuple[str, ...] = ()


_NOT_SPEED = (
    "wheel",
    "engine",
    "turning",
    "yaw",
    "roll",
    "pitch",
    "steer",
    "climb",
    "gyro",
    "y",
    "z",
    "accel",
)
RULES: tuple[Rule, ...] = (
    Rule("speed", (("speed",),), _NOT_SPEED),
    *(
        Rule(
            f"wheel_speed_{w}", (("wheel", "speed", w), ("wheel", "turning", w)), ("steering_wheel", "accel")
        )
        for w in WHEELS
    ),
    Rule(
        "steering_wheel", (("steering_wheel", "angle"), ("steer", "angle")), ("rate", "torque", "road_wheel")
    ),
    Rule(
        "steer",
        (("road_wheel", "angle"), ("road_wheel", "steer"), ("delta",)),
        ("rate", "torque", "speed", "turning"),
    ),
    Rule("accel_x", (("accel", "x"), ("a_x",)), ("gyro", "yaw")),
    Rule("accel_y", (("accel", "y"), ("a_y",)), ("gyro", "yaw")),
    Rule("accel_z", (("accel", "z"), ("a_z",)), ("gyro", "yaw")),
    Rule("roll_rate", (("roll", "rate"), ("gyro", "x"), ("g_x",)), ("accel", "wheel")),
    Rule("pitch_rate", (("pitch", "rate"), ("gyro", "y"), ("g_y",)), ("accel", "wheel")),
    Rule("yaw_rate", (("yaw", "rate"), ("gyro", "z"), ("g_z",)), ("accel", "wheel")),
    Rule("engine_torque", (("engine", "torque"),), ("wheel",)),
    Rule("engine_speed", (("engine", "speed"), ("engine", "turning"), ("rpm",)), ("wheel",)),
    Rule("gear_ratio", (("gear_ratio",),)),
    Rule("brake", (("brake",),), ("fl", "fr", "rl", "rr", "torque")),
    Rule("latitude", (("latitude",),), ("accel", "speed")),
    Rule("longitude", (("longitude",),), ("accel", "speed")),
    Rule("altitude", (("altitude",),), ("accel", "speed")),
    Rule("vertical_speed", (("climb", "speed"),), ("accel", "engine")),
    *(Rule(f"drive_torque_{w}", (("drive", "torque", w),)) for w in WHEELS),
    *(Rule(f"brake_torque_{w}", (("brake", "torque", w),)) for w in WHEELS),
    *(Rule(f"brake_pressure_{w}", (("brake", "pressure", w),)) for w in WHEELS),
)
"""What makes each measured channel."""
REFERENCE_RULES: tuple[Rule, ...] = (
    Rule("ref_grade", (("grade",),)),
    Rule("ref_velocity_x", (("speed",),), _NOT_SPEED),
)
"""What may be truth to compare with: named in the draft, never chosen."""
