"""What may be a slow state: a parameter, a factor on one, an input, a sensor's bias."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Literal, NamedTuple

import jax.numpy as jnp

from roadstate.assembly.rows import Family, grouped, refuse_twice
from roadstate.core.channels import did_you_mean
from roadstate.core.errors import InputError
from roadstate.vehicles.model import VehicleModel, per_wheel

BIAS, SCALE = "bias.", "scale."
_WHERE = "parameters"


class Slow(NamedTuple):
    """A quantity that the vehicle's equations do not move.

    Attributes:
        kind: what it is.
        target: the parameter, input or sensor that it stands for; of four wheels' inputs, their common name.
        family: its rows.
    """

    kind: Literal["parameter", "scale", "input", "bias"]
    target: str
    family: Family

    @property
    def targets(self) -> tuple[str, ...]:
        """The inputs or sensors meant, in the order of the wheels where there are four."""
        return per_wheel(self.target) if self.family.of_wheel else (self.target,)


def slow_states(
    names: Sequence[str], vehicle: VehicleModel, sensors: Collection[str], groupings: Mapping[str, str]
) -> list[Slow]:
    """What each name stands for.

    Args:
        names: as the caller wrote them.
        vehicle: whose parameters and inputs may be meant.
        sensors: the rows of z.
        groupings: name → grouping.

    Raises:
        InputError: an unknown name; a grouping for what has no four wheels, or for what is not chosen.
    """
    for name in groupings:
        if name not in names:
            raise InputError(
                f"'{name}' is not among the parameters chosen",
                where="groupings",
                mend="choose it, or drop this",
            )
    found = [_slow(name, vehicle, sensors, groupings.get(name)) for name in names]
    targets = [(s.kind in ("parameter", "scale"), s.target) for s in found if s.kind != "bias"]
    for i, target in enumerate(targets):
        if target in targets[:i]:
            raise InputError(
                f"'{target[1]}' is chosen twice", where=_WHERE, mend="choose it, or a factor on it, once"
            )
    inputs = [row for s in found if s.kind == "input" for row in s.targets]
    refuse_twice(inputs, _WHERE)
    return found


def _slow(name: str, vehicle: VehicleModel, sensors: Collection[str], grouping: str | None) -> Slow:
    leaves = vehicle.parameters
    if name.startswith(BIAS):
        return Slow("bias", name.removeprefix(BIAS), _bias(name, sensors, grouping))
    target = name.removeprefix(SCALE)
    if target in leaves:
        shape = jnp.shape(leaves[target])
        is_factor = target != name
        if shape not in ((), (4,)):
            raise InputError(
                f"has shape {shape}; only a number or four can be a state", where=f"{_WHERE}: {name}"
            )
        # a tire parameter that is one number may become four, since each wheel has its tire
        wheels = shape == (4,) or target.startswith("tire.")
        default = "four" if shape == (4,) and not is_factor else "one"
        family = _of_wheels(name, grouping, default) if wheels else _single(name, grouping)
        return Slow("scale" if is_factor else "parameter", target, family)
    if name in vehicle.inputs:
        return Slow("input", name, _single(name, grouping))
    if all(row in vehicle.inputs for row in per_wheel(name)):
        return Slow("input", name, _of_wheels(name, grouping, "four"))
    known = [*leaves, *vehicle.inputs, *(f"{BIAS}{sensor}" for sensor in sensors)]
    if name.startswith(SCALE):
        known = [f"{SCALE}{leaf}" for leaf in leaves]
    raise InputError(
        f"'{vehicle.name}' has no parameter, input or sensor '{name}'",
        where=_WHERE,
        mend=did_you_mean(name, known),
    )


def _bias(name: str, sensors: Collection[str], grouping: str | None) -> Family:
    sensor = name.removeprefix(BIAS)
    if sensor in sensors:
        return _single(name, grouping)
    if all(row in sensors for row in per_wheel(sensor)):
        return _of_wheels(name, grouping, "four")
    raise InputError(
        f"'{sensor}' is not a sensor chosen", where=f"{_WHERE}: {name}", mend=did_you_mean(sensor, sensors)
    )


def _of_wheels(name: str, grouping: str | None, default: str) -> Family:
    return grouped(name, grouping or default, f"groupings: {name}")


def _single(name: str, grouping: str | None) -> Family:
    if grouping is not None:
        raise InputError(
            "is one number, not one for each wheel", where=f"groupings: {name}", mend="drop the grouping"
        )
    return Family(name, (name,))
