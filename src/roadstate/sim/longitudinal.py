"""A car as a point mass along its road: forces, standstill and one step of time.

This is the longitudinal equation alone: no tire slip dynamics, no lateral motion, no suspension.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, Self, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.core.constants import GRAVITY
from roadstate.sim.roads.grade import GradeProfile

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

X = TypeVar("X")
_Number = Float[Array, ""] | float


def rk4(derivative: Callable[[X], X], x: X, dt: float) -> X:
    """One step of the classical fourth-order Runge–Kutta scheme for ẋ = f(x).

    Args:
        derivative: f; takes and gives the same pytree.
        x: state.
        dt: step in s.
    """

    def ahead(slope: X, share: float) -> X:
        moved: X = jax.tree.map(lambda a, b: a + share * dt * b, x, slope)
        return moved

    k1 = derivative(x)
    k2 = derivative(ahead(k1, 0.5))
    k3 = derivative(ahead(k2, 0.5))
    k4 = derivative(ahead(k3, 1.0))
    mean = jax.tree.map(lambda a, b, c, d: (a + 2 * b + 2 * c + d) / 6, k1, k2, k3, k4)
    return ahead(mean, 1.0)


class Motion(eqx.Module):
    """Distance along the road (m) and velocity (m/s, forward positive)."""

    distance: Float[Array, ""]
    velocity: Float[Array, ""]


class Push(NamedTuple):
    """What acts on the car from its driveline.

    Attributes:
        drive_torque: sum over the wheels of what engine torque gives there in steady running, N·m.
        brake_torque: sum over the wheels, N·m, never negative.
        total_ratio: engine speed over wheel speed in mesh; 0 with the clutch open.
    """

    drive_torque: _Number
    brake_torque: _Number = 0.0
    total_ratio: _Number = 0.0


class LongitudinalPlant(eqx.Module):
    """m_e v̇ = T_d/R − sgn(v)(T_b/R + m g f cos θ) − ½ρC_dA v|v| − m g sin θ, f = f₀ + f₂v².

    The driving equation (paper 002, eq. 37) with brakes and rotating parts: m_e = m + (ΣI_w + I_e i²)/R²
    (Gillespie, *Fundamentals of Vehicle Dynamics*, ch. 2). At standstill brakes and rolling resistance hold
    the car up to their size, as dry friction does.

    Attributes:
        mass: m in kg.
        open_mass: m + ΣI_w/R², with the driveline open, in kg.
        engine_inertia: I_e in kg·m².
        radius: R in m.
        drag: ½ρC_dA in kg/m.
        rolling: f₀, dimensionless.
        rolling_growth: f₂ in s²/m².
    """

    mass: Float[Array, ""]
    open_mass: Float[Array, ""]
    engine_inertia: Float[Array, ""]
    radius: Float[Array, ""]
    drag: Float[Array, ""]
    rolling: Float[Array, ""]
    rolling_growth: Float[Array, ""]

    @classmethod
    def from_vehicle(cls, vehicle: Vehicle) -> Self:
        """The plant of a vehicle file."""
        figures = {
            "mass": vehicle.mass,
            "open_mass": vehicle.effective_mass(),
            "engine_inertia": vehicle.driveline.engine_inertia,
            "radius": vehicle.wheels.radius,
            "drag": vehicle.drag_factor,
            "rolling": vehicle.rolling_resistance.coefficient,
            "rolling_growth": vehicle.rolling_resistance.speed_coefficient,
        }
        return cls(**{name: jnp.asarray(value) for name, value in figures.items()})

    def effective_mass(self, total_ratio: _Number = 0.0) -> Float[Array, ""]:
        """m_e in kg with this ratio (engine speed over wheel speed) in mesh."""
        return self.open_mass + self.engine_inertia * total_ratio**2 / self.radius**2

    def free_force(self, velocity: _Number, grade: _Number, push: Push) -> Float[Array, ""]:
        """Force in N of all that does not ask which way the wheels roll: drive, drag, weight."""
        drag = self.drag * velocity * jnp.abs(jnp.asarray(velocity))
        return push.drive_torque / self.radius - drag - self.mass * GRAVITY * jnp.sin(grade)

    def holding_force(self, velocity: _Number, grade: _Number, push: Push) -> Float[Array, ""]:
        """Force in N that brakes and rolling resistance can set against motion, never negative."""
        rolling = self.rolling + self.rolling_growth * velocity**2
        return push.brake_torque / self.radius + self.mass * GRAVITY * rolling * jnp.cos(grade)

    def acceleration(self, velocity: _Number, grade: _Number, push: Push) -> Float[Array, ""]:
        """v̇ in m/s² at a velocity (m/s) and grade (rad); 0 for a car that stands and is held."""
        free, hold = self.free_force(velocity, grade, push), self.holding_force(velocity, grade, push)
        rolls = free - jnp.sign(velocity) * hold
        breaks_loose = jnp.sign(free) * jnp.maximum(jnp.abs(free) - hold, 0.0)
        return jnp.where(velocity == 0, breaks_loose, rolls) / self.effective_mass(push.total_ratio)

    def step(self, motion: Motion, road: GradeProfile, push: Push, dt: float) -> Motion:
        """The motion ``dt`` seconds later with what acts held constant (fourth order but where it stops).

        A step in which brakes and rolling resistance would turn the car round ends at standstill instead.
        """
        start = self.acceleration(motion.velocity, road.grade(motion.distance), push)
        direction = jnp.where(motion.velocity == 0, jnp.sign(start), jnp.sign(motion.velocity))
        mass = self.effective_mass(push.total_ratio)

        def derivative(x: Motion) -> Motion:
            grade = road.grade(x.distance)
            held = direction * self.holding_force(x.velocity, grade, push)
            return Motion(x.velocity, (self.free_force(x.velocity, grade, push) - held) / mass)

        after = rk4(derivative, motion, dt)
        moves = (direction != 0) & (after.velocity * direction > 0)
        distance = jnp.where(direction != 0, after.distance, motion.distance)
        return Motion(distance, jnp.where(moves, after.velocity, 0.0))
