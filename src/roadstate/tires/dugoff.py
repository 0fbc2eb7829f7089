"""Dugoff's tire: two stiffnesses and one friction."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import ArrayLike

from roadstate.tires.base import ElasticTire, TireForce
from roadstate.tires.slip import theoretical_from_practical
from roadstate.tires.smooth import Numbers, safe_hypot

# Force of an ideal adhesive tire (N) below which the friction limit is not looked at.
_TINY_FORCE = 1e-6


def saturation(ratio: Numbers) -> Numbers:
    """Dugoff's f(λ) = λ(2 − λ) for λ < 1, else 1 (C¹)."""
    limited = jnp.minimum(ratio, 1.0)
    return limited * (2 - limited)


def limit(F_x: Numbers, F_y: Numbers, capacity: Numbers) -> tuple[Numbers, Numbers]:
    """(F_x, F_y)·f(λ) with λ = capacity/(2√(F_x² + F_y²)), N: an adhesive force kept within a capacity."""
    factor = saturation(capacity / (2 * jnp.maximum(safe_hypot(F_x, F_y), _TINY_FORCE)))
    return F_x * factor, F_y * factor


class Dugoff(ElasticTire):
    """F_x = C_κ σ_x f(λ), F_y = C_α σ_y f(λ), λ = μF_z/(2√((C_κσ_x)² + (C_ασ_y)²)).

    (Dugoff, Fancher & Segel, SAE 700377, 1970, with the factors 1 + κ inside the theoretical slips, which
    makes driving and braking symmetric.) Below half of the limit the force does not depend on μ at all. A
    fully sliding tire whose stiffnesses differ pulls along (C_κσ_x, C_ασ_y), not against the sliding
    velocity: a trait of the model; with equal stiffnesses it opposes the sliding.

    Attributes as :class:`ElasticTire`.
    """

    name = "dugoff"
    summary = "Dugoff: linear up to half the friction limit, then saturating"

    def forces(
        self, slip: ArrayLike, slip_angle: ArrayLike, load: ArrayLike, friction: ArrayLike, speed: ArrayLike
    ) -> TireForce:
        """As :meth:`TireModel.forces`; of the speed only the sign counts."""
        kappa, alpha, F_z, mu, v = jnp.broadcast_arrays(slip, slip_angle, load, friction, speed)
        sigma = theoretical_from_practical(kappa, alpha, v)
        C_kappa, C_alpha = self.stiffnesses(F_z)
        return TireForce(*limit(C_kappa * sigma.x, C_alpha * sigma.y, mu * jnp.maximum(F_z, 0)))
