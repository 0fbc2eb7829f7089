"""Moments of the standard Magic Formula (Pacejka, 3rd ed., §4.3.2), in the book's axes (ISO-W)."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from roadstate.tires.mf_combined import Combined
from roadstate.tires.mf_pure import LOWEST_FRICTION, Coefficients, Operating, Pure, bent
from roadstate.tires.smooth import Numbers, safe_hypot


class TireMoments(NamedTuple):
    """Moments of the road on the tire at the contact centre (x forward, y left, z up), N·m, any shape.

    Attributes:
        M_x: overturning.
        M_y: rolling resistance; negative when rolling forwards.
        M_z: self-aligning; negative for a positive slip angle, which it seeks to reduce.
    """

    M_x: Numbers
    M_y: Numbers
    M_z: Numbers


def aligning(
    c: Coefficients,
    o: Operating,
    x: Pure,
    y: Pure,
    combined: Combined,
    upright_force: Numbers,
    is_61: bool,
) -> Numbers:
    """M_z = −t F'_y + M_zr + s F_x (4.E71–4.E78, with the pure-slip factors 4.E31–4.E47), N·m.

    Where the book and Besselink, Schmeitz & Pacejka (Vehicle System Dynamics 48 S1, 2010) differ, the latter
    holds (its coefficients are those in the files): B_t has q_Bz4 γ, D_t has q_Dz3 γ without the bars, and
    D_t and s refer to the unscaled nominal load.

    Args:
        upright_force: F_y0 at zero camber, N; what the trail acts on in 6.1.
    """
    gamma = o.gamma if is_61 else o.gamma * c["LGAZ"]
    arm = o.load * c["UNLOADED_RADIUS"]
    stiffness_factor = c["LKY"] / jnp.maximum(o.friction_y, LOWEST_FRICTION)

    B_t = (
        (c["QBZ1"] + c["QBZ2"] * o.dfz + c["QBZ3"] * o.dfz**2)
        * (1 + c["QBZ4"] * gamma + c["QBZ5"] * jnp.abs(gamma))
        * stiffness_factor
    )
    C_t = c["QCZ1"]
    D_t = (
        arm
        / c["FNOMIN"]
        * (c["QDZ1"] + c["QDZ2"] * o.dfz)
        * (1 - c["PPZ1"] * o.dpi)
        * (1 + c["QDZ3"] * gamma + c["QDZ4"] * gamma**2)
        * c["LTR"]
    )
    alpha_t = o.alpha + c["QHZ1"] + c["QHZ2"] * o.dfz + (c["QHZ3"] + c["QHZ4"] * o.dfz) * gamma
    E_t = (c["QEZ1"] + c["QEZ2"] * o.dfz + c["QEZ3"] * o.dfz**2) * (
        1 + (c["QEZ4"] + c["QEZ5"] * gamma) * (2 / jnp.pi) * jnp.arctan(B_t * C_t * alpha_t)
    )
    # t and M_zr are even in the equivalent angles, so these carry no sign
    share = x.K / y.K * o.kappa
    trail_angle, residual_angle = (
        _equivalent(angle, share, is_61) for angle in (alpha_t, o.alpha + y.S_H + y.S_V / y.K)
    )
    trail = D_t * jnp.cos(C_t * jnp.arctan(bent(B_t * trail_angle, jnp.minimum(E_t, 1.0)))) * o.cos_alpha

    B_r = c["QBZ9"] * stiffness_factor + c["QBZ10"] * y.B * y.C
    D_r = (
        arm
        * (
            (c["QDZ6"] + c["QDZ7"] * o.dfz) * c["LRES"]
            + (
                (c["QDZ8"] + c["QDZ9"] * o.dfz) * (1 + c["PPZ2"] * o.dpi)
                + (c["QDZ10"] + c["QDZ11"] * o.dfz) * jnp.abs(gamma)
            )
            * gamma
            * c["LKZC"]
        )
        * o.friction_y
        * o.cos_alpha
    )
    residual = D_r * jnp.cos(jnp.arctan(B_r * residual_angle))

    offset = (
        c["UNLOADED_RADIUS"]
        * (c["SSZ1"] + c["SSZ2"] * combined.F_y / c["FNOMIN"] + (c["SSZ3"] + c["SSZ4"] * o.dfz) * o.gamma)
        * c["LS"]
    )
    return -trail * combined.weight_y * upright_force + residual + offset * combined.F_x


def _equivalent(angle: Numbers, share: Numbers, is_61: bool) -> Numbers:
    # (4.E77), (4.E78); 5.2 has the angles themselves, hence their tangents under the root
    if is_61:
        return safe_hypot(angle, share)
    return jnp.arctan(safe_hypot(jnp.tan(angle), share))


def overturning(c: Coefficients, o: Operating, F_y: Numbers) -> Numbers:
    """M_x (4.E69), N·m."""
    gamma, load, force = o.gamma, o.load / c["FNOMIN"], F_y / c["FNOMIN"]
    arm = c["UNLOADED_RADIUS"] * c["LMX"]
    first = (
        c["QSX1"] * c["LVMX"]
        - c["QSX2"] * gamma * (1 + c["PPMX1"] * o.dpi)
        - c["QSX12"] * gamma * jnp.abs(gamma)
        + c["QSX3"] * force
        + c["QSX4"]
        * jnp.cos(c["QSX5"] * jnp.arctan((c["QSX6"] * load) ** 2))
        * jnp.sin(c["QSX7"] * gamma + c["QSX8"] * jnp.arctan(c["QSX9"] * force))
        + c["QSX10"] * jnp.arctan(c["QSX11"] * load) * gamma
    )
    return arm * (o.load * first + F_y * (c["QSX13"] + c["QSX14"] * jnp.abs(gamma)))


def rolling(c: Coefficients, o: Operating, F_x: Numbers, pressure: Numbers) -> Numbers:
    """M_y when rolling forwards (4.E70, with F_z0 (F_z/F_z0)^q_sy7 for the load), N·m."""
    speed = o.speed / c["LONGVL"]
    load = o.load / c["FNOMIN"]
    return (
        -c["UNLOADED_RADIUS"]
        * c["FNOMIN"]
        * c["LMY"]
        * (
            c["QSY1"]
            + c["QSY2"] * F_x / c["FNOMIN"]
            + c["QSY3"] * speed
            + c["QSY4"] * speed**4
            + (c["QSY5"] + c["QSY6"] * load) * o.gamma**2
        )
        * load ** c["QSY7"]
        * (pressure / c["NOMPRES"]) ** c["QSY8"]
        * jnp.minimum(o.speed / c["VXLOW"], 1.0)
    )
