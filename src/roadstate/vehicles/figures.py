"""From the vehicle file to the models' parameters."""

from __future__ import annotations

from typing import Any

import numpy as np

from roadstate.core.errors import InputError
from roadstate.tires import NormalizedDugoff, TireModel, all_tires
from roadstate.tires.base import ElasticTire, as_leaf
from roadstate.vehicles.parameters import Vehicle

_SPLIT = {"front": (0.5, 0.5, 0.0, 0.0), "rear": (0.0, 0.0, 0.5, 0.5), "all": (0.25, 0.25, 0.25, 0.25)}


def figures(vehicle: Vehicle) -> dict[str, Any]:
    """Every figure a model may ask for, by the name of the model's field, in SI; (4,) where per wheel."""
    geometry, rolling = vehicle.geometry, vehicle.rolling_resistance
    wheels_at_corner = np.array([1, 1, 2, 2] if vehicle.wheels.dual_rear else [1, 1, 1, 1])
    return {
        "mass": vehicle.mass,
        "yaw_inertia": vehicle.yaw_inertia,
        "cg_to_front_axle": geometry.cg_to_front_axle,
        "cg_to_rear_axle": geometry.cg_to_rear_axle,
        "cg_height": geometry.cg_height,
        "track_front": geometry.track_front,
        "track_rear": geometry.track_rear,
        "front_roll_share": geometry.cg_to_rear_axle / geometry.wheelbase,
        "drag_area": vehicle.drag_area,
        "air_density": vehicle.aerodynamics.air_density,
        "grade": 0.0,
        "bank": 0.0,
        "rolling_resistance": rolling.coefficient,
        "rolling_resistance_speed": rolling.speed_coefficient,
        "wheel_radius": np.full(4, vehicle.wheels.radius),
        "wheel_inertia": vehicle.wheels.inertia * wheels_at_corner,
        "drive_split": np.array(_SPLIT[vehicle.driveline.driven]),
        "friction": np.full(4, vehicle.tires.friction),
    }


def tire_of(vehicle: Vehicle) -> TireModel:
    """The tire that the file names, its figures per wheel where front and rear differ.

    The file's stiffnesses are per load, so the models' grow in proportion to load. Those of the normalised
    Dugoff, which grow with friction too, are met at the file's friction.

    Raises:
        InputError: a tire model whose figures the file does not hold.
    """
    tires = vehicle.tires
    front, rear = vehicle.static_axle_loads
    loads = as_leaf(0.5 * np.array([front, front, rear, rear]))
    along = as_leaf(tires.slip_stiffness)
    across = as_leaf(np.repeat([tires.cornering_stiffness_front, tires.cornering_stiffness_rear], 2))
    kind = all_tires()[tires.model]
    if issubclass(kind, ElasticTire):
        return kind(
            slip_stiffness=along * loads,
            cornering_stiffness=across * loads,
            nominal_load=loads,
            slip_load_exponent=as_leaf(1.0),
            cornering_load_exponent=as_leaf(1.0),
        )
    if issubclass(kind, NormalizedDugoff):
        friction = tires.friction
        return kind(slip_stiffness=along / friction, cornering_stiffness=across / friction)
    raise InputError(
        f"the vehicle file has no figures for the tire model '{tires.model}'",
        where=f"{vehicle.name}: tires.model",
        mend="give the tire itself: from_vehicle(vehicle, tire=...)",
    )
