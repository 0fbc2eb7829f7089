"""Pure slip of the standard Magic Formula (Pacejka, *Tire and Vehicle Dynamics*, 3rd ed., §4.3.2).

Numbers such as (4.E9) are the book's. Inside here the book's axes hold (ISO-W: a positive slip angle gives a
*negative* lateral force); :mod:`roadstate.tires.magic_formula` turns the sign. Turn slip is not modelled:
every ζ is 1. MF 5.2 and PAC2002 differ from 6.1 in that they take angles as they are (not tan α, sin γ), in
where camber enters S_Hy and S_Vy, and in having no digressive friction in the vertical shifts.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import jax.numpy as jnp

from roadstate.tires.smooth import Numbers, bounded_tan

Coefficients = Mapping[str, Numbers]

# A load (over the nominal) and a friction factor under which the shape of the curves no longer changes: the
# force then falls in proportion, which is also the limit, without ever dividing by zero.
LOWEST_LOAD_RATIO = 1e-4
LOWEST_FRICTION = 1e-3
# What a polynomial in load may at worst leave of the friction, far beyond the loads it was fitted on.
_LOWEST_LOAD_FACTOR = 0.05
# A_μ of (4.E8)
_DIGRESSION = 10.0


class Operating(NamedTuple):
    """Where the tire works, in the book's axes, with what several formulas share.

    Attributes:
        kappa: practical slip.
        alpha: α* (6.1: tan α; else α, rad), ISO sign.
        gamma: γ* (6.1: sin γ; else γ, rad).
        load: F_z, N, kept off zero; :class:`Operating` forces are scaled back by ``carried``.
        carried: true load over ``load``.
        dfz: normalised change of load (4.E2).
        dpi: normalised change of pressure (4.E2b).
        friction_x, friction_y: λ*_μ, what the file's friction is multiplied by.
        low_speed: 0 at standstill to 1 from VXLOW on: ply steer needs rolling.
        cos_alpha: cos'α (4.E6).
        speed: |v_x|, m/s.
    """

    kappa: Numbers
    alpha: Numbers
    gamma: Numbers
    load: Numbers
    carried: Numbers
    dfz: Numbers
    dpi: Numbers
    friction_x: Numbers
    friction_y: Numbers
    low_speed: Numbers
    cos_alpha: Numbers
    speed: Numbers


class Pure(NamedTuple):
    """The factors of F₀ = D sin{C arctan[Bx − E(Bx − arctan Bx)]} + S_V, x = slip + S_H."""

    x: Numbers
    B: Numbers
    C: Numbers
    D: Numbers
    E: Numbers
    K: Numbers
    S_H: Numbers
    S_V: Numbers

    def without_shift(self) -> Numbers:
        """F₀ − S_V, N."""
        return self.D * jnp.sin(self.C * jnp.arctan(bent(self.B * self.x, self.E)))

    def force(self) -> Numbers:
        """F₀, N."""
        return self.without_shift() + self.S_V


def bent(x: Numbers, E: Numbers) -> Numbers:
    """x − E(x − arctan x)."""
    return x - E * (x - jnp.arctan(x))


def operate(
    c: Coefficients,
    *,
    is_61: bool,
    slip: Numbers,
    alpha: Numbers,
    camber: Numbers,
    load: Numbers,
    pressure: Numbers,
    friction: tuple[Numbers, Numbers],
    speed: Numbers,
) -> Operating:
    """Assemble :class:`Operating`: ``alpha``, ``camber`` in rad with ISO signs, ``friction`` as factors."""
    nominal = c["LFZO"] * c["FNOMIN"]
    kept = jnp.maximum(load, LOWEST_LOAD_RATIO * nominal)
    rolling = jnp.minimum(jnp.abs(speed) / c["VXLOW"], 1.0)
    return Operating(
        kappa=slip,
        alpha=bounded_tan(alpha) if is_61 else alpha,
        gamma=jnp.sin(camber) if is_61 else camber,
        load=kept,
        carried=jnp.maximum(load, 0) / kept,
        dfz=kept / nominal - 1,
        dpi=pressure / c["NOMPRES"] - 1,
        friction_x=friction[0],
        friction_y=friction[1],
        low_speed=0.5 * (1 - jnp.cos(jnp.pi * rolling)),
        cos_alpha=jnp.cos(alpha),
        speed=jnp.abs(speed),
    )


def _friction(first: Numbers, second: Numbers, dfz: Numbers) -> Numbers:
    # |p_D1 + p_D2 dfz|; older files give the lateral peak a negative sign, which B then undoes
    return jnp.abs(first) * jnp.maximum(1 + second / first * dfz, _LOWEST_LOAD_FACTOR)


def _shift_friction(factor: Numbers, is_61: bool) -> Numbers:
    # λ'_μ (4.E8)
    return _DIGRESSION * factor / (1 + (_DIGRESSION - 1) * factor) if is_61 else factor


def longitudinal(c: Coefficients, o: Operating, is_61: bool) -> Pure:
    """F_x0's factors (4.E9–4.E18)."""
    gamma = o.gamma if is_61 else o.gamma * c["LGAX"]
    S_H = (c["PHX1"] + c["PHX2"] * o.dfz) * c["LHX"] * o.low_speed
    x = o.kappa + S_H
    peak = (
        _friction(c["PDX1"], c["PDX2"], o.dfz)
        * (1 + c["PPX3"] * o.dpi + c["PPX4"] * o.dpi**2)
        * (1 - c["PDX3"] * gamma**2)
        * o.load
    )
    C = c["PCX1"] * c["LCX"]
    E = (c["PEX1"] + c["PEX2"] * o.dfz + c["PEX3"] * o.dfz**2) * (1 - c["PEX4"] * jnp.sign(x)) * c["LEX"]
    K = (
        o.load
        * (c["PKX1"] + c["PKX2"] * o.dfz)
        * jnp.exp(c["PKX3"] * o.dfz)
        * (1 + c["PPX1"] * o.dpi + c["PPX2"] * o.dpi**2)
        * c["LKX"]
    )
    S_V = o.load * (c["PVX1"] + c["PVX2"] * o.dfz) * c["LVX"] * _shift_friction(o.friction_x, is_61)
    return Pure(
        x=x,
        B=K / (C * peak * jnp.maximum(o.friction_x, LOWEST_FRICTION)),
        C=C,
        D=peak * o.friction_x,
        E=jnp.minimum(E, 1.0),
        K=K,
        S_H=S_H,
        S_V=S_V * o.low_speed,
    )


def lateral(c: Coefficients, o: Operating, is_61: bool) -> Pure:
    """F_y0's factors (4.E19–4.E30); K is negative in these axes."""
    gamma = o.gamma if is_61 else o.gamma * c["LGAY"]
    nominal = c["LFZO"] * c["FNOMIN"]
    shift_friction = _shift_friction(o.friction_y, is_61)
    knee = (c["PKY2"] + c["PKY5"] * gamma**2) * (1 + c["PPY2"] * o.dpi)
    K = (
        c["PKY1"]
        * nominal
        * (1 + c["PPY1"] * o.dpi)
        * (1 - c["PKY3"] * jnp.abs(gamma))
        * jnp.sin(c["PKY4"] * jnp.arctan(o.load / nominal / knee))
        * c["LKY"]
    )
    S_V_gamma = o.load * (c["PVY3"] + c["PVY4"] * o.dfz) * gamma * shift_friction
    S_H = (c["PHY1"] + c["PHY2"] * o.dfz) * c["LHY"] * o.low_speed
    if is_61:
        S_V_gamma = S_V_gamma * c["LKYC"]
        K_gamma = o.load * (c["PKY6"] + c["PKY7"] * o.dfz) * (1 + c["PPY5"] * o.dpi) * c["LKYC"]
        S_H = S_H + (K_gamma * gamma - S_V_gamma) / K
    else:
        S_H = S_H + c["PHY3"] * gamma
    S_V = o.load * (c["PVY1"] + c["PVY2"] * o.dfz) * c["LVY"] * shift_friction * o.low_speed + S_V_gamma
    x = o.alpha + S_H
    peak = (
        _friction(c["PDY1"], c["PDY2"], o.dfz)
        * (1 + c["PPY3"] * o.dpi + c["PPY4"] * o.dpi**2)
        * (1 - c["PDY3"] * gamma**2)
        * o.load
    )
    C = c["PCY1"] * c["LCY"]
    E = (
        (c["PEY1"] + c["PEY2"] * o.dfz)
        * (1 + c["PEY5"] * gamma**2 - (c["PEY3"] + c["PEY4"] * gamma) * jnp.sign(x))
        * c["LEY"]
    )
    return Pure(
        x=x,
        B=K / (C * peak * jnp.maximum(o.friction_y, LOWEST_FRICTION)),
        C=C,
        D=peak * o.friction_y,
        E=jnp.minimum(E, 1.0),
        K=K,
        S_H=S_H,
        S_V=S_V,
    )
