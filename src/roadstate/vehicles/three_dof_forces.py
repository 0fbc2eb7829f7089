"""Planar motion under tire forces that are given."""

from __future__ import annotations

from typing import ClassVar

from jaxtyping import Array, Float

from roadstate.tires.smooth import Numbers
from roadstate.vehicles.kinematics import wheel_steer
from roadstate.vehicles.model import Motion, VehicleModel, per_wheel


class ThreeDofForces(VehicleModel):
    """v_x, v_y, r with the forces of the four contacts (in the wheels' frames) as inputs.

    The force of a contact is all that the road does: rolling resistance is inside it, as it is in what a
    force estimator with wheel dynamics finds.

    Attributes as :class:`roadstate.vehicles.model.VehicleModel`.
    """

    name = "three_dof_forces"
    summary = "planar motion, tire forces as inputs"
    inputs: ClassVar[tuple[str, ...]] = (
        "steer",
        "steer_rear",
        *per_wheel("force_x"),
        *per_wheel("force_y"),
    )

    def _tire_forces(self, u: Numbers) -> tuple[Numbers, Numbers]:
        return u[2:6], u[6:10]

    def motion(self, x: Float[Array, " 3"], u: Float[Array, " k"]) -> Motion:
        """As :meth:`VehicleModel.motion`."""
        F_x, F_y = self._tire_forces(u)
        accel_x, accel_y, yaw_accel = self._body(F_x, F_y, wheel_steer(u[0], u[1]), self.drag(x[0]))
        return Motion(accel_x, accel_y, yaw_accel, F_x, F_y, self.wheel_loads(accel_x, accel_y))
