"""Unit texts as people write them, converted to SI.

``pint`` knows the units; what it misreads or has never seen (``Nm``, ``m/s2``, ``g`` for gravity, ``U/min``,
``-``, ``°/s``) is rewritten first by the table of aliases below.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roadstate.core.errors import InputError

# Looked up in lower case. Frequencies are read as revolutions: no canonical channel is a frequency. German
# loggers write Grad for a degree; a hundredth of a right angle is a gon.
_ALIASES = {
    "": "dimensionless",
    "-": "dimensionless",
    "1": "dimensionless",
    "none": "dimensionless",
    "unitless": "dimensionless",
    "%": "percent",
    "pct": "percent",
    "°": "degree",
    "deg": "degree",
    "degrees": "degree",
    "grad": "degree",
    "grad/s": "degree/second",
    "°/s": "degree/second",
    "dps": "degree/second",
    "deg/sec": "degree/second",
    "°c": "degree_Celsius",
    "degc": "degree_Celsius",
    "g": "standard_gravity",
    "g0": "standard_gravity",
    "mg": "millistandard_gravity",
    "rpm": "revolution/minute",
    "u/min": "revolution/minute",
    "1/min": "revolution/minute",
    "min-1": "revolution/minute",
    "min^-1": "revolution/minute",
    "rev/min": "revolution/minute",
    "rev/s": "revolution/second",
    "hz": "revolution/second",
    "khz": "kilorevolution/second",
    "nm": "newton*meter",
    "n.m": "newton*meter",
    "n-m": "newton*meter",
    "km/h": "kilometer/hour",
    "kmh": "kilometer/hour",
    "kph": "kilometer/hour",
    "km/hr": "kilometer/hour",
    "mps": "meter/second",
    "m/sec": "meter/second",
    "mps2": "meter/second**2",
    "sec": "second",
    "secs": "second",
    "msec": "millisecond",
    "usec": "microsecond",
    "lbs": "pound",
    "t": "metric_ton",
    "kg.m2": "kilogram*meter**2",
    "kgm2": "kilogram*meter**2",
}
_EXPONENT = re.compile(r"(?<=[A-Za-z])(-?[23])(?![0-9A-Za-z])")
_SAFE = re.compile(r"^[A-Za-z_0-9\s*/^.()\-°%µμ]*$")
# pint works powers of plain numbers out: 9^9^9^9, in a stranger's header, would keep it busy for ever
_POWER = re.compile(r"\*\*|\^")
_SMALL_POWER = re.compile(
    r"(?:\*\*|\^)\s*(?:-?[0-9](?:\.[0-9]+)?|\(-?[0-9](?:\.[0-9]+)?\))(?![0-9.]|\s*(?:\*\*|\^))"
)
_POWER_OF_GROUP = re.compile(r"\)\s*(?:\*\*|\^)")
_PER_TIME = "[time]^-1"


@dataclass(frozen=True)
class Unit:
    """A unit as an affine map to SI: ``value_SI = scale * value + offset``.

    Attributes:
        text: the unit as written.
        scale: multiplier to the SI base unit of its dimension.
        offset: added after scaling (temperatures only).
        dimension: what it measures, as a text to compare (angles are dimensionless, as in SI).
        is_ratio: whether it is a bare number (``-``, ``%``, ``m/m``): dimensionless and no angle.
        is_angular: whether it counts angles (``deg/s``, ``rpm``; not ``1/s``).
    """

    text: str
    scale: float
    offset: float
    dimension: str
    is_ratio: bool
    is_angular: bool


@cache
def _registry() -> Any:
    import pint  # imported late: a quarter of a second that a log in SI never needs

    registry: Any = pint.UnitRegistry(autoconvert_offset_to_baseunit=True, cache_folder=None)
    return registry


def _normalise(text: str) -> str:
    text = text.strip().strip("[]").strip()
    lowered = text.lower().replace("²", "2").replace("³", "3")
    if lowered in _ALIASES and not text.startswith("M"):
        return _ALIASES[lowered]
    text = text.replace("²", "**2").replace("³", "**3").replace("·", "*").replace("⋅", "*")
    text = text.replace("Nm", "N*m").replace("°C", "degC").replace("°", "degree")
    return _EXPONENT.sub(r"**\1", text)


@lru_cache(maxsize=512)
def parse_unit(text: str) -> Unit:
    """Read a unit text.

    Args:
        text: such as ``km/h``, ``Nm``, ``m/s2``, ``°/s``, ``bar``, ``-``.

    Raises:
        InputError: the text is no unit that can be read.
    """
    normal = _normalise(text)
    shown = text if len(text) <= 40 else f"{text[:40]}…"
    refusal = InputError(
        f"unknown unit '{shown}'", mend="write it like 'km/h', 'deg/s', 'N*m', 'bar' or '-' (no unit)"
    )
    if len(text) > 40 or not _SAFE.match(normal) or not _has_small_powers(normal):
        raise refusal
    try:
        registry = _registry()
        units = registry.parse_units(normal)
        zero, one, two = (registry.Quantity(x, units).to_base_units() for x in (0.0, 1.0, 2.0))
        offset, scale = float(zero.magnitude), float(one.magnitude - zero.magnitude)
        step = float(two.magnitude - one.magnitude)
    except Exception as error:  # pint raises a dozen kinds for a bad text
        raise refusal from error
    # a decibel is no affine map; a power of a prefix may leave the range of numbers
    if not math.isclose(step, scale, rel_tol=1e-9) or not math.isfinite(scale + offset) or scale == 0:
        raise refusal
    powers = sorted(units.dimensionality.items())
    dimension = " ".join(f"{name}^{float(power):g}" for name, power in powers)
    return Unit(text, scale, offset, dimension, bool(one.unitless), "radian" in str(one.units))


def _has_small_powers(text: str) -> bool:
    every, small = _POWER.findall(text), _SMALL_POWER.findall(text)
    return len(every) == len(small) and len(_POWER_OF_GROUP.findall(text)) <= 1


def is_same_dimension(a: str, b: str) -> bool:
    """Whether two unit texts measure the same thing (angles count as dimensionless)."""
    return parse_unit(a).dimension == parse_unit(b).dimension


def convert(values: NDArray[np.float64] | float, unit: str, to: str) -> NDArray[np.float64]:
    """Convert ``values`` from ``unit`` to ``to``; the array itself comes back where nothing changes.

    Raises:
        InputError: a unit cannot be read, the two measure different things, or ``1/s`` is to be a rotation
            speed, which may count radians or revolutions.
    """
    array = np.asarray(values, dtype=np.float64)
    if unit == to:
        return array
    source, target = parse_unit(unit), parse_unit(to)
    if source.dimension != target.dimension:
        raise InputError(
            f"unit '{unit}' cannot be converted to '{to}'", mend="give the signal's true unit with 'unit:'"
        )
    if target.is_angular and not source.is_angular and target.dimension == _PER_TIME:
        raise InputError(
            f"unit '{unit}' counts no angle: revolutions or radians?",
            mend="give the signal's true unit with 'unit:', which is rev/s (that is Hz), rpm or rad/s",
        )
    scale = source.scale / target.scale
    offset = (source.offset - target.offset) / target.scale
    if scale == 1.0 and offset == 0.0:
        return array
    return array * scale + offset


def to_channel_unit(
    values: NDArray[np.float64], unit: str, channel_unit: str, *, is_slope: bool = False
) -> NDArray[np.float64]:
    """Convert to a channel's SI unit; a slope given as a ratio or in percent becomes its angle.

    Args:
        values: any shape, in ``unit``.
        unit: unit text as written in the log or mapping.
        channel_unit: the canonical unit.
        is_slope: the channel is an angle of the road, for which a bare number's unit (``%``, ``-``) means
            rise over run.

    Raises:
        InputError: as :func:`convert`.
    """
    if is_slope and unit != channel_unit and unit.strip("[] ") and parse_unit(unit).is_ratio:
        return np.arctan(convert(values, unit, "-"))
    return convert(values, unit, channel_unit)
