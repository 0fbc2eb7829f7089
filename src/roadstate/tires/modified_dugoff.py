"""Dugoff's tire with a friction that falls as the contact slides faster."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import ArrayLike

from roadstate.tires.base import ElasticTire, Fit, TireForce, parameter
from roadstate.tires.dugoff import limit
from roadstate.tires.slip import bounded_from_practical, theoretical_from_practical
from roadstate.tires.smooth import Numbers, bounded_tan, safe_hypot


class ModifiedDugoff(ElasticTire):
    """Dugoff with λ multiplied by 1 − ε_r v √(s² + tan²α), s the papers' bounded slip (after Wu, 2008).

    Attributes as :class:`ElasticTire`, and:
        speed_influence: ε_r, s/m.
        lowest_factor: the factor on λ is bounded to this from below; above zero, so that a fast slide keeps
            some friction.
    """

    name = "modified_dugoff"
    summary = "Dugoff whose friction falls with sliding speed"
    fitted: ClassVar[Mapping[str, Fit]] = {**ElasticTire.fitted, "speed_influence": "not_negative"}

    speed_influence: Numbers = parameter(0.015)
    lowest_factor: Numbers = parameter(0.1)

    def forces(
        self, slip: ArrayLike, slip_angle: ArrayLike, load: ArrayLike, friction: ArrayLike, speed: ArrayLike
    ) -> TireForce:
        """As :meth:`TireModel.forces`."""
        kappa, alpha, F_z, mu, v = jnp.broadcast_arrays(slip, slip_angle, load, friction, speed)
        sliding = safe_hypot(bounded_from_practical(kappa, alpha, v).x, bounded_tan(alpha))
        factor = jnp.maximum(1 - self.speed_influence * jnp.abs(v) * sliding, self.lowest_factor)
        sigma = theoretical_from_practical(kappa, alpha, v)
        C_kappa, C_alpha = self.stiffnesses(F_z)
        return TireForce(*limit(C_kappa * sigma.x, C_alpha * sigma.y, factor * mu * jnp.maximum(F_z, 0)))
