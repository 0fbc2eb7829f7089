"""Planar motion on four tires whose longitudinal slip is given."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.tires.slip import slip_angle
from roadstate.tires.smooth import Numbers
from roadstate.vehicles.kinematics import Slips, wheel_steer, wheel_velocities
from roadstate.vehicles.model import Motion, Stiff, per_wheel, soft_sign
from roadstate.vehicles.tire_vehicle import Contacts, TireVehicle


class ThreeDof(TireVehicle):
    """v_x, v_y, r on four tires: slip κ of each wheel in, slip angles and loads from the motion.

    The wheels do not turn in this model, so the rolling resistance acts on the body.

    Attributes as :class:`roadstate.vehicles.tire_vehicle.TireVehicle`.
    """

    name = "three_dof"
    summary = "planar motion, four tires, slips as inputs"
    inputs: ClassVar[tuple[str, ...]] = ("steer", "steer_rear", *per_wheel("slip"))

    def _slip(self, u: Numbers) -> Numbers:
        return u[2:6]

    def _contacts(self, x: Numbers, u: Numbers) -> Contacts:
        steer = wheel_steer(u[0], u[1])
        velocity = wheel_velocities(x[0], x[1], x[2], self.wheel_positions, steer)
        return Contacts(steer, velocity, Slips(self._slip(u), slip_angle(velocity.x, velocity.y)))

    def _move(self, x: Numbers, contacts: Contacts) -> Motion:
        rolling = self._rolling_force(x[0]) * soft_sign(x[0])
        return self._balance(x, contacts, self.drag(x[0]) + rolling)

    def motion(self, x: Float[Array, " 3"], u: Float[Array, " k"]) -> Motion:
        """As :meth:`VehicleModel.motion`."""
        return self._move(x, self._contacts(x, u))

    def measure(self, x: Float[Array, " 3"], u: Float[Array, " k"]) -> dict[str, Numbers]:
        """As :meth:`VehicleModel.measure`, with slips and slip angles."""
        contacts = self._contacts(x, u)
        return self._tire_outputs(x, u, self._move(x, contacts), contacts)

    def stiff(self, x: Float[Array, " 3"], u: Float[Array, " k"]) -> Stiff:
        """As :meth:`VehicleModel.stiff`: lateral forces are stiff at low speed."""
        contacts = self._contacts(x, u)
        motion = self._move(x, contacts)
        _, across = self._sliding_damping(contacts, motion.load)
        dry = jnp.stack([self._rolling_force(x[0]) / self.mass, jnp.zeros_like(x[0]), jnp.zeros_like(x[0])])
        damping = self._body_damping(contacts, 0.0, across) / self._body_inertia()[:, None]
        return Stiff(self._derivative(x, u, motion), dry, damping)
