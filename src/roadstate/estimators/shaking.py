"""How much a road shakes the body, from accelerometers: what parts forces from their low-passed values."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

_MEAN_TIME = 0.05  # s: what lasts longer moves the car
_MEMORY = 1.0  # s over which squares are averaged
_LEAST_STEP = 1e-3  # s
_NOTHING = 1e-6  # in place of 0, at which roots have no derivative


class Shaking(NamedTuple):
    """Of k signals, each (k,).

    Unevenness shakes a body at 1 to 15 Hz, a sensor's noise is white. Of white noise of variance R, sampled
    every Δ, the deviation from a low pass, which takes a = 1 − e^(−Δ/τ) of each sample, has variance
    R (1 − a)² 2/(2 − a), and the difference of two samples 2R; so noise is told by the differences and taken
    off the deviations, however large it is.

    Attributes:
        last: latest sample.
        mean: low-passed samples.
        apart: mean square of the deviations from that.
        noise: and what a sensor's noise has in it.
    """

    last: Float[Array, " k"]
    mean: Float[Array, " k"]
    apart: Float[Array, " k"]
    noise: Float[Array, " k"]

    @classmethod
    def still(cls, count: int) -> Shaking:
        """Nothing has come yet."""
        return cls(*(jnp.zeros(count) for _ in cls._fields))

    def take(
        self,
        value: Float[Array, " k"],
        is_fresh: Bool[Array, " k"],
        first: Bool[Array, " k"],
        since: Float[Array, " k"],
    ) -> Shaking:
        """Take samples.

        Args:
            value: of each signal.
            is_fresh: which of them came just now.
            first: whether nothing is to be remembered: the first sample, or one after a long gap.
            since: s since the last one.
        """
        since = jnp.maximum(since, _LEAST_STEP)
        share = -jnp.expm1(-since / _MEAN_TIME)
        mean = self.mean + jnp.where(is_fresh, jnp.where(first, 1.0, share) * (value - self.mean), 0.0)
        white = 0.5 * (value - self.last) ** 2 * (1 - share) ** 2 * 2 / (2 - share)
        counts = jnp.where(is_fresh & ~first, -jnp.expm1(-since / _MEMORY), 0.0)
        return Shaking(
            last=jnp.where(is_fresh, value, self.last),
            mean=mean,
            apart=self.apart + counts * ((value - mean) ** 2 - self.apart),
            noise=self.noise + counts * (white - self.noise),
        )

    @property
    def size(self) -> Float[Array, " k"]:
        """Root mean square of what is no noise, in the signals' unit."""
        return jnp.sqrt(jnp.maximum(self.apart - self.noise, _NOTHING**2))
