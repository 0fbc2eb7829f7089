"""Brush tire: bristles that stick first and slide behind."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import ArrayLike

from roadstate.tires.base import ElasticTire, TireForce
from roadstate.tires.slip import theoretical_from_practical
from roadstate.tires.smooth import safe_hypot

# Capacity (N) and slip under which the contact is taken as carrying nothing, or not slipping.
_TINY = 1e-6


class Brush(ElasticTire):
    """Bristles on a parabolic contact pressure (Fiala, 1954; Pacejka, 3rd ed., §3.2).

    With the slip vector σ and ψ = √((C_κσ_x)² + (C_ασ_y)²)/(3μF_z), the sliding share of the contact: the
    bristles that stick carry (C_κσ_x, C_ασ_y)(1 − ψ)², those that slide carry μF_z ψ²(3 − 2ψ) against the
    sliding velocity; from ψ = 1 on all slide. With equal stiffnesses this is the textbook's
    μF_z(3ψ − 3ψ² + ψ³). The force bends at once, so μ shows earlier than with Dugoff.

    Attributes as :class:`ElasticTire`; give both stiffnesses the same value for an isotropic tread.
    """

    name = "brush"
    summary = "brush (Fiala), parabolic contact pressure"

    def forces(
        self, slip: ArrayLike, slip_angle: ArrayLike, load: ArrayLike, friction: ArrayLike, speed: ArrayLike
    ) -> TireForce:
        """As :meth:`TireModel.forces`; of the speed only the sign counts."""
        kappa, alpha, F_z, mu, v = jnp.broadcast_arrays(slip, slip_angle, load, friction, speed)
        sigma = theoretical_from_practical(kappa, alpha, v)
        C_kappa, C_alpha = self.stiffnesses(F_z)
        capacity = mu * jnp.maximum(F_z, 0)
        x, y = C_kappa * sigma.x, C_alpha * sigma.y
        psi = jnp.minimum(safe_hypot(x, y) / (3 * jnp.maximum(capacity, _TINY)), 1.0)
        sticking = jnp.where(capacity > _TINY, (1 - psi) ** 2, 0.0)
        sliding = capacity * psi**2 * (3 - 2 * psi) / jnp.maximum(safe_hypot(sigma.x, sigma.y), _TINY)
        return TireForce(sticking * x + sliding * sigma.x, sticking * y + sliding * sigma.y)
