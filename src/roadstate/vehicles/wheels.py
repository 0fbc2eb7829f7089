"""The spin of the wheels."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import ArrayLike

from roadstate.tires.smooth import Numbers
from roadstate.vehicles.model import soft_sign


class Spin(NamedTuple):
    """What turns the wheels, (4,) each, rad/s².

    Attributes:
        accel: ω̇.
        dry: deceleration by brake and rolling resistance while the wheel turns; inside ``accel`` it carries
            the wheel's soft sign.
    """

    accel: Numbers
    dry: Numbers


def spin(
    wheel_speed: Numbers,
    drive_torque: Numbers,
    brake_torque: Numbers,
    F_x: Numbers,
    rolling_moment: Numbers,
    radius: Numbers,
    inertia: Numbers,
) -> Spin:
    """I_w ω̇ = T_drive − R_w F_x − (T_brake + M_roll)·sgn(ω); all (4,).

    Args:
        wheel_speed: ω, rad/s.
        drive_torque, brake_torque: N·m; a brake torque is a magnitude.
        F_x: tire force in the wheel's frame, N.
        rolling_moment: M_roll, N·m, a magnitude.
        radius: R_w, m.
        inertia: I_w, kg·m².
    """
    dry = (brake_torque + rolling_moment) / inertia
    return Spin((drive_torque - radius * F_x) / inertia - dry * soft_sign(wheel_speed), dry)


def split_torque(total: ArrayLike, split: ArrayLike) -> Numbers:
    """(..., 4) drive torque of each wheel from the sum over all wheels.

    Args:
        total: (...), N·m at the wheels.
        split: (4,) share of each wheel: (½, ½, 0, 0) is front drive with an open differential.
    """
    return jnp.asarray(total)[..., None] * jnp.asarray(split)
