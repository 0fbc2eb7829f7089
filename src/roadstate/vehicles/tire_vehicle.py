"""What the models with tires share: forces in balance with the loads they cause, and how stiff they are."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from roadstate.linalg import product
from roadstate.tires.base import TireModel, as_leaf
from roadstate.tires.slip import SPEED_FLOOR
from roadstate.tires.smooth import Numbers, bounded_tan, soft_abs
from roadstate.vehicles.kinematics import Planar, Slips, sliding_jacobian, to_body
from roadstate.vehicles.loads import gravity_part
from roadstate.vehicles.model import BODY_OUTPUTS, Motion, VehicleModel, per_wheel

# Load of a wheel per mass of the car (N/kg, a twentieth of its share) at which one that lifts is evaluated.
_LIGHT = 0.12
# Slip at which the stiffness of a wheel that does not slip is taken.
_SMALL_SLIP = 1e-3

TIRE_OUTPUTS = (*BODY_OUTPUTS, *per_wheel("slip"), *per_wheel("slip_angle"))
"""What every model with tires can tell."""


class Contacts(NamedTuple):
    """How the four tires meet the road.

    Attributes:
        steer: (4,), rad.
        velocity: of the wheel centres in the wheels' frames, (4,) each, m/s.
        slips: slip and slip angle, (4,) each.
    """

    steer: Numbers
    velocity: Planar
    slips: Slips


class TireVehicle(VehicleModel):
    """A vehicle whose tire forces come from a tire model.

    Attributes as :class:`VehicleModel`, and:
        tire: the tire; its parameters may be (4,), one for each wheel.
        friction: (4,) peak friction coefficient μ under each wheel.
        rolling_resistance: f₀, rolling resistance over load.
        rolling_resistance_speed: f₂ in f = f₀ + f₂v², s²/m².
        load_rounds: evaluations of the tire spent on making forces and loads agree. One is exact for a tire
            whose force is proportional to load, as long as no wheel lifts. With a Magic Formula tire at the
            limit two leave a load wrong by up to 35 N on a low car (1 N as a rule), some hundred where a
            wheel is about to lift; each more leaves a tenth of that, a third beside a lifted wheel.
    """

    outputs: ClassVar[tuple[str, ...]] = TIRE_OUTPUTS

    tire: TireModel
    friction: Numbers = eqx.field(converter=as_leaf)
    rolling_resistance: Numbers = eqx.field(converter=as_leaf)
    rolling_resistance_speed: Numbers = eqx.field(converter=as_leaf)
    load_rounds: int = eqx.field(default=2, static=True, kw_only=True)

    def _rolling_coefficient(self, speed: Numbers) -> Numbers:
        return self.rolling_resistance + self.rolling_resistance_speed * speed**2

    def _forces(self, contacts: Contacts, load: Numbers) -> tuple[Numbers, Numbers]:
        slips = contacts.slips
        force = self.tire.forces(slips.slip, slips.slip_angle, load, self.friction, contacts.velocity.x)
        return force.F_x, force.F_y

    def _balance(self, x: Numbers, contacts: Contacts, resistance: Numbers) -> Motion:
        """Forces and loads that agree with each other.

        Loads follow from the accelerations, these from the forces, and the forces from the loads. A tire's
        force over its load depends little on the load (for most models not at all), and given it the loop is
        linear in the accelerations until a wheel lifts: each round evaluates the tire for that ratio and
        takes one step of Newton's method with the slope that holds while all wheels stand.
        """
        accel = jnp.zeros(2, x.dtype)
        load = self.wheel_loads(accel[0], accel[1])
        lost = jnp.stack([resistance, jnp.zeros_like(resistance)])
        for _ in range(self.load_rounds):
            tried = jnp.maximum(load, _LIGHT * self.mass)
            ratio = jnp.stack(to_body(*self._forces(contacts, tried), contacts.steer)) / tried
            excess = self.mass * accel + lost - jnp.sum(ratio * load, axis=1)
            J = self.mass * jnp.eye(2, dtype=x.dtype) - product(ratio, self.load_slope.T)
            accel = accel - _solve(J, excess)
            load = self.wheel_loads(accel[0], accel[1])
        F_x, F_y = self._forces(contacts, load)
        accel_x, accel_y, yaw_accel = self._body(F_x, F_y, contacts.steer, resistance)
        return Motion(accel_x, accel_y, yaw_accel, F_x, F_y, load)

    def _tire_outputs(self, x: Numbers, u: Numbers, motion: Motion, contacts: Contacts) -> dict[str, Numbers]:
        slips = (*contacts.slips.slip, *contacts.slips.slip_angle)
        names = TIRE_OUTPUTS[len(BODY_OUTPUTS) :]
        return self._outputs(x, u, motion) | dict(zip(names, slips, strict=True))

    def _sliding_damping(self, contacts: Contacts, load: Numbers) -> tuple[Numbers, Numbers]:
        """Tire force over sliding velocity, along and across each wheel, (4,), N·s/m.

        The quotient, not the slope: for a saturating force it exceeds the slope, and a step that is implicit
        in it can never carry the contact beyond pure rolling, however steep the force is there.
        """
        kappa, alpha = contacts.slips
        kappa = jnp.where(kappa < 0, kappa - _SMALL_SLIP, kappa + _SMALL_SLIP)
        alpha = jnp.where(alpha < 0, alpha - _SMALL_SLIP, alpha + _SMALL_SLIP)
        F_x, F_y = self._forces(contacts._replace(slips=Slips(kappa, alpha)), load)
        reference = soft_abs(contacts.velocity.x, SPEED_FLOOR)
        return (
            jnp.maximum(F_x / (kappa * reference), 0),
            jnp.maximum(F_y / (bounded_tan(alpha) * reference), 0),
        )

    def _body_damping(self, contacts: Contacts, along: ArrayLike, across: Numbers) -> Numbers:
        """(3, 3) minus the generalised damping of v_x, v_y, r, before the division by the inertias."""
        J_x, J_y = sliding_jacobian(self.wheel_positions, contacts.steer)
        weighted_x = J_x * jnp.broadcast_to(jnp.asarray(along), across.shape)[:, None]
        return -(J_x.T @ weighted_x + J_y.T @ (J_y * across[:, None]))

    def _body_inertia(self) -> Numbers:
        return jnp.stack([self.mass, self.mass, self.yaw_inertia])

    def _rolling_force(self, speed: Numbers) -> Numbers:
        """F_roll of a body that moves, N, without its sign."""
        weight = self.mass * gravity_part(self.grade, self.bank)[2]
        return self._rolling_coefficient(speed) * weight


def _solve(A: Float[Array, "2 2"], b: Float[Array, " 2"]) -> Float[Array, " 2"]:
    """A⁻¹ b by Cramer's rule."""
    adjugate = jnp.stack([A[1, 1] * b[0] - A[0, 1] * b[1], A[0, 0] * b[1] - A[1, 0] * b[0]])
    return adjugate / (A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0])
