"""Vertical loads of the wheels from what the body feels, without its springs (quasi-static)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import jax.numpy as jnp
from jaxtyping import ArrayLike

from roadstate.core.constants import GRAVITY
from roadstate.tires.smooth import Numbers

if TYPE_CHECKING:
    from roadstate.vehicles.model import VehicleModel

# Roll moment (N·m) an axle can carry below which it is taken as lifted.
_LIFTED = 1e-3


def gravity_part(grade: ArrayLike, bank: ArrayLike) -> tuple[Numbers, Numbers, Numbers]:
    """What an accelerometer at rest on a road reads along x, y and z of the road plane, m/s².

    The car's attitude is heading, then grade about y, then bank about x (ISO 8855), so that x rises by
    sin θ, y by sin φ cos θ and z by cos φ cos θ; specific force at rest is g times these: parked uphill a_x
    reads +g sin θ, parked with the left side higher a_y reads +g cos θ sin φ.

    Args:
        grade: θ, rad, positive uphill.
        bank: φ, rad, positive with the left side higher.
    """
    theta, phi = jnp.asarray(grade), jnp.asarray(bank)
    return (
        GRAVITY * jnp.sin(theta),
        GRAVITY * jnp.cos(theta) * jnp.sin(phi),
        GRAVITY * jnp.cos(theta) * jnp.cos(phi),
    )


def vertical_loads(car: VehicleModel, accel_x: ArrayLike, accel_y: ArrayLike) -> Numbers:
    """(..., 4) wheel loads, N, that balance the body's pitch and roll moments.

    F_z,fl/fr = m (l_r g_z − h a_x)/(2L) ∓ ε m h a_y/T_f,
    F_z,rl/rr = m (l_f g_z + h a_x)/(2L) ∓ (1 − ε) m h a_y/T_r,
    where g_z = g cos θ cos φ and ε is the front axle's share of the roll moment (l_r/L where nothing more is
    known). The accelerations are specific forces, so the part of gravity along a slope is inside them.

    A wheel cannot pull on the road. What a lifted wheel would have to pull is taken by the other axle's pair,
    and an axle that lifts leaves all its load to the other; only when both of one side have lifted is moment
    lost (the car tips). So the total is always m g_z.

    Args:
        car: whose mass, geometry, roll share, grade and bank count.
        accel_x, accel_y: specific forces along x and y, (...), m/s².
    """
    axle = _axles(car)
    a_x, a_y = jnp.asarray(accel_x)[..., None], jnp.asarray(accel_y)[..., None]
    load = jnp.clip(axle.standing + axle.pitch * a_x, 0, jnp.sum(axle.standing))
    wanted, capacity = axle.roll * a_y, 0.5 * load * axle.track
    unmet = wanted - jnp.clip(wanted, -capacity, capacity)
    # half of the axle's load is all that can change sides
    share = jnp.clip(0.5 * (wanted + unmet[..., ::-1]) / jnp.maximum(capacity, _LIFTED), -0.5, 0.5)
    wheels = load[..., None] * jnp.stack([0.5 - share, 0.5 + share], axis=-1)
    return wheels.reshape(*wheels.shape[:-2], 4)


def load_slope(car: VehicleModel) -> Numbers:
    """(2, 4) load per a_x and per a_y while all wheels stand on the road, N per m/s².

    Args:
        car: whose mass, geometry and roll share count.
    """
    axle = _axles(car)
    roll = axle.roll / axle.track
    return jnp.stack([jnp.repeat(0.5 * axle.pitch, 2), jnp.stack([-roll, roll], axis=-1).reshape(4)])


class _Axles(NamedTuple):
    # front and rear: standing load N, load per a_x, roll moment per a_y, track m
    standing: Numbers
    pitch: Numbers
    roll: Numbers
    track: Numbers


def _axles(car: VehicleModel) -> _Axles:
    wheelbase = car.cg_to_front_axle + car.cg_to_rear_axle
    weight = car.mass * gravity_part(car.grade, car.bank)[2]
    lever = car.mass * car.cg_height
    pitch = lever / wheelbase
    return _Axles(
        weight / wheelbase * jnp.stack([car.cg_to_rear_axle, car.cg_to_front_axle]),
        jnp.stack([-pitch, pitch]),
        lever * jnp.stack([car.front_roll_share, 1 - car.front_roll_share]),
        jnp.stack([car.track_front, car.track_rear]),
    )
