"""How the body's motion moves each wheel, and the slips that follow.

All exact for any steer and slip: nothing is taken as small. Arrays of four wheels (fl, fr, rl, rr) have them
on their last axis; body quantities may carry leading axes (a whole log).
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import ArrayLike

from roadstate.tires.slip import practical_slip, slip_angle
from roadstate.tires.smooth import Numbers

_LEFT = (1.0, -1.0, 1.0, -1.0)


class Planar(NamedTuple):
    """Two components in the road plane: ``x`` forward, ``y`` left; (..., 4)."""

    x: Numbers
    y: Numbers


class Slips(NamedTuple):
    """Slips of the wheels, (..., 4).

    Attributes:
        slip: practical slip κ = (R_w ω − v_x)/|v_x|.
        slip_angle: α, rad; positive gives a force to the left.
    """

    slip: Numbers
    slip_angle: Numbers


def wheel_positions(
    cg_to_front_axle: ArrayLike, cg_to_rear_axle: ArrayLike, track_front: ArrayLike, track_rear: ArrayLike
) -> Planar:
    """Where the wheels are, seen from the centre of gravity: (4,) each, m.

    Args:
        cg_to_front_axle, cg_to_rear_axle: l_f and l_r, m.
        track_front, track_rear: T_f and T_r, m; zero merges left and right.
    """
    forward = jnp.stack(jnp.broadcast_arrays(cg_to_front_axle, cg_to_rear_axle))
    half_track = 0.5 * jnp.stack(jnp.broadcast_arrays(track_front, track_rear))
    axle = jnp.asarray([0, 0, 1, 1])
    side = jnp.asarray(_LEFT, half_track.dtype)
    toward = jnp.asarray([1.0, 1.0, -1.0, -1.0], forward.dtype)
    return Planar(forward[axle] * toward, half_track[axle] * side)


def wheel_steer(front: ArrayLike, rear: ArrayLike = 0.0) -> Numbers:
    """(..., 4) steer of each wheel, rad, from the mean angle of each axle (both wheels parallel)."""
    return jnp.stack(jnp.broadcast_arrays(front, front, rear, rear), axis=-1)


def wheel_velocities(
    speed: ArrayLike, velocity_y: ArrayLike, yaw_rate: ArrayLike, positions: Planar, steer: ArrayLike
) -> Planar:
    """Velocity of each wheel centre in that wheel's own frame, (..., 4), m/s.

    In the body frame v_x,i = v_x − r y_i, v_y,i = v_y + r x_i, with (x_i, y_i) the wheel's place; then
    rotated by its steer.

    Args:
        speed, velocity_y: v_x and v_y of the centre of gravity, (...), m/s.
        yaw_rate: r, (...), rad/s.
        positions: from :func:`wheel_positions`.
        steer: (..., 4), rad.
    """
    r = jnp.asarray(yaw_rate)[..., None]
    v_x = jnp.asarray(speed)[..., None] - r * positions.y
    v_y = jnp.asarray(velocity_y)[..., None] + r * positions.x
    cos, sin = jnp.cos(steer), jnp.sin(steer)
    return Planar(v_x * cos + v_y * sin, v_y * cos - v_x * sin)


def wheel_slips(velocity: Planar, wheel_speed: ArrayLike, radius: ArrayLike) -> Slips:
    """Practical slip and slip angle of each wheel.

    Args:
        velocity: in the wheels' frames, from :func:`wheel_velocities`, m/s.
        wheel_speed: ω, (..., 4), rad/s.
        radius: effective rolling radius R_w, (4,) or scalar, m.
    """
    rolling = jnp.asarray(radius) * wheel_speed
    return Slips(practical_slip(rolling, velocity.x), slip_angle(velocity.x, velocity.y))


def to_body(F_x: ArrayLike, F_y: ArrayLike, steer: ArrayLike) -> Planar:
    """Forces in the wheels' frames, turned into the body's frame; all (..., 4), N and rad."""
    cos, sin = jnp.cos(steer), jnp.sin(steer)
    along, across = jnp.asarray(F_x), jnp.asarray(F_y)
    return Planar(along * cos - across * sin, along * sin + across * cos)


def sliding_jacobian(positions: Planar, steer: ArrayLike) -> tuple[Numbers, Numbers]:
    """How each contact's sliding velocity depends on (v_x, v_y, r): (4, 3) along the wheel, (4, 3) across.

    The sliding velocities are those the tire force answers to with its own sign: R_w ω − v_x,w along and
    −v_y,w across. By duality of power the forces on (v_x, v_y, r) are minus the transposes times the tire
    forces.

    Args:
        positions: from :func:`wheel_positions`.
        steer: (4,), rad.
    """
    cos, sin = jnp.cos(steer), jnp.sin(steer)
    x, y = positions
    along = jnp.stack([-cos, -sin, y * cos - x * sin], axis=-1)
    across = jnp.stack([sin, -cos, -(y * sin + x * cos)], axis=-1)
    return along, across
