"""A vehicle whose figures are off on purpose: the plant is one, the estimator is told the other."""

from __future__ import annotations

from roadstate.core.errors import InputError
from roadstate.vehicles.parameters import Vehicle

_FURTHEST = 80.0


def mismatched(
    vehicle: Vehicle,
    *,
    mass: float = 0.0,
    yaw_inertia: float = 0.0,
    cg_forward: float = 0.0,
    cg_height: float = 0.0,
    cornering_stiffness: float = 0.0,
    slip_stiffness: float = 0.0,
    radius: float = 0.0,
) -> Vehicle:
    """The vehicle with figures changed by percentages of themselves.

    Build the plant from the result and the estimator from the original: the estimator then errs by these.

    Args:
        vehicle: the original.
        mass, yaw_inertia, cg_height, radius: per cent.
        cg_forward: shift of the centre of gravity towards the front, per cent of the wheelbase.
        cornering_stiffness: of both axles, per cent.
        slip_stiffness: per cent.

    Raises:
        InputError: more than 80 % off, or a centre of gravity beyond an axle.
    """
    given = {
        "mass": mass,
        "yaw_inertia": yaw_inertia,
        "cg_forward": cg_forward,
        "cg_height": cg_height,
        "cornering_stiffness": cornering_stiffness,
        "slip_stiffness": slip_stiffness,
        "radius": radius,
    }
    for name, percent in given.items():
        if not abs(percent) <= _FURTHEST:
            raise InputError(f"{percent:g} % is too far off", where=name, mend="choose −80 to 80 %")
    geometry, wheelbase = vehicle.geometry, vehicle.wheelbase
    shift = cg_forward / 100 * wheelbase
    front = geometry.cg_to_front_axle - shift
    if not 0.1 <= front <= wheelbase - 0.1:
        raise InputError(
            "the centre of gravity leaves the wheelbase", where="cg_forward", mend="choose a smaller shift"
        )
    tires = vehicle.tires
    return vehicle.model_copy(
        update={
            "mass": vehicle.mass * (1 + mass / 100),
            "yaw_inertia": vehicle.yaw_inertia * (1 + yaw_inertia / 100),
            "geometry": geometry.model_copy(
                update={
                    "cg_to_front_axle": front,
                    "cg_to_rear_axle": geometry.cg_to_rear_axle + shift,
                    "cg_height": geometry.cg_height * (1 + cg_height / 100),
                }
            ),
            "wheels": vehicle.wheels.model_copy(
                update={"radius": vehicle.wheels.radius * (1 + radius / 100)}
            ),
            "tires": tires.model_copy(
                update={
                    "cornering_stiffness_front": tires.cornering_stiffness_front
                    * (1 + cornering_stiffness / 100),
                    "cornering_stiffness_rear": tires.cornering_stiffness_rear
                    * (1 + cornering_stiffness / 100),
                    "slip_stiffness": tires.slip_stiffness * (1 + slip_stiffness / 100),
                }
            ),
        }
    )
