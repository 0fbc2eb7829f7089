"""Magic Formula with four factors a direction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import ArrayLike

from roadstate.tires.base import Fit, TireForce, TireModel, parameter
from roadstate.tires.slip import bounded_from_practical, theoretical_from_practical
from roadstate.tires.smooth import Numbers, safe_hypot

# Slip under which a force over its slip is taken as the slope at zero (their difference is of second order).
_TINY_SLIP = 1e-5
_LOWEST_FRICTION = 1e-3


def magic(x: Numbers, B: Numbers, C: Numbers, E: Numbers) -> Numbers:
    """sin{C arctan[Bx − E(Bx − arctan Bx)]}."""
    Bx = B * x
    return jnp.sin(C * jnp.arctan(Bx - E * (Bx - jnp.arctan(Bx))))


class MagicFormulaSimple(TireModel):
    """F₀ = D sin{C arctan[Bx − E(Bx − arctan Bx)]} with D = μ F_z d, combined by similarity.

    (Pacejka & Bakker, *The Magic Formula Tyre Model*, 1992.) In pure slip x is the papers' bounded slip s or
    the slip angle α. In combined slip the components share out as (σ_x, σ_y) does, each taken at the whole
    slip: F_x = (σ_x/σ) F_x0(s_tot), F_y = (σ_y/σ) F_y0(arctan s_tot), s_tot = √(κ² + tan²α)/max(1, |1 + κ|).
    So the force of small slips is linear in them.

    Attributes:
        B_x: stiffness factor at μ = 1.
        C_x: shape factor.
        E_x: curvature factor, ≤ 1.
        d_x: peak over μ F_z; 1 unless the tire's grip differs between the directions.
        B_y, C_y, E_y, d_y: the same for the lateral force, B_y in 1/rad.
        stiffness_scales_with_friction: keep B, so that the slip stiffness BCD grows with μ, as the formula is
            written; otherwise B is divided by μ and the stiffness stays, as a real tire's does.
        as_printed: combine as a paper prints it, F_x = (|σ_x|/σ) F_x0(s), F_y = (|σ_y|/σ) F_y0(α) (without
            the bars, as it stands there, the force of braking would point forward): the force of a small
            combined slip then falls short, and has no slope at zero slip.
    """

    name = "magic_formula_simple"
    summary = "Magic Formula by B, C, D, E with similarity for combined slip"
    fitted: ClassVar[Mapping[str, Fit]] = {
        "B_x": "positive",
        "C_x": "positive",
        "E_x": "free",
        "d_x": "positive",
        "B_y": "positive",
        "C_y": "positive",
        "E_y": "free",
        "d_y": "positive",
    }
    # d may exceed 1
    within_friction_circle = False

    B_x: Numbers = parameter(13.5)
    C_x: Numbers = parameter(1.6)
    E_x: Numbers = parameter(0.1)
    d_x: Numbers = parameter(1.0)
    B_y: Numbers = parameter(10.0)
    C_y: Numbers = parameter(1.35)
    E_y: Numbers = parameter(-0.8)
    d_y: Numbers = parameter(1.0)
    stiffness_scales_with_friction: bool = eqx.field(default=False, static=True)
    as_printed: bool = eqx.field(default=False, static=True)

    def forces(
        self, slip: ArrayLike, slip_angle: ArrayLike, load: ArrayLike, friction: ArrayLike, speed: ArrayLike
    ) -> TireForce:
        """As :meth:`TireModel.forces`; of the speed only the sign counts."""
        kappa, alpha, F_z, mu, v = jnp.broadcast_arrays(slip, slip_angle, load, friction, speed)
        if self.stiffness_scales_with_friction:
            B_x, B_y = self.B_x, self.B_y
        else:
            reference = jnp.maximum(mu, _LOWEST_FRICTION)
            B_x, B_y = self.B_x / reference, self.B_y / reference
        capacity = mu * jnp.maximum(F_z, 0)
        D_x, D_y = capacity * self.d_x, capacity * self.d_y
        bounded = bounded_from_practical(kappa, alpha, v)
        if self.as_printed:
            sigma = theoretical_from_practical(kappa, alpha, v)
            total = jnp.maximum(safe_hypot(sigma.x, sigma.y), _TINY_SLIP)
            return TireForce(
                D_x * magic(bounded.x, B_x, self.C_x, self.E_x) * jnp.abs(sigma.x) / total,
                D_y * magic(alpha, B_y, self.C_y, self.E_y) * jnp.abs(sigma.y) / total,
            )
        total = jnp.maximum(safe_hypot(bounded.x, bounded.y), _TINY_SLIP)
        return TireForce(
            D_x * magic(total, B_x, self.C_x, self.E_x) * bounded.x / total,
            D_y * magic(jnp.arctan(total), B_y, self.C_y, self.E_y) * bounded.y / total,
        )
