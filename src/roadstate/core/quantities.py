"""What estimators give: one table of quantities, and how each is found in a log's references."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roadstate.core.channels import WHEELS, Channel

Array = NDArray[np.float64]

_GROUPS: dict[str, tuple[str, tuple[str, ...]]] = {
    "front": ("front axle", ("fl", "fr")),
    "rear": ("rear axle", ("rl", "rr")),
    "left": ("left side", ("fl", "rl")),
    "right": ("right side", ("fr", "rr")),
    "fl": ("front left", ("fl",)),
    "fr": ("front right", ("fr",)),
    "rl": ("rear left", ("rl",)),
    "rr": ("rear right", ("rr",)),
}
_AXLES_AND_WHEELS = ("front", "rear", *WHEELS)
BOUNDS = ("_lower", "_upper")
"""Endings of the 5 % and the 95 % bound of a quantity; a bound has no standard deviation of its own."""


@dataclass(frozen=True)
class Reference:
    """How a quantity's truth is made of reference channels.

    Attributes:
        channels: all must be there.
        combine: the channels' values, each (T,), in their order → (T,).
    """

    channels: tuple[str, ...]
    combine: Callable[..., Array]


def _first(value: Array) -> Array:
    return value


def _mean(*values: Array) -> Array:
    return np.asarray(np.mean(values, axis=0))


def _sum(*values: Array) -> Array:
    return np.asarray(np.sum(values, axis=0))


def _used(*values: Array) -> Array:
    along, across, load = np.asarray(values).reshape(3, 4, -1).sum(axis=1)
    # a car that flies uses nothing
    return np.asarray(np.hypot(along, across) / np.maximum(load, 1.0))


def _per_wheel(*stems: str, wheels: tuple[str, ...] = WHEELS) -> tuple[str, ...]:
    return tuple(f"{stem}_{w}" for stem in stems for w in wheels)


def _tables() -> tuple[dict[str, Channel], dict[str, Reference]]:
    rows: list[Channel] = []
    references: dict[str, Reference] = {}

    def add(row: Channel, reference: Reference | None = None) -> None:
        rows.append(row)
        if reference is not None:
            references[row.name] = reference

    def plain(name: str) -> Reference:
        return Reference((name,), _first)

    add(Channel("grade", "rad", "road grade angle", "uphill"), plain("ref_grade"))
    add(Channel("bank", "rad", "road bank angle", "left side higher"), plain("ref_bank"))
    whole = Reference(_per_wheel("ref_friction"), _mean)
    _add_friction(add, "friction_peak", "peak tire-road friction coefficient", whole)
    for group, (text, wheels) in _GROUPS.items():
        reference = Reference(_per_wheel("ref_friction", wheels=wheels), _mean)
        _add_friction(add, f"friction_peak_{group}", f"peak friction coefficient, {text}", reference)
    add(
        Channel("friction_used", "-", "friction used by the car: force in the road plane over load"),
        Reference(_per_wheel("ref_force_x", "ref_force_y", "ref_load"), _used),
    )
    for axis, sign, text in (("x", "forward", "longitudinal"), ("y", "to the left", "lateral")):
        for group in _AXLES_AND_WHEELS:
            where, wheels = _GROUPS[group]
            what = (
                f"{text} tire force in the wheel's frame"
                if len(wheels) == 1
                else f"sum of {text} tire forces"
            )
            add(
                Channel(f"force_{axis}_{group}", "N", f"{what}, {where}", sign),
                Reference(_per_wheel(f"ref_force_{axis}", wheels=wheels), _sum),
            )
    for wheel in WHEELS:
        add(
            Channel(f"load_{wheel}", "N", f"vertical load, {_GROUPS[wheel][0]}", "magnitude, never negative"),
            Reference((f"ref_load_{wheel}",), _first),
        )
    add(
        Channel("speed", "m/s", "velocity of the centre of gravity along x", "forward"),
        plain("ref_velocity_x"),
    )
    add(
        Channel("velocity_y", "m/s", "velocity of the centre of gravity along y", "to the left"),
        plain("ref_velocity_y"),
    )
    add(Channel("yaw_rate", "rad/s", "rotation rate about z", "to the left"))
    add(Channel("altitude", "m", "height of the car", "up"))
    add(Channel("mass", "kg", "mass of the car with its load"))
    add(Channel("accel_x_bias", "m/s^2", "bias of the longitudinal accelerometer", "reads too high"))
    return {row.name: row for row in rows}, references


def _add_friction(
    add: Callable[[Channel, Reference | None], None], name: str, text: str, reference: Reference
) -> None:
    add(Channel(name, "-", text), reference)
    add(Channel(f"{name}_lower", "-", f"5 % bound: {text}"), None)
    add(Channel(f"{name}_upper", "-", f"95 % bound: {text}"), None)


QUANTITIES, REFERENCES = _tables()
"""Every quantity an estimator can give, with unit and sign; and the truth of those that have one in a log."""


def is_bound(quantity: str) -> bool:
    """Whether the quantity is a bound of another one, and so has no standard deviation."""
    return quantity.endswith(BOUNDS)


def reference(quantity: str, channels: Mapping[str, Array]) -> Array | None:
    """The truth of a quantity, (T,) in its SI unit, NaN where a channel is; ``None`` where it cannot be had.

    Args:
        quantity: its name.
        channels: a log's channels by name, (T,) each.
    """
    how = REFERENCES.get(quantity)
    if how is None or not all(name in channels for name in how.channels):
        return None
    return how.combine(*(np.asarray(channels[name], np.float64) for name in how.channels))
