"""The plant's tire: a property file scaled to the vehicle's loads, radius and stiffnesses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from roadstate.core.constants import GRAVITY
from roadstate.sim.plant.figures import TireFigures, usual_figures
from roadstate.tires.base import as_leaf
from roadstate.tires.magic_formula import MagicFormula
from roadstate.tires.mf_build import PASSENGER, load_tir
from roadstate.vehicles.parameters import Vehicle

TRUCK = Path(__file__).parent / "truck.tir"
"""A truck tire in plain figures, to be scaled."""

# longitudinal relaxation length over the lateral one: carcasses are stiffer along the wheel than across it
_STIFFER = 0.5
# lateral relaxation length over the radius of a tire nobody knows more of, and the shortest one told, m
_RELAXED, _SHORTEST = 1.3, 0.01
# m/s at which rolling resistance is matched
_ROLLING = 15.0


def corner_loads(vehicle: Vehicle) -> np.ndarray:
    """(4,) static loads of the wheels, N."""
    front, rear = vehicle.static_axle_loads
    return 0.5 * np.array([front, front, rear, rear])


def tires_per_corner(vehicle: Vehicle) -> np.ndarray:
    """(4,) how many tires a wheel position has."""
    return np.array([1, 1, 2, 2]) if vehicle.wheels.dual_rear else np.ones(4, int)


def plant_tire(
    vehicle: Vehicle,
    tir: str | Path | None = None,
    *,
    figures: TireFigures | None = None,
    stiffness_follows_friction: bool = False,
) -> MagicFormula:
    """The Magic Formula tire of a vehicle's plant, one for all its wheels and its own mirror image.

    Without a property file it is the package's passenger or truck tire, scaled by similarity: nominal load
    to the vehicle's mean static load per tire over the figures' ``loaded``, radius to the file's. Then the
    stiffnesses at the rear axle's static load become those of the vehicle file (what suspension and steering
    add is :func:`roadstate.sim.plant.handling.matched`'s to see to), the lateral relaxation length the
    file's and the longitudinal one half of it, the rolling resistance at 15 m/s the file's. A property file
    of the user's is taken as measured, but for the shifts that tell left from right. Without relaxation
    lengths in it they are its slip stiffness over its carcass stiffness: the file's where it has one, else
    such that at the mean static load the lateral length is the plant or vehicle file's if either gives one,
    else 1.3 radii, and the longitudinal one half of it. On any friction the force stays within the tire's
    pure peaks.

    Args:
        vehicle: whose tires.
        tir: a property file, or ``None``.
        figures: which tire, how loaded, and its lateral relaxation length at the mean static load; those
            usual for the vehicle by default.
        stiffness_follows_friction: slip stiffness grows in proportion to friction, as the papers assume.

    Raises:
        InputError: as :func:`roadstate.tires.load_tir`.
    """
    figures = usual_figures(vehicle).tires if figures is None else figures
    own = TRUCK if figures.like == "truck" else PASSENGER
    tire = load_tir(
        own if tir is None else tir,
        symmetric=True,
        stiffness_follows_friction=stiffness_follows_friction,
        bounded=True,
    )
    load = vehicle.mass * GRAVITY / float(np.sum(tires_per_corner(vehicle)))
    if tir is not None:
        return tire if tire.relaxation != "none" else _with_carcass(tire, vehicle, figures, load)
    c = {name: float(value) for name, value in tire.coefficients.items()}
    c["FNOMIN"] = load / figures.loaded
    c["UNLOADED_RADIUS"] = vehicle.wheels.radius * 1.02
    tire = _with(tire, c)
    rear = 0.5 * vehicle.static_axle_loads[1] / (2.0 if vehicle.wheels.dual_rear else 1.0)
    along, across = (float(a) for a in tire.stiffnesses(rear))
    c["LKX"] *= vehicle.tires.slip_stiffness * rear / along
    c["LKY"] *= vehicle.tires.cornering_stiffness_rear * rear / across
    length = figures.relaxation_length
    length = vehicle.tires.relaxation_length if length is None else length
    lengths = tire.relaxation_lengths(load)
    c["LSGAL"] *= length / float(lengths.lateral)
    c["LSGKP"] *= _STIFFER * length / float(lengths.longitudinal)
    rolling = vehicle.rolling_resistance
    wanted = (rolling.coefficient + rolling.speed_coefficient * _ROLLING**2) * vehicle.wheels.radius
    c["LMY"] *= wanted / -float(tire.moments(0.0, 0.0, load, 1.0, _ROLLING).M_y) * load
    return _with(tire, c)


def _with_carcass(tire: MagicFormula, vehicle: Vehicle, figures: TireFigures, load: float) -> MagicFormula:
    c = {name: float(value) for name, value in tire.coefficients.items()}
    length = figures.relaxation_length
    if length is None and "relaxation_length" in vehicle.tires.model_fields_set:
        length = vehicle.tires.relaxation_length
    length = _RELAXED * c["UNLOADED_RADIUS"] if length is None else max(length, _SHORTEST)
    along, across = (float(a) for a in tire.stiffnesses(load))
    for key, stiffness in (
        ("LONGITUDINAL_STIFFNESS", along / (_STIFFER * length)),
        ("LATERAL_STIFFNESS", across / length),
    ):
        c[key] = c[key] if c[key] > 0 else stiffness
    return replace(_with(tire, c), relaxation="carcass")


def _with(tire: MagicFormula, coefficients: dict[str, float]) -> MagicFormula:
    return replace(tire, coefficients={name: as_leaf(value) for name, value in coefficients.items()})
