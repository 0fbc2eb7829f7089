"""Samples of one axis of a gyroscope: which of them to believe."""

from __future__ import annotations

from typing import NamedTuple, Self

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from roadstate.estimators.intake import STALE
from roadstate.estimators.signals import NEVER, Held

_STUCK = 40  # equal samples in a row after which the gyroscope counts as missing
_LARGEST = 4.0  # rad/s that a body turns by at most
_LARGEST_JUMP = 0.3  # rad/s between samples; more is a spike
_PATIENCE = 4  # samples in a row that a jump must last to be believed
_USUAL_STEP = 0.01  # s: samples that come faster are no noisier, together


class Gyroscope(NamedTuple):
    """What has come of one axis; one that repeats itself may be coarse only, but counts as missing.

    Attributes:
        rate: latest sample believed, rad/s, and its age.
        refused: samples refused in a row.
        repeats: equal samples in a row.
        every: s from sample to sample.
    """

    rate: Held
    refused: Float[Array, ""]
    repeats: Float[Array, ""]
    every: Float[Array, ""]

    @classmethod
    def silent(cls) -> Self:
        """Nothing has come yet."""
        zero = jnp.zeros(())
        return cls(Held.empty(), zero, zero, zero)

    def take(self, raw: Float[Array, ""], dt: Float[Array, ""]) -> Self:
        """With a sample ``dt`` after the last, rad/s; NaN where there is none."""
        before = self.rate
        seen = jnp.isfinite(raw) & (jnp.abs(raw) < _LARGEST)
        jump = seen & (jnp.abs(raw - before.value) > _LARGEST_JUMP) & (before.age < STALE)
        refuse = jump & (self.refused < _PATIENCE)
        refused = jnp.where(refuse, self.refused + 1, jnp.where(seen, 0.0, self.refused))
        rate = before.take(jnp.where(seen & ~refuse, raw, jnp.nan), dt)
        same = seen & (raw == before.value)
        repeats = jnp.where(same, self.repeats + 1, jnp.where(seen, 0.0, self.repeats))
        since = jnp.where(before.age < STALE, before.age + dt, 0.0)
        every = jnp.where(rate.age > 0, self.every, jnp.maximum(since, _USUAL_STEP))
        return self._replace(rate=rate, refused=refused, repeats=repeats, every=every)

    def goes_on(self, dt: Float[Array, ""]) -> Bool[Array, ""]:
        """Whether a sample ``dt`` later tells how the body turned meanwhile: not after a gap."""
        return (self.rate.age + dt < STALE) | (self.rate.age >= NEVER)

    def is_known(self) -> Bool[Array, ""]:
        """Whether the latest sample tells how the body turns."""
        return (self.rate.age < STALE) & (self.repeats < _STUCK)

    def between(self, before: Self) -> Float[Array, ""]:
        """Mean rate since it was ``before``, rad/s."""
        older = jnp.where(before.rate.age < STALE, before.rate.value, self.rate.value)
        return 0.5 * (self.rate.value + older)
