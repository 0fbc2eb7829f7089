"""Linear tire: for tests, and to see what small slips alone can tell."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import ArrayLike

from roadstate.tires.base import ElasticTire, TireForce, parameter
from roadstate.tires.smooth import Numbers


class Linear(ElasticTire):
    """F_x = C_κ κ, F_y = C_α α, whatever the friction.

    Attributes as :class:`ElasticTire`, but stiffness is proportional to load unless told otherwise.
    """

    name = "linear"
    summary = "force proportional to slip, no friction limit"
    within_friction_circle = False

    slip_load_exponent: Numbers = parameter(1.0)
    cornering_load_exponent: Numbers = parameter(1.0)

    def forces(
        self, slip: ArrayLike, slip_angle: ArrayLike, load: ArrayLike, friction: ArrayLike, speed: ArrayLike
    ) -> TireForce:
        """As :meth:`TireModel.forces`; friction and speed have no effect."""
        kappa, alpha, F_z, _, _ = jnp.broadcast_arrays(slip, slip_angle, load, friction, speed)
        C_kappa, C_alpha = self.stiffnesses(F_z)
        carries = F_z > 0
        return TireForce(jnp.where(carries, C_kappa * kappa, 0.0), jnp.where(carries, C_alpha * alpha, 0.0))
