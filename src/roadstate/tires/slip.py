"""The slips in use, one function each, and how they follow from one another.

All take the wheel frame: v_x forward, v_y left (m/s), and the rolling speed R_w·ω of the wheel (m/s). With
the sliding velocity of the contact (v_x − R_w ω, v_y), every slip is minus that velocity over a reference
speed, so the force always opposes the sliding, in reverse too:

=============  =======================  ========================================
slip           reference speed          where it is used
=============  =======================  ========================================
practical κ    |v_x|                    the tire models' argument; −1 is locked
theoretical σ  |R_w ω|                  Dugoff, brush; driving = braking
bounded s      max(\\|R_w ω\\|, \\|v_x\\|)    the papers; κ when braking, σ_x when driving
=============  =======================  ========================================

(Pacejka, *Tire and Vehicle Dynamics*, 3rd ed., §2.2 and §3.2.) Below the ``floor`` the reference speed is
replaced by a parabola that never falls under half of it (:func:`roadstate.tires.smooth.soft_abs`): above the
floor every slip is exact, at standstill it is finite, and it is differentiable everywhere.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import ArrayLike

from roadstate.tires.smooth import Numbers, bounded_tan, soft_abs

SPEED_FLOOR = 0.5
"""Reference speed (m/s) below which slips are regularised."""

# 1 + κ = R_w ω / |v_x| of a locking wheel: at a thousandth every tire has long been sliding, and only the
# direction of the slip still matters, which the floor does not change.
_LOCKED = 1e-3


class Slip2(NamedTuple):
    """A slip vector: ``x`` and ``y``, each any shape, dimensionless, positive towards the force it causes."""

    x: Numbers
    y: Numbers


def practical_slip(rolling_speed: ArrayLike, v_x: ArrayLike, floor: ArrayLike = SPEED_FLOOR) -> Numbers:
    """Practical slip κ = (R_w ω − v_x)/|v_x|: 0 free rolling, −1 locked, positive when driving forwards.

    Args:
        rolling_speed: R_w·ω, m/s, any shape.
        v_x: forward speed of the wheel centre in the wheel frame, m/s; negative in reverse.
        floor: reference speed below which the quotient is regularised, m/s.
    """
    rolling, speed = jnp.asarray(rolling_speed), jnp.asarray(v_x)
    return (rolling - speed) / soft_abs(speed, floor)


def theoretical_slip(
    rolling_speed: ArrayLike, v_x: ArrayLike, v_y: ArrayLike, floor: ArrayLike = SPEED_FLOOR
) -> Slip2:
    """Theoretical slip σ_x = (R_w ω − v_x)/|R_w ω|, σ_y = −v_y/|R_w ω|.

    Args:
        rolling_speed: R_w·ω, m/s, any shape.
        v_x: forward speed of the wheel centre in the wheel frame, m/s.
        v_y: speed to the left in the wheel frame, m/s.
        floor: reference speed below which the quotients are regularised, m/s.
    """
    rolling = jnp.asarray(rolling_speed)
    reference = soft_abs(rolling, floor)
    return Slip2((rolling - v_x) / reference, -jnp.asarray(v_y) / reference)


def bounded_slip(rolling_speed: ArrayLike, v_x: ArrayLike, floor: ArrayLike = SPEED_FLOOR) -> Numbers:
    """The papers' slip s = (R_w ω − v_x)/max(|R_w ω|, |v_x|), within ±1 unless the wheel turns backwards.

    Arguments as :func:`practical_slip`.
    """
    rolling, speed = jnp.asarray(rolling_speed), jnp.asarray(v_x)
    return (rolling - speed) / soft_abs(jnp.maximum(jnp.abs(rolling), jnp.abs(speed)), floor)


def slip_angle(
    v_x: ArrayLike, v_y: ArrayLike, steer: ArrayLike = 0.0, floor: ArrayLike = SPEED_FLOOR
) -> Numbers:
    """Slip angle α = steer − atan2(v_y, |v_x|), rad; positive α gives a force to the left.

    Args:
        v_x: forward speed of the wheel centre, m/s, any shape.
        v_y: its speed to the left, m/s.
        steer: angle of the wheel against the frame of the velocities, rad; 0 in the wheel frame.
        floor: forward speed below which the quotient is regularised, m/s.
    """
    return jnp.asarray(steer) - jnp.arctan2(jnp.asarray(v_y), soft_abs(jnp.asarray(v_x), floor))


def travel_direction(v_x: ArrayLike) -> Numbers:
    """1 forwards and at standstill, −1 in reverse, for v_x in m/s."""
    speed = jnp.asarray(v_x)
    return jnp.where(speed < 0, -jnp.ones_like(speed), jnp.ones_like(speed))


def theoretical_from_practical(slip: ArrayLike, angle: ArrayLike, v_x: ArrayLike = 1.0) -> Slip2:
    """σ_x = κ/|1 ± κ|, σ_y = tan α/|1 ± κ| (− in reverse), bounded and rightly directed for a locked wheel.

    Args:
        slip: practical slip κ, any shape.
        angle: slip angle α, rad.
        v_x: forward speed of the wheel centre, m/s; only its sign counts.
    """
    kappa = jnp.asarray(slip)
    reference = soft_abs(1 + travel_direction(v_x) * kappa, _LOCKED)
    return Slip2(kappa / reference, bounded_tan(jnp.asarray(angle)) / reference)


def bounded_from_practical(slip: ArrayLike, angle: ArrayLike, v_x: ArrayLike = 1.0) -> Slip2:
    """(κ, tan α)/max(1, |1 ± κ|): the papers' s and the lateral slip over the same reference speed.

    Arguments as :func:`theoretical_from_practical`.
    """
    kappa = jnp.asarray(slip)
    reference = jnp.maximum(1.0, jnp.abs(1 + travel_direction(v_x) * kappa))
    return Slip2(kappa / reference, bounded_tan(jnp.asarray(angle)) / reference)
