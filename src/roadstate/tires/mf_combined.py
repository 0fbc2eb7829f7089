"""Combined slip of the standard Magic Formula (Pacejka, 3rd ed., §4.3.2), in the book's axes."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import ArrayLike

from roadstate.tires.mf_pure import LOWEST_FRICTION, Coefficients, Operating, Pure, bent
from roadstate.tires.smooth import Numbers, bounded_tan, safe_hypot

# Slip under which a force over its slip is taken as its slope at zero.
_TINY_SLIP = 1e-4
# Share of the peaks up to which a bounded force is unchanged.
_KNEE = 0.97


class Combined(NamedTuple):
    """Forces in combined slip, N.

    Attributes:
        F_x: (4.E50).
        F_y: (4.E58).
        weight_y: G_yκ, what is left of the pure lateral force.
    """

    F_x: Numbers
    F_y: Numbers
    weight_y: Numbers


def weighted(c: Coefficients, o: Operating, x: Pure, y: Pure) -> Combined:
    """The cosine weighting functions (4.E50–4.E67)."""
    B_x = (c["RBX1"] + c["RBX3"] * o.gamma**2) * _cos_arctan(c["RBX2"] * o.kappa) * c["LXAL"]
    E_x = jnp.minimum(c["REX1"] + c["REX2"] * o.dfz, 1.0)
    weight_x = _weight(o.alpha, c["RHX1"], B_x, c["RCX1"], E_x)

    B_y = (c["RBY1"] + c["RBY4"] * o.gamma**2) * _cos_arctan(c["RBY2"] * (o.alpha - c["RBY3"])) * c["LYKA"]
    E_y = jnp.minimum(c["REY1"] + c["REY2"] * o.dfz, 1.0)
    weight_y = _weight(o.kappa, c["RHY1"] + c["RHY2"] * o.dfz, B_y, c["RCY1"], E_y)
    D_kappa = y.D * (c["RVY1"] + c["RVY2"] * o.dfz + c["RVY3"] * o.gamma) * _cos_arctan(c["RVY4"] * o.alpha)
    S_V_kappa = D_kappa * jnp.sin(c["RVY5"] * jnp.arctan(c["RVY6"] * o.kappa)) * c["LVYKA"]
    return Combined(weight_x * x.force(), weight_y * y.force() + S_V_kappa * o.low_speed, weight_y)


def on_ellipse(o: Operating, x: Pure, y: Pure, is_61: bool) -> Combined:
    """The friction ellipse, for files without the coefficients of :func:`weighted`.

    G_x = D_y/√(D_y² + (F_x0/κ · tan α)²), G_y = D_x/√(D_x² + (F_y0/tan α · κ)²): what the friction-ellipse
    method of PAC2002 says with β = arccos(|κ|/√(κ² + sin²α)), written with secant slopes so that it has no
    singular point. Taken with the tangent instead of the sine, a locked wheel is pulled against its sliding;
    and the direction is without S_V/K, so that it is that of the forces it combines.
    """
    tangent = y.x if is_61 else bounded_tan(y.x)
    secant_x, secant_y = _secant(x, x.x), _secant(y, tangent)
    weight_x = y.D / jnp.sqrt(_positive(y.D**2 + (secant_x * tangent) ** 2))
    weight_y = x.D / jnp.sqrt(_positive(x.D**2 + (secant_y * x.x) ** 2))
    return Combined(weight_x * x.force(), weight_y * y.force(), weight_y)


def within_circle(o: Operating, x: Pure, y: Pure, combined: Combined) -> Combined:
    """The combined force kept within the ellipse of both pure peaks, without their vertical shifts.

    Camber thrust, ply steer and conicity hardly fall with friction in the standard's formulas (λ'_μ of 4.E8
    is 0.53 where λ_μ is 0.1), and cosine weighting knows no bound: on ice the sum would exceed what the road
    has.
    Up to 97 % of the peaks the force stays as it is; beyond, it approaches them, its direction kept.
    """
    least = LOWEST_FRICTION * o.load
    peak_x, peak_y = (jnp.maximum(jnp.abs(p.D) * highest(p.C), least) for p in (x, y))
    used = safe_hypot(combined.F_x / peak_x, combined.F_y / peak_y)
    rest = 1 - _KNEE
    kept = _KNEE + rest * jnp.tanh(jnp.maximum(used - _KNEE, 0) / rest)
    share = kept / jnp.maximum(used, _KNEE)
    share = jnp.where(used > _KNEE, share, 1.0)
    return Combined(share * combined.F_x, share * combined.F_y, combined.weight_y)


def highest(C: ArrayLike) -> Numbers:
    """The most that sin(C arctan ·) reaches: 1, or sin(Cπ/2) where C < 1."""
    return jnp.sin(jnp.minimum(C, 1.0) * (jnp.pi / 2))


def _cos_arctan(x: Numbers) -> Numbers:
    return 1 / jnp.sqrt(1 + x * x)


def _weight(slip: Numbers, shift: Numbers, B: Numbers, C: Numbers, E: Numbers) -> Numbers:
    # G = cos(C arctan …(slip + S_H)) / cos(C arctan …(S_H)), 1 at zero slip
    def hill(s: Numbers) -> Numbers:
        return jnp.cos(C * jnp.arctan(bent(B * s, E)))

    return hill(slip + shift) / hill(shift)


def _secant(pure: Pure, slip: Numbers) -> Numbers:
    near = jnp.abs(slip) < _TINY_SLIP
    return jnp.where(near, pure.B * pure.C * pure.D, pure.without_shift() / jnp.where(near, 1.0, slip))


def _positive(square: Numbers) -> Numbers:
    return jnp.maximum(square, 1e-12)
