"""The speed against the wheels' speeds: what a wrong unit of either looks like."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from roadstate.core import WHEELS, InputError, Signal
from roadstate.core.signals import interpolate
from roadstate.core.units import convert, is_same_dimension

_LIKE = 1.15  # as a factor; what tires, load and a radius that is off make of equal speeds
_SURE = 1.8  # as a factor; less could be the radius of another vehicle
_LEAST = 1.0  # m/s of either speed; slower wheels are not measured well
_FEWEST = 50  # moving samples of a wheel
_SPEED_UNITS = ("km/h", "mph", "m/s")
_WHEEL_UNITS = ("m/s", "km/h", "rpm", "rad/s")


def check_speed_unit(signals: Mapping[str, Signal], units: Mapping[str, str], wheel_radius: float) -> None:
    """Refuse a speed that differs from every wheel's by the factor of a wrong unit.

    Locked and spinning wheels hold no such factor for long, least of all every wheel: of each that has moved,
    both quartiles of the ratio must lie within 15 % of it.

    Args:
        signals: canonical channels in SI.
        units: the unit that a channel's raw values were taken to be in; SI where it is not listed.
        wheel_radius: effective rolling radius in m.

    Raises:
        InputError: says what the ratio is, and which units would explain it.
    """
    wheels = [name for name in (f"wheel_speed_{w}" for w in WHEELS) if name in signals]
    if "speed" not in signals or not wheels or not 0.05 <= wheel_radius <= 2.0:
        return
    speed = signals["speed"]
    ratios = np.concatenate([_quartiles(speed, signals[wheel], wheel_radius) for wheel in wheels])
    # no factor that is surely one brings such a ratio to what is like 1; nor need units be read then
    if not len(ratios) or (np.abs(np.log(ratios)) < np.log(_SURE / _LIKE)).any():
        return

    def explains(factor: float) -> bool:
        off = np.abs(np.log(ratios * factor))
        return abs(np.log(factor)) > np.log(_SURE) and bool((off < np.log(_LIKE)).all())

    def in_si(unit: str) -> float:
        is_linear = is_same_dimension(unit, "m/s")
        return float(convert(1.0, unit, "m/s") if is_linear else convert(wheel_radius, unit, "rad/s"))

    taken, turned = in_si(units.get("speed", "m/s")), in_si(units.get(wheels[0], "rad/s"))
    likely = [("speed", u) for u in _SPEED_UNITS if explains(in_si(u) / taken)]
    likely += [(wheels[0], u) for u in _WHEEL_UNITS if explains(turned / in_si(u))]
    if not likely:
        return
    unit = f"'unit: {likely[0][1]}'" if len(likely) == 1 else "that 'unit:'"
    raise InputError(
        f"is {float(np.median(ratios)):.3g} times that of the wheels (of radius {wheel_radius:g} m)",
        where=f"{speed.source} as speed" if speed.source else "speed",
        mend=f"is {' or '.join(f'{name} in {u}' for name, u in likely)}? Set {unit} in the mapping",
    )


def _quartiles(speed: Signal, wheel: Signal, radius: float) -> NDArray[np.float64]:
    """Of speed over wheel speed, while both move; none where that is too rare to tell."""
    is_same = speed.time is wheel.time or np.array_equal(speed.time, wheel.time)
    over_ground = np.abs(speed.values if is_same else interpolate(speed, wheel.time))
    turned = np.abs(wheel.values) * radius
    moves = np.isfinite(over_ground) & np.isfinite(turned) & (over_ground > _LEAST) & (turned > _LEAST)
    if moves.sum() < _FEWEST:
        return np.empty(0)
    return np.quantile(over_ground[moves] / turned[moves], (0.25, 0.75))
