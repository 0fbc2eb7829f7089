"""The plant's tire: a property file scaled to the vehicle's loads, radius and stiffnesses."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from roadstate.core.errors import InputError
from roadstate.tires.base import as_leaf
from roadstate.tires.magic_formula import MagicFormula
from roadstate.tires.mf_build import PASSENGER, load_tir
from roadstate.vehicles.parameters import GRAVITY, Vehicle

# load of the passenger tire's car, over its nominal load, that a vehicle's mean static load is taken for
_LOADED = 0.9
# longitudinal relaxation length over the lateral one: carcasses are stiffer along the wheel than across it
_STIFFER = 0.5
# m/s at which rolling resistance is matched
_ROLLING = 15.0
_SMALL = 1e-4


def corner_loads(vehicle: Vehicle) -> np.ndarray:
    """(4,) static loads of the wheels, N."""
    front, rear = vehicle.static_axle_loads
    return 0.5 * np.array([front, front, rear, rear])


def tires_per_corner(vehicle: Vehicle) -> np.ndarray:
    """(4,) how many tires a wheel position has."""
    return np.array([1.0, 1.0, 2.0, 2.0]) if vehicle.wheels.dual_rear else np.ones(4)


def plant_tire(
    vehicle: Vehicle,
    tir: str | Path | None = None,
    *,
    relaxation_length: float | None = None,
    stiffness_follows_friction: bool = False,
) -> MagicFormula:
    """The Magic Formula tire of a vehicle's plant, one for all its wheels and its own mirror image.

    Without a property file it is the package's passenger tire, scaled by similarity: nominal load to the
    vehicle's mean static load per tire over 0.9, radius to the file's. Then the stiffnesses at the rear
    axle's static load become those of the vehicle file (the softer front is the steering's doing), the
    lateral relaxation length the file's and the
    longitudinal one half of it, the rolling resistance at 15 m/s the file's. A property file of the user's is
    taken as measured, but for the shifts that tell left from right.

    Args:
        vehicle: whose tires.
        tir: a property file, or ``None``.
        relaxation_length: lateral, at the mean static load, instead of the vehicle file's, m.
        stiffness_follows_friction: slip stiffness grows in proportion to friction, as the papers assume.

    Raises:
        InputError: as :func:`roadstate.tires.load_tir`; a property file without relaxation lengths.
    """
    tire = load_tir(
        PASSENGER if tir is None else tir,
        symmetric=True,
        stiffness_follows_friction=stiffness_follows_friction,
    )
    load = vehicle.mass * GRAVITY / float(np.sum(tires_per_corner(vehicle)))
    if tire.relaxation == "none":
        raise InputError(
            "no relaxation lengths in the tire property file",
            where=str(tir),
            mend="give PTX1 … PTY2, or LONGITUDINAL_STIFFNESS and LATERAL_STIFFNESS",
        )
    if tir is not None:
        return tire
    c = {name: float(value) for name, value in tire.coefficients.items()}
    c["FNOMIN"] = load / _LOADED
    c["UNLOADED_RADIUS"] = vehicle.wheels.radius * 1.02
    tire = _with(tire, c)
    rear = 0.5 * vehicle.static_axle_loads[1] / (2.0 if vehicle.wheels.dual_rear else 1.0)
    along, across = (float(a) for a in tire.stiffnesses(rear))
    c["LKX"] *= vehicle.tires.slip_stiffness * rear / along
    c["LKY"] *= vehicle.tires.cornering_stiffness_rear * rear / across
    length = vehicle.tires.relaxation_length if relaxation_length is None else relaxation_length
    lengths = tire.relaxation_lengths(load)
    c["LSGAL"] *= length / float(lengths.lateral)
    c["LSGKP"] *= _STIFFER * length / float(lengths.longitudinal)
    rolling = vehicle.rolling_resistance
    wanted = (rolling.coefficient + rolling.speed_coefficient * _ROLLING**2) * vehicle.wheels.radius
    c["LMY"] *= wanted / -float(tire.moments(0.0, 0.0, load, 1.0, _ROLLING).M_y) * load
    return _with(tire, c)


def pneumatic_trail(tire: MagicFormula, load: float) -> float:
    """Arm of the lateral force behind the contact's centre at small slip angles, m."""
    F_y = float(tire.forces(0.0, _SMALL, load, 1.0, 20.0).F_y)
    return -float(tire.moments(0.0, _SMALL, load, 1.0, 20.0).M_z) / F_y


def _with(tire: MagicFormula, coefficients: dict[str, float]) -> MagicFormula:
    return MagicFormula(
        coefficients={name: as_leaf(value) for name, value in coefficients.items()},
        reference_x=tire.reference_x,
        reference_y=tire.reference_y,
        form=tire.form,
        combination=tire.combination,
        relaxation=tire.relaxation,
        mirrored=tire.mirrored,
        stiffness_follows_friction=tire.stiffness_follows_friction,
    )
