"""Where a signal is now and how fast it changes, of noisy samples: a quadratic that forgets."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

_LEAST_STEP = 1e-3  # s
_GAP = 4.0  # memories without a sample after which nothing is left of the parabola


class Quadratic(NamedTuple):
    """Value, rate and second derivative of k signals, each (k,): of the parabola that fits all samples best
    when those t s ago weigh exp(−t/τ) (the fading-memory filter of third order; Morrison, *Introduction to
    Sequential Smoothing and Prediction*, ch. 13, exact for steps of equal length).

    A low pass lags by τ, and undoing that with its own derivative leaves an error of τ² times the second
    derivative; this one has no lag in a parabola, for the noise of it.
    """

    value: Float[Array, " k"]
    rate: Float[Array, " k"]
    second: Float[Array, " k"]

    @classmethod
    def start(cls, count: int) -> Quadratic:
        """Zero, until samples come."""
        return cls(*(jnp.zeros(count) for _ in cls._fields))

    def take(
        self,
        sample: Float[Array, " k"],
        afresh: Bool[Array, " k"],
        memory: Float[Array, " k"],
        dt: Float[Array, ""],
    ) -> Quadratic:
        """A sample ``dt`` after the last.

        Args:
            sample: of each signal.
            afresh: whether it is the first that counts; one after a long gap is.
            memory: τ of each signal, s.
            dt: s.
        """
        step = jnp.maximum(dt, _LEAST_STEP)
        theta = jnp.exp(-step / memory)
        gone = 1 - theta
        value, rate = self.value + dt * (self.rate + 0.5 * dt * self.second), self.rate + dt * self.second
        new = sample - value
        moved = Quadratic(
            value + (1 - theta**3) * new,
            rate + 1.5 * gone**2 * (1 + theta) / step * new,
            self.second + gone**3 / step**2 * new,
        )
        begun = Quadratic(sample, *(jnp.zeros_like(sample) for _ in range(2)))
        afresh = afresh | (dt > _GAP * memory)
        return Quadratic(*(jnp.where(afresh, a, b) for a, b in zip(begun, moved, strict=True)))

    def ahead(self, time: Float[Array, ...]) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
        """Value and rate ``time`` s later, of each or of all alike."""
        value = self.value + time * (self.rate + 0.5 * time * self.second)
        return value, self.rate + time * self.second
