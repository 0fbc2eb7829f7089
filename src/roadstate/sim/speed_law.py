"""What acceleration a driver asks for to hold a speed."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

Number = Float[Array, ""] | float


class SpeedLaw(NamedTuple):
    """Feed-forward and a PI law: a = a_plan + k (v_plan − v) + ∫ k_I (v_plan − v) dt.

    Attributes:
        gain: k, 1/s.
        integral_gain: k_I, 1/s².
        windup: largest value of the integral, m/s².
    """

    gain: float = 2.0
    integral_gain: float = 0.8
    windup: float = 5.0

    def asked(self, integral: Number, speed: Number, target: Number, target_accel: Number) -> Any:
        """Acceleration, m/s².

        Args:
            integral: the state, m/s².
            speed: of the car, m/s.
            target: planned speed, m/s.
            target_accel: its derivative, m/s².
        """
        return target_accel + self.gain * (target - speed) + integral

    def advance(
        self, integral: Number, speed: Number, target: Number, frozen: Bool[Array, ""], dt: float
    ) -> Any:
        """The integral ``dt`` seconds later; kept while ``frozen``: what is asked for does not happen."""
        moved = jnp.clip(integral + self.integral_gain * (target - speed) * dt, -self.windup, self.windup)
        return jnp.where(frozen, integral, moved)
