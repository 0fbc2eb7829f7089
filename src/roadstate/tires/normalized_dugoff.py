"""The papers' Dugoff tire, linear in friction: F = μ·F⁰."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import ArrayLike

from roadstate.tires.base import Fit, TireForce, TireModel, parameter
from roadstate.tires.dugoff import saturation
from roadstate.tires.slip import bounded_from_practical, theoretical_from_practical, travel_direction
from roadstate.tires.smooth import Numbers, bounded_tan, safe_hypot, soft_abs

# 2√(c²σ²) below which the tire is far from its limit whatever else holds.
_TINY = 1e-9
# |1 + s| of a locking wheel, as in the theoretical slips.
_LOCKED = 1e-3


class NormalizedDugoff(TireModel):
    """F = μ F⁰ with F⁰_x = F_z c_x σ_x f(L), F⁰_y = F_z c_y σ_y f(L), L = 1/(2√(c_x²σ_x² + c_y²σ_y²)).

    It takes for granted that the slip stiffness scales with friction, which real tires' does not: filters
    become linear in μ at the price of a bias.

    Attributes:
        slip_stiffness: c_x, force per slip, load and friction, dimensionless.
        cornering_stiffness: c_y, force per slip angle, load and friction, 1/rad.
        as_printed: use the papers' own form, c_x s/(1 + s), c_y tan α/(1 + s) and (1 − |s|) in L, with their
            bounded slip s (positive when driving): the same when braking, another curve when driving.
    """

    name = "normalized_dugoff"
    summary = "the papers' Dugoff, force proportional to friction"
    fitted: ClassVar[Mapping[str, Fit]] = {"slip_stiffness": "positive", "cornering_stiffness": "positive"}

    slip_stiffness: Numbers = parameter(22.0)
    cornering_stiffness: Numbers = parameter(13.0)
    as_printed: bool = eqx.field(default=False, static=True)

    def normalized_forces(
        self, slip: ArrayLike, slip_angle: ArrayLike, load: ArrayLike, speed: ArrayLike = 1.0
    ) -> TireForce:
        """F⁰, N: the force at μ = 1; arguments as :meth:`TireModel.forces`."""
        kappa, alpha, F_z, v = jnp.broadcast_arrays(slip, slip_angle, load, speed)
        if self.as_printed:
            s, tangent = bounded_from_practical(kappa, alpha, v).x, bounded_tan(alpha)
            rolling = soft_abs(1 + travel_direction(v) * s, _LOCKED)
            x, y = self.slip_stiffness * s / rolling, self.cornering_stiffness * tangent / rolling
            total = safe_hypot(self.slip_stiffness * s, self.cornering_stiffness * tangent)
            ratio = soft_abs(1 - jnp.abs(s), _LOCKED) / (2 * jnp.maximum(total, _TINY))
        else:
            sigma = theoretical_from_practical(kappa, alpha, v)
            x, y = self.slip_stiffness * sigma.x, self.cornering_stiffness * sigma.y
            ratio = 1 / (2 * jnp.maximum(safe_hypot(x, y), _TINY))
        carried = jnp.maximum(F_z, 0) * saturation(ratio)
        return TireForce(carried * x, carried * y)

    def forces(
        self, slip: ArrayLike, slip_angle: ArrayLike, load: ArrayLike, friction: ArrayLike, speed: ArrayLike
    ) -> TireForce:
        """As :meth:`TireModel.forces`; of the speed only the sign counts."""
        kappa, alpha, F_z, mu, v = jnp.broadcast_arrays(slip, slip_angle, load, friction, speed)
        F_x, F_y = self.normalized_forces(kappa, alpha, F_z, v)
        return TireForce(mu * F_x, mu * F_y)
