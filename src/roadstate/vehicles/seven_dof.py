"""Planar motion with four wheels that turn."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.tires.base import as_leaf
from roadstate.tires.smooth import Numbers
from roadstate.vehicles.kinematics import sliding_jacobian, wheel_slips, wheel_steer, wheel_velocities
from roadstate.vehicles.model import PLANAR_STATES, Motion, Stiff, per_wheel
from roadstate.vehicles.tire_vehicle import TIRE_OUTPUTS, Contacts, TireVehicle
from roadstate.vehicles.wheels import Spin, spin


class SevenDof(TireVehicle):
    """v_x, v_y, r and ω of four wheels on four tires, driven and braked by torques at the wheels.

    Attributes as :class:`roadstate.vehicles.tire_vehicle.TireVehicle`, and:
        wheel_radius: (4,) effective rolling radius R_w, m.
        wheel_inertia: (4,) I_w, kg·m².
        drive_split: (4,) share of each wheel in the drive torque, for
            :func:`roadstate.vehicles.wheels.split_torque`.
    """

    name = "seven_dof"
    summary = "planar motion and four wheel spins on four tires"
    states: ClassVar[tuple[str, ...]] = (*PLANAR_STATES, *per_wheel("wheel_speed"))
    inputs: ClassVar[tuple[str, ...]] = (
        "steer",
        "steer_rear",
        *per_wheel("drive_torque"),
        *per_wheel("brake_torque"),
    )
    outputs: ClassVar[tuple[str, ...]] = (*TIRE_OUTPUTS, *per_wheel("wheel_speed"))

    wheel_radius: Numbers = eqx.field(converter=as_leaf)
    wheel_inertia: Numbers = eqx.field(converter=as_leaf)
    drive_split: Numbers = eqx.field(converter=as_leaf)

    def _contacts(self, x: Numbers, u: Numbers) -> Contacts:
        steer = wheel_steer(u[0], u[1])
        velocity = wheel_velocities(x[0], x[1], x[2], self.wheel_positions, steer)
        return Contacts(steer, velocity, wheel_slips(velocity, x[3:7], self.wheel_radius))

    def _spin(self, x: Numbers, u: Numbers, motion: Motion) -> Spin:
        rolling = self._rolling_coefficient(x[0]) * motion.load * self.wheel_radius
        return spin(x[3:7], u[2:6], u[6:10], motion.F_x, rolling, self.wheel_radius, self.wheel_inertia)

    def motion(self, x: Float[Array, " 7"], u: Float[Array, " k"]) -> Motion:
        """As :meth:`VehicleModel.motion`."""
        return self._balance(x, self._contacts(x, u), self.drag(x[0]))

    def derivative(self, x: Float[Array, " 7"], u: Float[Array, " k"]) -> Float[Array, " 7"]:
        """As :meth:`VehicleModel.derivative`."""
        motion = self.motion(x, u)
        return jnp.concatenate([self._derivative(x, u, motion), self._spin(x, u, motion).accel])

    def measure(self, x: Float[Array, " 7"], u: Float[Array, " k"]) -> dict[str, Numbers]:
        """As :meth:`VehicleModel.measure`, with slips, slip angles and wheel speeds."""
        contacts = self._contacts(x, u)
        motion = self._balance(x, contacts, self.drag(x[0]))
        wheels = dict(zip(per_wheel("wheel_speed"), x[3:7], strict=True))
        return self._tire_outputs(x, u, motion, contacts) | wheels

    def stiff(self, x: Float[Array, " 7"], u: Float[Array, " k"]) -> Stiff:
        """As :meth:`VehicleModel.stiff`.

        With the sliding velocities s = G x and the tire forces D s, the forces on the states are −Gᵀ D G x: a
        damping that only ever takes energy.
        """
        contacts = self._contacts(x, u)
        motion = self._balance(x, contacts, self.drag(x[0]))
        wheels = self._spin(x, u, motion)
        along, across = self._sliding_damping(contacts, motion.load)
        coupling = -sliding_jacobian(self.wheel_positions, contacts.steer)[0].T * (along * self.wheel_radius)
        damping = jnp.block(
            [
                [self._body_damping(contacts, along, across), coupling],
                [coupling.T, jnp.diag(-along * self.wheel_radius**2)],
            ]
        )
        inertia = jnp.concatenate([self._body_inertia(), self.wheel_inertia])
        return Stiff(
            jnp.concatenate([self._derivative(x, u, motion), wheels.accel]),
            jnp.concatenate([jnp.zeros(3, x.dtype), wheels.dry]),
            damping / inertia[:, None],
        )
