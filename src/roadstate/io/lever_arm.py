"""From where an accelerometer sits to the car's centre of gravity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from roadstate.core import InputError, Signal
from roadstate.core.channels import RATES, SPECIFIC_FORCES
from roadstate.core.quantity import Quantity
from roadstate.core.signals import interpolate
from roadstate.io.mapping_channel import Section

Array = NDArray[np.float64]

_HALF = 0.05  # s: an angular acceleration is that between two means over so long, or over two samples

_Distance = Annotated[float, Quantity("m", -30.0, 30.0)]


class LeverArm(Section):
    """Where the accelerometer sits: from the centre of gravity, in the car's axes.

    Attributes:
        forward: m, or with a unit.
        left: m, or with a unit.
        up: m, or with a unit.
    """

    forward: _Distance = 0.0
    left: _Distance = 0.0
    up: _Distance = 0.0

    @model_validator(mode="after")
    def _somewhere(self) -> LeverArm:
        if not (self.forward or self.left or self.up):
            raise InputError("is nowhere but at the centre of gravity", mend="give forward, left or up")
        return self


def to_center(signals: Mapping[str, Signal], arm: LeverArm) -> dict[str, Signal]:
    """What the accelerometer would read at the centre of gravity.

    A rigid body's points move as a_P = a + ω̇ × ρ + ω × (ω × ρ), with ρ from the centre of gravity to P. ω is
    taken from the rates that are there, each as it is at the accelerometer's own instants, and ω̇ from their
    means just before and after; where a rate is not known, its part is left as it was.

    Args:
        signals: the channels of the car, in SI units.
        arm: ρ.

    Returns:
        Those of :data:`~roadstate.core.channels.SPECIFIC_FORCES` that are there, moved.

    Raises:
        InputError: there is no ``yaw_rate`` to go by.
    """
    moved = {name: signals[name] for name in SPECIFIC_FORCES if name in signals}
    if moved and "yaw_rate" not in signals:
        raise InputError(
            "how the car turns is not known: there is no yaw_rate",
            where="lever_arm",
            mend="list the yaw rate, or leave lever_arm out",
        )
    rho = np.array([arm.forward, arm.left, arm.up])
    felt: dict[int, Array] = {}
    for row, name in enumerate(SPECIFIC_FORCES):
        if name in moved:
            signal = moved[name]
            if id(signal.time) not in felt:  # the axes of one sensor share their time
                felt[id(signal.time)] = _felt(signals, rho, signal.time)
            moved[name] = replace(signal, values=signal.values - felt[id(signal.time)][:, row])
    return moved


def _felt(signals: Mapping[str, Signal], rho: Array, time: Array) -> Array:
    """(T, 3) ω̇ × ρ + ω × (ω × ρ) at each time."""
    rate, rise = np.zeros((2, len(time), 3))
    for axis, name in enumerate(RATES):
        if name in signals:
            rate[:, axis] = np.nan_to_num(interpolate(signals[name], time))
            rise[:, axis] = np.nan_to_num(_derivative(signals[name], time))
    return np.cross(rise, rho) + np.cross(rate, np.cross(rate, rho))


def _derivative(signal: Signal, time: Array) -> Array:
    """Per second, at other times; NaN where the samples are too far apart, or too few."""
    good = np.isfinite(signal.values)
    t, v = signal.time[good], signal.values[good]
    if len(t) < 2:
        return np.full(len(time), np.nan)
    step = np.diff(t)
    half = max(_HALF, 2.0 * float(np.median(step)))
    total = replace(signal, time=t, values=np.append(0.0, np.cumsum(step * (v[1:] + v[:-1]) / 2)))
    # at the ends, that of the nearest place which has a whole window
    centre = np.clip(time, t[0] + half, max(t[-1] - half, t[0] + half))
    before, here, after = (interpolate(total, centre + side * half) for side in (-1, 0, 1))
    rise: Array = (after - 2 * here + before) / half**2
    return rise
