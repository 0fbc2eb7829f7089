"""The steering between the steering wheel, which the driver holds, and the front wheels."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from roadstate.sim.plant.chassis import Chassis
from roadstate.sim.plant.vectors import cross, dot, unit
from roadstate.tires.base import as_leaf
from roadstate.tires.smooth import Numbers


class Steering(eqx.Module):
    """One degree of freedom, the mean road-wheel angle, on a spring to the angle of the steering wheel.

    Attributes:
        ratio: steering-wheel angle over mean road-wheel angle.
        stiffness, damping, inertia: of both road wheels, N·m/rad, N·m·s/rad, kg·m².
        ackermann: share, times track over twice the wheelbase: the wheels stand at δ(1 ± this·δ).
    """

    ratio: Numbers = eqx.field(converter=as_leaf)
    stiffness: Numbers = eqx.field(converter=as_leaf)
    damping: Numbers = eqx.field(converter=as_leaf)
    inertia: Numbers = eqx.field(converter=as_leaf)
    ackermann: Numbers = eqx.field(converter=as_leaf)

    def angles(self, steer: Numbers) -> tuple[Numbers, Numbers]:
        """(4,) angle of each wheel about its steering axis, rad, and its derivative by the mean angle."""
        side = jnp.asarray([1.0, -1.0, 0.0, 0.0], steer.dtype)
        front = jnp.asarray([1.0, 1.0, 0.0, 0.0], steer.dtype)
        bend = self.ackermann * side * steer
        return steer * (front + bend), front + 2 * bend

    def axes(self, chassis: Chassis, travel: Numbers, angle: Numbers) -> Numbers:
        """(3, 4) axes of the wheels, to the left, along the body's axes."""
        left = jnp.asarray([[0.0], [1.0], [0.0]], travel.dtype)
        leaning = unit(left + cross(chassis.turned(travel), jnp.broadcast_to(left, (3, 4))))
        k, cos, sin = chassis.steering_axis, jnp.cos(angle), jnp.sin(angle)
        return leaning * cos + cross(k, leaning) * sin + k * (dot(k, leaning) * (1 - cos))

    def spring(self, steer: Numbers, steer_rate: Numbers, wheel: Numbers) -> Numbers:
        """Torque on the road wheels, N·m; the steering wheel is held, so the damper's other end stands."""
        return self.stiffness * (wheel / self.ratio - steer) - self.damping * steer_rate
