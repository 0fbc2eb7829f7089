"""Magnitudes that no road car reaches: what a wrong unit looks like."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadstate.core import CHANNELS, InputError, Signal
from roadstate.core.constants import GRAVITY
from roadstate.core.units import convert, is_same_dimension

_MAX_SHARE = 0.01  # of the samples; fewer are spikes, which estimators take for missing
_TYPICAL_RADIUS = 0.3  # m; good enough to tell km/h from rad/s
_NEAR_GRAVITY = 0.2  # relative; slopes, bias and mounting take less from the vertical accelerometer's median
_FEWEST = 10  # samples of it that say so


@dataclass(frozen=True)
class Limit:
    """The largest plausible magnitude in the channel's SI unit, and the units logs use instead of it."""

    magnitude: float
    units: tuple[str, ...] = ()


_ACCEL = Limit(100.0, ("mg", "cm/s^2"))
_RATE = Limit(10.0, ("deg/s",))
_FORCE = Limit(1e5, ())
LIMITS: dict[str, Limit] = {
    "speed": Limit(120.0, ("km/h", "cm/s", "mm/s")),
    "velocity_y": Limit(40.0, ("km/h",)),
    "wheel_speed": Limit(250.0, ("km/h", "rpm", "deg/s")),
    "steer": Limit(1.5, ("deg",)),
    "steering_wheel": Limit(30.0, ("deg",)),
    "accel_x": _ACCEL,
    "accel_y": _ACCEL,
    "accel_z": _ACCEL,
    "kinematic_accel_x": _ACCEL,
    "kinematic_accel_y": _ACCEL,
    "roll_rate": _RATE,
    "pitch_rate": _RATE,
    "yaw_rate": _RATE,
    "yaw_accel": Limit(100.0, ("deg/s^2",)),
    "engine_torque": Limit(1e4),
    "engine_speed": Limit(2500.0, ("rpm",)),
    "gear_ratio": Limit(50.0),
    "latitude": Limit(90.0),
    "longitude": Limit(360.0),
    "altitude": Limit(1e4, ("cm", "mm")),
    "vertical_speed": Limit(30.0, ("cm/s", "mm/s")),
    "drive_torque": Limit(2e4),
    "brake_torque": Limit(2e4),
    "brake_pressure": Limit(5e7, ("mbar",)),
    "ref_grade": Limit(0.8, ("%", "deg")),
    "ref_bank": Limit(0.8, ("%", "deg")),
    "ref_velocity_x": Limit(120.0, ("km/h",)),
    "ref_velocity_y": Limit(40.0, ("km/h",)),
    "ref_friction": Limit(3.0, ("%",)),
    "ref_force_x": _FORCE,
    "ref_force_y": _FORCE,
    "ref_load": _FORCE,
    "ref_slip": Limit(50.0, ("%",)),
    "ref_slip_angle": Limit(2.0, ("deg",)),
}
"""Limits by channel; a wheel's channels share one under their name without the wheel."""


def limit_of(name: str) -> Limit | None:
    """The limit of a canonical channel; ``None`` where the magnitude says nothing (``brake``)."""
    return LIMITS.get(name) or LIMITS.get(name[:-3])


def check_plausible(name: str, signal: Signal, unit: str) -> None:
    """Refuse a channel of which more than 1 % of the samples are beyond its limit; a reference's, any.

    ``accel_z`` is refused, too, where its median would be gravity in another unit.

    Args:
        name: canonical channel.
        signal: in the channel's SI unit.
        unit: the unit the raw values were taken to be in.

    Raises:
        InputError: says how many, where the first is, and which unit would explain it.
    """
    if name == "accel_z":
        _check_gravity(signal, unit)
    limit = limit_of(name)
    if limit is None:
        return
    with np.errstate(invalid="ignore"):
        beyond = np.abs(signal.values) > limit.magnitude
    count, valid = int(beyond.sum()), int(np.isfinite(signal.values).sum())
    is_few, is_truth = count <= _MAX_SHARE * valid, name.startswith("ref_") and "slip" not in name
    # a single one decides what an error comes to
    if count == 0 or (is_few and not is_truth):
        return
    likely = _likely_unit(name, signal, unit, limit)
    mend = f"is the unit {likely}? Set 'unit: {likely}' in the mapping" if likely else "check unit and scale"
    if is_few:
        mend = "leave them out by 'range: [least, largest]' in the mapping"
    raise InputError(
        f"{count} of {valid} samples exceed {limit.magnitude:g} {CHANNELS[name].unit} "
        f"(first at t={signal.time[int(np.argmax(beyond))]:.2f} s)",
        where=f"{signal.source} as {name}" if signal.source else name,
        mend=mend,
    )


def _check_gravity(signal: Signal, unit: str) -> None:
    good = signal.values[np.isfinite(signal.values)]
    if len(good) < _FEWEST:
        return
    middle = abs(float(np.median(good)))  # not of magnitudes: shaking alone, gravity removed, has none
    if _is_gravity(middle):
        return
    raw = middle / _in_si("accel_z", unit)
    likely = next((u for u in ("g", "m/s^2") if _is_gravity(raw * _in_si("accel_z", u))), None)
    if likely is None:
        return
    raise InputError(
        f"the median is {middle:.3g} m/s^2, where gravity alone makes {GRAVITY:.2f}",
        where=f"{signal.source} as accel_z" if signal.source else "accel_z",
        mend=f"is the unit {likely}? Set 'unit: {likely}' in the mapping, or write 'accel_z [{likely}]' in "
        "the table's header; look at accel_x and accel_y, too",
    )


def _is_gravity(magnitude: float) -> bool:
    return abs(magnitude / GRAVITY - 1.0) <= _NEAR_GRAVITY


def _likely_unit(name: str, signal: Signal, unit: str, limit: Limit) -> str | None:
    """The first of the usual other units in which the raw values would be plausible."""
    raw = float(np.nanpercentile(np.abs(signal.values), 99)) / _in_si(name, unit)
    others = (u for u in limit.units if u != unit)
    return next((u for u in others if raw * _in_si(name, u) <= limit.magnitude), None)


def _in_si(name: str, unit: str) -> float:
    target = CHANNELS[name].unit
    if target == "rad/s" and is_same_dimension(unit, "m/s"):
        return float(convert(1.0, unit, "m/s")) / _TYPICAL_RADIUS
    return float(convert(1.0, unit, target))
