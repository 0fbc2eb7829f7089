"""Planar motion with four wheels that turn, under tire forces that are given."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.tires.base import as_leaf
from roadstate.tires.smooth import Numbers
from roadstate.vehicles.kinematics import wheel_steer
from roadstate.vehicles.model import (
    BODY_OUTPUTS,
    PLANAR_STATES,
    Motion,
    Stiff,
    VehicleModel,
    per_wheel,
)
from roadstate.vehicles.wheels import Spin, spin


class SevenDofForces(VehicleModel):
    """v_x, v_y, r and ω of four wheels, with the forces of the four contacts as inputs.

    Where a force observer makes them states, no tire model is needed: the wheels' speeds tell F_x, the body's
    accelerations the sums. Rolling resistance is a moment on the wheels.

    Attributes as :class:`roadstate.vehicles.model.VehicleModel`, and:
        rolling_resistance: f₀, rolling resistance over load.
        rolling_resistance_speed: f₂ in f = f₀ + f₂v², s²/m².
        wheel_radius: (4,) effective rolling radius R_w, m.
        wheel_inertia: (4,) I_w, kg·m².
    """

    name = "seven_dof_forces"
    summary = "planar motion and four wheel spins, tire forces as inputs"
    states: ClassVar[tuple[str, ...]] = (*PLANAR_STATES, *per_wheel("wheel_speed"))
    inputs: ClassVar[tuple[str, ...]] = (
        "steer",
        "steer_rear",
        *per_wheel("drive_torque"),
        *per_wheel("brake_torque"),
        *per_wheel("force_x"),
        *per_wheel("force_y"),
    )
    outputs: ClassVar[tuple[str, ...]] = (*BODY_OUTPUTS, *per_wheel("wheel_speed"))

    rolling_resistance: Numbers = eqx.field(converter=as_leaf)
    rolling_resistance_speed: Numbers = eqx.field(converter=as_leaf)
    wheel_radius: Numbers = eqx.field(converter=as_leaf)
    wheel_inertia: Numbers = eqx.field(converter=as_leaf)

    def motion(self, x: Float[Array, " 7"], u: Float[Array, " k"]) -> Motion:
        """As :meth:`VehicleModel.motion`."""
        F_x, F_y = u[10:14], u[14:18]
        accel_x, accel_y, yaw_accel = self._body(F_x, F_y, wheel_steer(u[0], u[1]), self.drag(x[0]))
        return Motion(accel_x, accel_y, yaw_accel, F_x, F_y, self.wheel_loads(accel_x, accel_y))

    def derivative(self, x: Float[Array, " 7"], u: Float[Array, " k"]) -> Float[Array, " 7"]:
        """As :meth:`VehicleModel.derivative`."""
        motion = self.motion(x, u)
        return jnp.concatenate([self._derivative(x, u, motion), self._spin(x, u, motion).accel])

    def measure(self, x: Float[Array, " 7"], u: Float[Array, " k"]) -> dict[str, Numbers]:
        """As :meth:`VehicleModel.measure`, with the wheel speeds."""
        wheels = dict(zip(per_wheel("wheel_speed"), x[3:7], strict=True))
        return self._outputs(x, u, self.motion(x, u)) | wheels

    def stiff(self, x: Float[Array, " 7"], u: Float[Array, " k"]) -> Stiff:
        """As :meth:`VehicleModel.stiff`: nothing but the brakes is."""
        motion = self.motion(x, u)
        wheels = self._spin(x, u, motion)
        return Stiff(
            jnp.concatenate([self._derivative(x, u, motion), wheels.accel]),
            jnp.concatenate([jnp.zeros(3, x.dtype), wheels.dry]),
            jnp.zeros((7, 7), x.dtype),
        )

    def rolling_coefficient(self, speed: Numbers) -> Numbers:
        """Rolling resistance over load at a speed in m/s."""
        return self.rolling_resistance + self.rolling_resistance_speed * speed**2

    def _spin(self, x: Numbers, u: Numbers, motion: Motion) -> Spin:
        moment = self.rolling_coefficient(x[0]) * motion.load * self.wheel_radius
        return spin(x[3:7], u[2:6], u[6:10], motion.F_x, moment, self.wheel_radius, self.wheel_inertia)
