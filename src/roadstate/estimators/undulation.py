"""A road that changes its slope faster than the prior foresees: humps, bridges' ramps, crests."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

_SPAN = 20.0  # m over which corrections are added up: a hump is no shorter
_MEMORY = 60.0  # m over which the noise grows, or shrinks again, by a factor of e for each σ² too much
_USUAL = 1.5  # σ² up to which no more than chance is seen in a sum
_MOST = 200.0  # σ² that a sum counts for at the most
# logarithm of the most that the variance of the road's noise is multiplied by: streets that bend up or down
# by a quarter within ten metres, 20 times what is usual
_ROUGHEST = 6.0


class Undulation(NamedTuple):
    """How much faster than foreseen the road has been changing its slope.

    If all is as a Kalman filter assumes, its corrections of dθ/ds are independent of one another and of mean
    0, and the variance of each is what it takes off the state's variance (K S Kᵀ = P⁻ − P⁺). On a road that
    bends up and down faster than the filter foresees they lag: they point the same way for as long as a hump
    lasts. So the square of their sum over a short way, over the sum of their variances, is 1 on average for a
    road like the prior's, far less on a level one, and many times that on humps; the variance of the road's
    noise grows exponentially with what is too much. That raises the variances in turn, until they fit. It
    never is less than the prior's: after a level stretch, any hill may come.

    Attributes:
        total: sum of the corrections of g dθ/ds, fading with the way, (m/s²)/m.
        variance: of that, were the road as foreseen.
        excess: logarithm of what the variance of the road's noise is multiplied by.
    """

    total: Float[Array, ""]
    variance: Float[Array, ""]
    excess: Float[Array, ""]

    @classmethod
    def none(cls) -> Undulation:
        """Before the first sample: the road is as the prior has it."""
        zero = jnp.zeros(())
        return cls(zero, zero, zero)

    @property
    def scale(self) -> Float[Array, ""]:
        """What the road's noise is multiplied by."""
        return jnp.exp(0.5 * self.excess)

    def take(
        self, correction: Float[Array, ""], variance: Float[Array, ""], distance: Float[Array, ""]
    ) -> Undulation:
        """What one more correction says.

        Args:
            correction: of g dθ/ds, (m/s²)/m.
            variance: by which it has reduced the state's.
            distance: driven since the last one, m, not negative.
        """
        fades = jnp.exp(-distance / _SPAN)
        total = fades * self.total + correction
        foreseen = fades**2 * self.variance + variance
        share = total**2 / jnp.where(foreseen > 0, foreseen, jnp.inf)
        grows = -jnp.expm1(-distance / _MEMORY) * (jnp.minimum(share, _MOST) - _USUAL)
        return Undulation(total, foreseen, jnp.clip(self.excess + grows, 0.0, _ROUGHEST))
