"""Planar motion on four tires of which slip, slip angle and load are given: only friction is open."""

from __future__ import annotations

from typing import ClassVar

from jaxtyping import Array, Float

from roadstate.vehicles.kinematics import Slips, wheel_steer, wheel_velocities
from roadstate.vehicles.model import BODY_OUTPUTS, Motion, per_wheel, soft_sign
from roadstate.vehicles.tire_vehicle import Contacts, TireVehicle


class ThreeDofContact(TireVehicle):
    """v_x, v_y, r on four tires with κ, α and F_z of each as inputs, as the papers' friction filters do.

    Attributes as :class:`roadstate.vehicles.tire_vehicle.TireVehicle`.
    """

    name = "three_dof_contact"
    summary = "planar motion, four tires; slips, slip angles and loads as inputs"
    inputs: ClassVar[tuple[str, ...]] = (
        "steer",
        "steer_rear",
        *per_wheel("slip"),
        *per_wheel("slip_angle"),
        *per_wheel("load"),
    )
    outputs: ClassVar[tuple[str, ...]] = BODY_OUTPUTS

    def motion(self, x: Float[Array, " 3"], u: Float[Array, " k"]) -> Motion:
        """As :meth:`VehicleModel.motion`."""
        steer, load = wheel_steer(u[0], u[1]), u[10:14]
        velocity = wheel_velocities(x[0], x[1], x[2], self.wheel_positions, steer)
        F_x, F_y = self._forces(Contacts(steer, velocity, Slips(u[2:6], u[6:10])), load)
        rolling = self._rolling_force(x[0]) * soft_sign(x[0])
        accel_x, accel_y, yaw_accel = self._body(F_x, F_y, steer, self.drag(x[0]) + rolling)
        return Motion(accel_x, accel_y, yaw_accel, F_x, F_y, load)
