"""A single-track car with the plants' interface: something cheap for drivers to drive."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from roadstate.core.constants import GRAVITY
from roadstate.sim.plant.base import Controls, Truth
from roadstate.vehicles import LinearlyImplicit, SingleTrack, Vehicle

STRONGER = 0.8
"""How much the pedals do of what the driver thinks."""


class CarState(NamedTuple):
    """x = (v_x, v_y, r); place on the road; heading against it; what the pedals do, m/s²."""

    x: Any
    s: Any
    d: Any
    heading: Any
    push: Any


class SimpleCar(eqx.Module):
    """Single-track model; pedals are an acceleration with a lag, steering has none."""

    model: SingleTrack
    ratio: float
    slip_stiffness: float

    @classmethod
    def of(cls, vehicle: Vehicle) -> SimpleCar:
        ratio = 1.0 if vehicle.steering is None else vehicle.steering.ratio
        return cls(SingleTrack.from_vehicle(vehicle), ratio, vehicle.tires.slip_stiffness)

    def init(self, road: Any, speed: Any, s: Any = 0.0, d: Any = 0.0) -> CarState:
        zero = jnp.zeros(())
        x = jnp.stack([jnp.asarray(speed, float), zero, zero])
        return CarState(x, jnp.asarray(s, float), jnp.asarray(d, float), zero, zero)

    def step(self, road: Any, state: CarState, controls: Controls, dt: float) -> CarState:
        point = road.at(state.s, state.d)
        grade = jnp.arctan(point.dz_ds)
        model = eqx.tree_at(
            lambda m: (m.grade, m.friction), self.model, (grade, jnp.broadcast_to(point.friction, (4,)))
        )
        speed = state.x[0]
        power = jnp.minimum(0.5 * GRAVITY, 30.0 / jnp.maximum(speed, 0.1))
        asked = STRONGER * (controls.throttle * power - 12.0 * controls.brake)
        push = state.push + (asked - state.push) * -jnp.expm1(-dt / 0.1)
        slip = push / (self.slip_stiffness * GRAVITY)
        steer = controls.steering_wheel / self.ratio
        u = model.input_vector({"steer": steer, "slip_front": slip, "slip_rear": slip})
        x = LinearlyImplicit().step(model, state.x, u, dt)
        x = jnp.where(x[0] > 0, x, 0.0)
        v_x, v_y, r = x
        along = v_x * jnp.cos(state.heading) - v_y * jnp.sin(state.heading)
        aside = v_x * jnp.sin(state.heading) + v_y * jnp.cos(state.heading)
        s_rate = along / (1 - point.curvature * state.d)
        heading = state.heading + dt * (r - point.curvature * s_rate)
        return CarState(x, state.s + dt * s_rate, state.d + dt * aside, heading, push)

    def truth(self, road: Any, state: CarState, controls: Controls) -> Truth:
        point = road.at(state.s, state.d)
        v_x, v_y, r = state.x
        zero, none = jnp.zeros(()), jnp.zeros(4)
        grade = jnp.arctan(point.dz_ds)
        across = v_x * r
        return Truth(
            position=jnp.stack([point.x, point.y, point.z]),
            attitude=jnp.stack([point.heading + state.heading, -grade, zero]),
            road=jnp.stack([state.s, state.d]),
            velocity=jnp.stack([v_x, v_y, zero]),
            angular_rate=jnp.stack([zero, zero, r]),
            specific_force=jnp.stack([state.push, across, GRAVITY + zero]),
            angular_accel=jnp.zeros(3),
            planar_velocity=jnp.stack([v_x, v_y]),
            grade=grade,
            bank=zero,
            wheel_speed=none + v_x / 0.3,
            steer=none + controls.steering_wheel / self.ratio,
            force_x=none,
            force_y=none,
            load=none + self.model.mass * GRAVITY / 4,
            force_body=jnp.zeros((4, 3)),
            slip=none,
            slip_angle=none,
            camber=none,
            friction=none + point.friction,
            drive_torque=none,
            brake_torque=none,
            brake_pressure=none,
            travel=none,
            engine_speed=zero,
            engine_torque=zero,
            gear=zero + 1,
            gear_ratio=zero + 1,
        )
