"""What a car is: its parameters, from a vehicle file or the presets, and the models of how it moves.

The names below are loaded when first used, so that importing this package costs nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from roadstate.lazy import lazily

if TYPE_CHECKING:
    from roadstate.vehicles.catalogue import vehicle_models
    from roadstate.vehicles.integrate import RK4, Euler, Integrator, LinearlyImplicit, SubSteps
    from roadstate.vehicles.kinematics import wheel_positions, wheel_slips, wheel_steer, wheel_velocities
    from roadstate.vehicles.library import (
        VehicleSummary,
        json_schema,
        load_vehicle,
        parse_vehicle,
        presets,
        vehicle_text,
    )
    from roadstate.vehicles.loads import gravity_part, vertical_loads
    from roadstate.vehicles.model import VehicleModel
    from roadstate.vehicles.parameters import Vehicle
    from roadstate.vehicles.seven_dof import SevenDof
    from roadstate.vehicles.seven_dof_forces import SevenDofForces
    from roadstate.vehicles.single_track import SingleTrack
    from roadstate.vehicles.three_dof import ThreeDof
    from roadstate.vehicles.three_dof_contact import ThreeDofContact
    from roadstate.vehicles.three_dof_forces import ThreeDofForces
    from roadstate.vehicles.three_dof_normalized import ThreeDofNormalized
    from roadstate.vehicles.wheels import split_torque

_HOME = {
    "Euler": "integrate",
    "Integrator": "integrate",
    "RK4": "integrate",
    "LinearlyImplicit": "integrate",
    "SevenDof": "seven_dof",
    "SevenDofForces": "seven_dof_forces",
    "SingleTrack": "single_track",
    "SubSteps": "integrate",
    "ThreeDof": "three_dof",
    "ThreeDofContact": "three_dof_contact",
    "ThreeDofForces": "three_dof_forces",
    "ThreeDofNormalized": "three_dof_normalized",
    "Vehicle": "parameters",
    "VehicleModel": "model",
    "VehicleSummary": "library",
    "gravity_part": "loads",
    "json_schema": "library",
    "load_vehicle": "library",
    "parse_vehicle": "library",
    "presets": "library",
    "split_torque": "wheels",
    "vehicle_models": "catalogue",
    "vehicle_text": "library",
    "vertical_loads": "loads",
    "wheel_positions": "kinematics",
    "wheel_slips": "kinematics",
    "wheel_steer": "kinematics",
    "wheel_velocities": "kinematics",
}

__all__ = [
    "RK4",
    "Euler",
    "Integrator",
    "LinearlyImplicit",
    "SevenDof",
    "SevenDofForces",
    "SingleTrack",
    "SubSteps",
    "ThreeDof",
    "ThreeDofContact",
    "ThreeDofForces",
    "ThreeDofNormalized",
    "Vehicle",
    "VehicleModel",
    "VehicleSummary",
    "gravity_part",
    "json_schema",
    "load_vehicle",
    "parse_vehicle",
    "presets",
    "split_torque",
    "vehicle_models",
    "vehicle_text",
    "vertical_loads",
    "wheel_positions",
    "wheel_slips",
    "wheel_steer",
    "wheel_velocities",
]

__getattr__ = lazily(__name__, _HOME)


def __dir__() -> list[str]:
    return sorted(__all__)
