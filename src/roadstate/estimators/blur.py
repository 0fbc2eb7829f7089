"""What a low pass makes of signals that come in samples: how late they are, and how noisy still."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


class Blur(NamedTuple):
    """Of k low-passed signals, s ← s + a (h − s) with h the latest sample, each (k,).

    A low pass in time takes out the less of a sample's noise the rarer samples come: of 100 a second a time
    constant of 0.05 s leaves a third of it, of ten nearly all. It lags the less, too, as it takes nearly the
    whole of every sample. Both follow from the samples' times, whatever their rhythm.

    Attributes:
        lag: mean age of what ``s`` is made of, s.
        noise: variance that ``s`` has of samples with independent errors of variance 1.
        tie: covariance of that with the latest sample.
    """

    lag: Float[Array, " k"]
    noise: Float[Array, " k"]
    tie: Float[Array, " k"]

    @classmethod
    def start(cls, count: int) -> Blur:
        """Nothing has come yet."""
        return cls(*(jnp.zeros(count) for _ in cls._fields))

    def take(
        self,
        share: Float[Array, " k"],
        age: Float[Array, " k"],
        longest: float,
        dt: Float[Array, ""],
    ) -> Blur:
        """A step of ``dt`` (s) later.

        Args:
            share: a of this step: 1 for a signal that begins.
            age: s since each signal's latest sample; 0 for one that came just now.
            longest: s beyond which a lag is not followed.
            dt: s.
        """
        is_new: Bool[Array, " k"] = age == 0
        keep, tie = 1 - share, jnp.where(is_new, 0.0, self.tie)
        return Blur(
            lag=jnp.minimum(keep * (self.lag + dt) + share * age, longest),
            noise=keep * (keep * self.noise + 2 * share * tie) + share**2,
            tie=keep * tie + share,
        )
