"""How much a road shakes the body, from accelerometers: what parts forces from their low-passed values."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

_MEAN_TIME = 0.05  # s, of each low pass: what lasts longer moves the car
_MEMORY = 1.0  # s over which squares are averaged
_STEADY = 60.0  # s for which a sensor's noise stays the same
_LEAST = 1.3  # by which their mean exceeds the least of averages over a second
_USUAL = 0.571  # share of a white noise's variance that the deviations have at 100 Hz
_LEAST_STEP, _LONGEST_STEP = 1e-3, 0.3  # s
_NOTHING = 1e-6  # in place of 0, at which roots have no derivative


class Shaking(NamedTuple):
    """Of k signals, each (k,).

    Unevenness shakes a body at 1 to 15 Hz, a driver moves it at 1 Hz and less, if by far more: so what counts
    is the deviation from a low pass, and of that the deviation from another. A sensor's noise is white. Of
    white noise of variance R, sampled every Δ, low passes that keep b = e^(−Δ/τ) of what they hold leave
    R b⁴ (6 + 2b)/(1 + b)³, and the difference of two samples has 2R; so noise is told by the differences and
    taken off the deviations, however large it is. Shaking makes samples differ, too, the more the rarer they
    come; but a sensor's noise stays as it is, and where the road is smooth, or the car slow, it is all there
    is: the least that the differences were of late counts.

    Attributes:
        last: latest sample.
        mean: low-passed samples.
        steady: low-passed deviations from that.
        apart: mean square of what deviates from both, over what white noise would have of its own.
        seems: half of that of the differences.
        noise: what of both a sensor's noise is.
        heard: s of samples so far.
    """

    last: Float[Array, " k"]
    mean: Float[Array, " k"]
    steady: Float[Array, " k"]
    apart: Float[Array, " k"]
    seems: Float[Array, " k"]
    noise: Float[Array, " k"]
    heard: Float[Array, " k"]

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
        since = jnp.clip(since, _LEAST_STEP, _LONGEST_STEP)
        keeps = jnp.exp(-since / _MEAN_TIME)
        share = jnp.where(is_fresh, jnp.where(first, 1.0, 1 - keeps), 0.0)
        mean = self.mean + share * (value - self.mean)
        steady = self.steady + share * (value - mean - self.steady)
        counts = is_fresh & ~first
        heard = self.heard + jnp.where(counts, since, 0.0)
        passes = keeps**4 * (6 + 2 * keeps) / (1 + keeps) ** 3
        span = jnp.where(counts, since, 0.0)
        pace = span / jnp.clip(heard, since, _MEMORY)
        seems = self.seems + pace * (0.5 * (value - self.last) ** 2 - self.seems)
        grown = self.noise + span / _STEADY * (seems - self.noise)
        return Shaking(
            last=jnp.where(is_fresh, value, self.last),
            mean=mean,
            steady=steady,
            apart=self.apart + pace * ((value - mean - steady) ** 2 / passes - self.apart),
            seems=seems,
            noise=jnp.where(heard < _MEMORY, seems, jnp.minimum(seems, grown)),
            heard=heard,
        )

    @property
    def size(self) -> Float[Array, " k"]:
        """Root mean square of what is no noise, in the signals' unit."""
        return jnp.sqrt(jnp.maximum(_USUAL * (self.apart - _LEAST * self.noise), _NOTHING**2))
