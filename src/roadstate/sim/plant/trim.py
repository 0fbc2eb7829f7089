"""Where a car comes to rest on its springs, by Newton's method."""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from roadstate.sim.plant.base import Controls, Road
from roadstate.sim.plant.brakes import BrakeState
from roadstate.sim.plant.vectors import rotation, to_body
from roadstate.tires.smooth import Numbers

if TYPE_CHECKING:
    from roadstate.sim.plant.multibody import MultibodyPlant, State

_STEPS = 40
# m and rad that a step moves at most: a tire that leaves the road, or a stop that is hit, bends the way there
_FARTHEST = 0.02
# speed (m/s) below which the car counts as parked
_PARKED = 1e-9


def trimmed(plant: MultibodyPlant, road: Road, speed: ArrayLike, s: ArrayLike, d: ArrayLike) -> State:
    """A car in equilibrium, straight along the road.

    Height, pitch, roll and four travels are such that nothing accelerates vertically, in pitch or in roll;
    of a parked car the tires' deflections (alike at all wheels) are such that it does not accelerate along
    and across the road either. A rolling car's wheels roll freely. Where the road is so uneven that a wheel
    hangs in the air there may be no such place; then the car starts near one.

    Args:
        plant: the car.
        road, speed, s, d: as :meth:`roadstate.sim.plant.base.Plant.init`.
    """
    v, s, d = (jnp.asarray(a, jnp.result_type(float)) for a in (speed, s, d))
    parked = jnp.abs(v) < _PARKED
    controls = Controls.make()

    def evaluate(x: Numbers) -> tuple[Numbers, Numbers]:
        now = plant.now(road, _state(plant, road, v, s, d, x), controls)
        body, rate = now.accelerations.velocity, now.accelerations.rate
        lost = jnp.where(parked, body[:2], x[7:])
        residual = jnp.concatenate([body[2:], rate[:2], now.accelerations.travel, lost])
        return residual, plant.tires.mean(now.contact.velocity_x / now.contact.effective_radius)

    # one compiled evaluation for the point and its nine neighbours: a Jacobian traced through takes longer to
    # compile than all else
    step = float(np.sqrt(np.finfo(v.dtype).eps)) * 10
    shifts = jnp.concatenate([jnp.zeros((1, 9), v.dtype), step * jnp.eye(9, dtype=v.dtype)])

    def newton(_: int, carry: tuple[Numbers, Numbers]) -> tuple[Numbers, Numbers]:
        x, _spin = carry
        residuals, spins = jax.vmap(evaluate)(x + shifts)
        J = (residuals[1:] - residuals[0]).T / step
        move = jnp.linalg.solve(J, residuals[0])
        share = jnp.minimum(1.0, _FARTHEST / jnp.maximum(jnp.max(jnp.abs(move)), _FARTHEST))
        return x - share * move, spins[0]

    x, spin = jax.lax.fori_loop(0, _STEPS, newton, (jnp.zeros(9, v.dtype), jnp.zeros(4, v.dtype)))
    state = _state(plant, road, v, s, d, x)
    spin = jnp.where(parked, 0.0, spin)
    parts, memory = plant.driveline.start(spin)
    return state._replace(motion=state.motion._replace(spin=spin, parts=parts), memory=memory)


def _state(plant: MultibodyPlant, road: Road, v: Numbers, s: Numbers, d: Numbers, x: Numbers) -> State:
    from roadstate.sim.plant.multibody import Motion, State

    parked = jnp.abs(v) < _PARKED
    point = road.at(s, d)
    along = point.dz_ds / (1 - point.curvature * d)
    standing = plant.tires.radius[0] - plant.tires.nominal_deflection[0]
    height = point.z + standing - plant.chassis.places[2, 1] + x[0]
    # a body on the road's slope to begin with
    pitch, roll = -jnp.arctan(along) + x[1], jnp.arctan(point.dz_dd) + x[2]
    attitude = jnp.stack([point.heading, pitch, roll])
    R = rotation(attitude)
    tangent = jnp.stack([jnp.cos(point.heading), jnp.sin(point.heading), along])
    velocity = to_body(R, v * tangent / jnp.sqrt(1 + along**2))
    zero, zeros = jnp.zeros((), v.dtype), jnp.zeros(4, v.dtype)
    radius = plant.tires.mean(plant.tires.effective_radius(plant.tires.nominal_deflection))
    spin = jnp.where(parked, 0.0, v / radius)
    parts, memory = plant.driveline.start(spin)
    motion = Motion(
        position=jnp.stack([point.x, point.y, height]),
        attitude=attitude,
        road=jnp.stack([s, d]),
        travel=x[3:7],
        steer=zero,
        velocity=velocity,
        rate=jnp.zeros(3, v.dtype),
        travel_rate=zeros,
        steer_rate=zero,
        spin=spin,
        parts=parts,
    )
    pressure = jnp.where(parked, plant.brakes.largest_pressure, 0.0) * jnp.ones(4, v.dtype)
    ones = jnp.ones(4, v.dtype)
    slip = jnp.stack([x[7] * ones, x[8] * ones])
    slip = plant.tires.of_wheels(slip)
    still = jax.tree.map(jnp.zeros_like, motion)
    unmoved = jnp.zeros_like(slip)
    return State(motion, slip, memory, BrakeState(pressure, ones, ones), still, unmoved, unmoved)
