"""What can be learned of a car: figures of the vehicle file by group, and the noise levels in it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from roadstate.core.channels import did_you_mean
from roadstate.core.errors import InputError
from roadstate.core.quantity import Quantity
from roadstate.vehicles.parameters import Vehicle

Path = tuple[str, ...]
M = TypeVar("M", bound=BaseModel)

GROUPS: Mapping[str, tuple[str, ...]] = {
    "mass": ("mass",),
    "tire": (
        "tires.cornering_stiffness_front",
        "tires.cornering_stiffness_rear",
        "tires.shape",
        "tires.relaxation_length",
    ),
    "slip": ("tires.slip_stiffness",),
    "friction": ("tires.friction",),
    "aero": ("aerodynamics.drag_coefficient",),
    "rolling": ("rolling_resistance.coefficient",),
    "body": ("body",),
    "radius": ("wheels.radius",),
    "geometry": ("geometry.cg_height", "geometry.cg_to_front_axle"),
    "inertia": ("yaw_inertia",),
    "driveline": ("driveline.efficiency",),
    "brakes": ("brakes",),
    "steering": ("steering.ratio",),
}
"""Group → figures of the vehicle file; a section stands for every quantity in it."""

# 1σ of a figure before the drive, or what in the vehicle file says so: a share where the figure's logarithm
# is fitted, else in the figure's unit
_PRIORS: Mapping[str, str | float] = {
    "mass": "prior.mass_relative",
    "yaw_inertia": 0.15,
    "aerodynamics.drag_coefficient": "prior.drag_relative",
    "rolling_resistance.coefficient": "prior.rolling_resistance_std",
    "body.pitch_gradient": "prior.pitch_gradient_std",
    "body.roll_gradient": 0.003,
    "tires.cornering_stiffness_front": "prior.stiffness_relative",
    "tires.cornering_stiffness_rear": "prior.stiffness_relative",
    "tires.slip_stiffness": "prior.stiffness_relative",
    "tires.friction": "prior.friction_relative",
    "tires.shape": "prior.tire_shape_std",
    "wheels.radius": "sensors.wheel_speed.scale",
    "geometry.cg_height": 0.1,
    "geometry.cg_to_front_axle": 0.05,
    "driveline.efficiency": 0.03,
    "steering.ratio": 0.05,
}
_SHARE = 0.2  # of any other figure
_LINEAR = ("body.", "rolling_resistance.coefficient", "geometry.cg_to_front_axle", "tires.shape")
"""Figures that may be zero or negative, or that have their 1σ in their own unit."""

# what varies from sample to sample or along the road; the other deviations say how one car differs from
# another, of which a drive has a single case
_NOISES = ("noise", "noise_density", "relative", "wander", "wander_time")
_ROAD = ("grade_", "bank_")
_NOISE_SHARE = 1.0  # 1σ of the logarithm of a noise level: a factor of e either way
_CERTAINTY = 0.02  # of a prior standard deviation: what is left of it while its figure is learned


@dataclass(frozen=True)
class Parameter:
    """A figure that can be learned.

    It is fitted as ``free``, its change in units of its own prior standard deviation, so that all are alike
    in size and the prior is N(0, 1).

    Attributes:
        path: where it stands in the vehicle file.
        unit: of ``start``; ``-`` where it has none.
        minimum, maximum: the range in which it makes sense.
        start: its value in the file.
        is_log: whether it is its logarithm that moves.
        std: 1σ before the drive, of the logarithm or of the value.
        is_noise: whether it is a noise level.
        prior: where the vehicle file says how exact it is, if it does.
    """

    path: Path
    unit: str
    minimum: float
    maximum: float
    start: float
    is_log: bool
    std: float
    is_noise: bool
    prior: Path | None

    @property
    def name(self) -> str:
        """As the vehicle file's messages write it: ``tires.friction``."""
        return ".".join(self.path)

    def value(self, free: float) -> float:
        """The figure at a change of ``free`` prior standard deviations."""
        if self.is_log:
            return self.start * math.exp(self.std * free)
        return self.start + self.std * free

    def value_std(self, free: float, std: float) -> float:
        """1σ of the figure at ``free``, from the 1σ of the change."""
        return self.std * std * (self.value(free) if self.is_log else 1.0)

    def limits(self) -> tuple[float, float]:
        """The changes at which the figure leaves the range in which it makes sense."""
        if not self.is_log:
            return (self.minimum - self.start) / self.std, (self.maximum - self.start) / self.std
        least = math.log(self.minimum / self.start) / self.std if self.minimum > 0 else -math.inf
        return least, math.log(self.maximum / self.start) / self.std


@dataclass(frozen=True)
class Selection:
    """What was asked for.

    Attributes:
        parameters: to be fitted.
        refused: figure → why it cannot be.
    """

    parameters: tuple[Parameter, ...]
    refused: Mapping[str, str]


def select(vehicle: Vehicle, groups: Sequence[str], *, tune: bool) -> Selection:
    """The parameters that groups name.

    Args:
        vehicle: the car as its file has it.
        groups: names of :data:`GROUPS`.
        tune: the noise levels as well.

    Raises:
        InputError: no such group, or nothing to learn.
    """
    for group in groups:
        if group not in GROUPS:
            mend = did_you_mean(group, sorted(GROUPS))
            raise InputError(f"no group of parameters is called '{group}'", where="--learn", mend=mend)
    if not groups and not tune:
        raise InputError("nothing to learn", mend=f"say --learn with any of {','.join(GROUPS)}, or --tune")
    found: list[Parameter] = []
    refused: dict[str, str] = {}
    for name in dict.fromkeys(n for group in groups for n in GROUPS[group]):
        path = tuple(name.split("."))
        if getattr(vehicle, path[0]) is None:
            refused[path[0]] = f"the vehicle file has no section '{path[0]}'"
            continue
        for at, quantity, value in _quantities(vehicle, path):
            _take(vehicle, at, quantity, value, found, refused)
    if tune:
        for at, quantity, value in _noises(vehicle):
            _take(vehicle, at, quantity, value, found, refused, is_noise=True)
    return Selection(tuple(found), refused)


def _take(
    vehicle: Vehicle,
    path: Path,
    quantity: Quantity,
    value: float,
    found: list[Parameter],
    refused: dict[str, str],
    *,
    is_noise: bool = False,
) -> None:
    name = ".".join(path)
    said = _PRIORS.get(name, _NOISE_SHARE if is_noise else _SHARE)
    prior = tuple(said.split(".")) if isinstance(said, str) else None
    std = number_at(vehicle, prior) if prior is not None else float(said)
    is_log = is_noise or not name.startswith(_LINEAR)
    if std == 0:
        refused[name] = f"'{said}' is 0: the file holds it for exact"
    elif is_log and value <= 0:
        refused[name] = "is 0 in the file"
    else:
        bounds = quantity.minimum, quantity.maximum
        found.append(Parameter(path, quantity.unit, *bounds, value, is_log, std, is_noise, prior))


def _quantities(vehicle: Vehicle, path: Path) -> Iterator[tuple[Path, Quantity, float]]:
    """The quantity at a path, or all of the section there."""
    node = _at(vehicle, path)
    if not isinstance(node, BaseModel):
        parent = _at(vehicle, path[:-1])
        quantity = _quantity(parent, path[-1]) if isinstance(parent, BaseModel) else None
        if quantity is not None:
            yield path, quantity, node
        return
    for name in type(node).model_fields:
        quantity, value = _quantity(node, name), getattr(node, name)
        if quantity is not None and isinstance(value, float):
            yield (*path, name), quantity, value


def _noises(vehicle: Vehicle) -> Iterator[tuple[Path, Quantity, float]]:
    for sensor in type(vehicle.sensors).model_fields:
        for path, quantity, value in _quantities(vehicle, ("sensors", sensor)):
            if path[-1] in _NOISES:
                yield path, quantity, value
    for path, quantity, value in _quantities(vehicle, ("prior",)):
        if path[-1].startswith(_ROAD):
            yield path, quantity, value


def _quantity(section: BaseModel, name: str) -> Quantity | None:
    metadata = type(section).model_fields[name].metadata
    return next((m for m in metadata if isinstance(m, Quantity)), None)


def number_at(vehicle: Vehicle, path: Path) -> float:
    """The figure at a path of the vehicle file."""
    value = _at(vehicle, path)
    assert isinstance(value, float)
    return value


def _at(vehicle: Vehicle, path: Path) -> BaseModel | float:
    node: BaseModel | float = vehicle
    for key in path:
        node = getattr(node, key)
    return node


def with_certainty(vehicle: Vehicle, parameters: Sequence[Parameter], active: NDArray[np.bool_]) -> Vehicle:
    """The vehicle with next to no uncertainty in the figures that are being learned.

    An estimator may carry an error of such a figure as a state of its own, which would take up what the
    figure is to be learned from.
    """
    car = vehicle
    learned = (p for p, is_active in zip(parameters, active, strict=True) if is_active)
    for path in dict.fromkeys(p.prior for p in learned if p.prior is not None):
        car = with_value(car, path, _CERTAINTY * number_at(car, path))
    return car


def moved(vehicle: Vehicle, parameters: Sequence[Parameter], free: NDArray[np.float64]) -> Vehicle:
    """The vehicle with parameters at a change of ``free`` (p,) prior standard deviations.

    The wheelbase stays: where the centre of gravity moves, both of its distances change.
    """
    car = vehicle
    for parameter, change in zip(parameters, free, strict=True):
        car = with_value(car, parameter.path, parameter.value(float(change)))
    return car


def with_value(vehicle: Vehicle, path: Path, value: float) -> Vehicle:
    """The vehicle with another figure at a path; nothing is checked."""
    if path == ("geometry", "cg_to_front_axle"):
        rear = vehicle.wheelbase - value
        geometry = vehicle.geometry.model_copy(update={"cg_to_front_axle": value, "cg_to_rear_axle": rear})
        return vehicle.model_copy(update={"geometry": geometry})
    return _replaced(vehicle, path, value)


def _replaced(node: M, path: Path, value: float) -> M:
    inner = value if len(path) == 1 else _replaced(getattr(node, path[0]), path[1:], value)
    return node.model_copy(update={path[0]: inner})
