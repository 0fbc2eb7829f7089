"""The canonical channels: one table of names, SI units and signs for readers, documents and the command line.

Axes are ISO 8855: x forward, y left, z up; yaw rate and steer positive to the left; grade positive uphill,
bank positive when the left side is higher. Wheels in the order fl, fr, rl, rr.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass

from roadstate.core.errors import InputError

WHEELS = ("fl", "fr", "rl", "rr")
SPECIFIC_FORCES = ("accel_x", "accel_y", "accel_z")
"""What three accelerometers tell, along the car's axes."""
RATES = ("roll_rate", "pitch_rate", "yaw_rate")
"""What three gyroscopes tell, about them."""
_WHEEL_TEXT = {"fl": "front left", "fr": "front right", "rl": "rear left", "rr": "rear right"}


@dataclass(frozen=True)
class Channel:
    """One signal's meaning.

    Attributes:
        name: canonical name.
        unit: SI unit the values are kept in.
        description: what is measured.
        sign: what a positive value means; empty where nothing but a magnitude is meant.
    """

    name: str
    unit: str
    description: str
    sign: str = ""

    @property
    def is_reference(self) -> bool:
        """Whether the channel carries truth to compare with rather than a measurement."""
        return self.name.startswith("ref_")


_PLAIN = (
    Channel("time", "s", "time since the start of the log"),
    Channel("speed", "m/s", "speed of the car along its x axis", "forward; unsigned sensors stay positive"),
    Channel("velocity_y", "m/s", "velocity of the centre of gravity along y", "to the left"),
    Channel("steer", "rad", "mean front road-wheel angle", "to the left"),
    Channel("steering_wheel", "rad", "steering-wheel angle", "to the left"),
    Channel("accel_x", "m/s^2", "IMU specific force along x (gravity included)", "forward"),
    Channel("accel_y", "m/s^2", "IMU specific force along y (gravity included)", "to the left"),
    Channel("accel_z", "m/s^2", "IMU specific force along z (gravity included)", "up; +9.81 at rest"),
    Channel("kinematic_accel_x", "m/s^2", "acceleration along x, gravity removed", "forward"),
    Channel("kinematic_accel_y", "m/s^2", "acceleration along y, gravity removed", "to the left"),
    Channel("roll_rate", "rad/s", "rotation rate about x", "right side goes down"),
    Channel("pitch_rate", "rad/s", "rotation rate about y", "nose goes down"),
    Channel("yaw_rate", "rad/s", "rotation rate about z", "to the left"),
    Channel("yaw_accel", "rad/s^2", "rate of change of the yaw rate", "to the left"),
    Channel("engine_torque", "N*m", "net torque of engine or motor at its shaft", "driving"),
    Channel("engine_speed", "rad/s", "speed of the engine's or motor's shaft", "running direction"),
    Channel(
        "gear_ratio",
        "-",
        "transmission ratio in mesh, without the final drive; 0 in neutral or clutch open",
        "forward gears; reverse is negative",
    ),
    Channel("brake", "-", "brake pedal or brake switch: 0 released, more than 0 pressed", "pressed"),
    Channel("latitude", "deg", "geodetic latitude", "north"),
    Channel("longitude", "deg", "geodetic longitude", "east"),
    Channel("altitude", "m", "height of the car (GNSS or barometer)", "up"),
    Channel("vertical_speed", "m/s", "rate of climb", "up"),
    Channel("ref_grade", "rad", "true road grade angle", "uphill"),
    Channel("ref_bank", "rad", "true road bank angle", "left side higher"),
    Channel("ref_velocity_x", "m/s", "true velocity of the centre of gravity along x", "forward"),
    Channel("ref_velocity_y", "m/s", "true velocity of the centre of gravity along y", "to the left"),
)
_PER_WHEEL = (
    Channel("wheel_speed", "rad/s", "wheel rotation speed", "forward; unsigned sensors stay positive"),
    Channel("drive_torque", "N*m", "drive torque at the wheel", "driving forward"),
    Channel("brake_torque", "N*m", "brake torque at the wheel", "magnitude, never negative"),
    Channel("brake_pressure", "Pa", "brake line pressure at the wheel", "magnitude, never negative"),
    Channel("ref_friction", "-", "true peak tire-road friction coefficient"),
    Channel("ref_force_x", "N", "true longitudinal tire force in the wheel's frame", "forward"),
    Channel("ref_force_y", "N", "true lateral tire force in the wheel's frame", "to the left"),
    Channel("ref_load", "N", "true vertical load", "magnitude, never negative"),
    Channel("ref_slip", "-", "true practical slip κ", "driving"),
    Channel("ref_slip_angle", "rad", "true slip angle α", "force to the left"),
)


def _table() -> dict[str, Channel]:
    rows = list(_PLAIN)
    for c in _PER_WHEEL:
        rows += [
            Channel(f"{c.name}_{w}", c.unit, f"{c.description}, {_WHEEL_TEXT[w]}", c.sign) for w in WHEELS
        ]
    return {c.name: c for c in rows}


CHANNELS: dict[str, Channel] = _table()
"""Every canonical channel by name."""


def channel(name: str) -> Channel:
    """The canonical channel called ``name``.

    Raises:
        InputError: there is none; names the closest that exist.
    """
    found = CHANNELS.get(name)
    if found is None:
        raise InputError(f"'{name}' is not a canonical channel", mend=did_you_mean(name, CHANNELS))
    return found


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A hint naming the closest known names, or all of them where none is close and they are few."""
    names = list(known)
    close = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
    if close:
        return "did you mean " + " or ".join(f"'{c}'" for c in close) + "?"
    if len(names) <= 12:
        return "known: " + ", ".join(sorted(names))
    return "see the table of names in the documentation"
