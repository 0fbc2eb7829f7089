"""Brakes that no channel tells of, as the filter sees them: less pushes the car than it foresees."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

_LATELY = 0.05  # s: filter of what is missing
_LEAST = 0.15  # m/s² that has to be missing
_SURE = 3.0  # of its own 1σ by which what the filter foresees may be off


class Shortfall(NamedTuple):
    """Of specific force, against what the drive's torque and all that has been learnt foresee.

    It judges the next sample, not those that have made it: white noise that is muted so has no mean.

    Attributes:
        lately: m/s², low-passed, in the direction of travel; brakes make it negative.
        is_brake: whether it is so large that it must be a brake's.
    """

    lately: Float[Array, ""]
    is_brake: Bool[Array, ""]

    @classmethod
    def none(cls) -> Shortfall:
        """Before the first sample."""
        return cls(jnp.zeros(()), jnp.zeros((), bool))

    def take(
        self,
        innovation: Float[Array, ""],
        std: Float[Array, ""],
        forward: Float[Array, ""],
        dt: Float[Array, ""],
    ) -> Shortfall:
        """A sample later.

        Args:
            innovation: how much more an accelerometer reads than foreseen, m/s²; NaN where it reads nothing.
            std: 1σ of what is foreseen, m/s².
            forward: −1 where the car backs up, else 1.
            dt: s.
        """
        now = jnp.where(jnp.isfinite(innovation), forward * innovation, self.lately)
        lately = self.lately - jnp.expm1(-dt / _LATELY) * (now - self.lately)
        return Shortfall(lately, lately < -jnp.maximum(_LEAST, _SURE * std))
