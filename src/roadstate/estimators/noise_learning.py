"""How much less noise than the vehicle file says a sensor has, learned from a filter's innovations."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

_SLOW = 1.0  # s: of an innovation only what lasts as long counts, for so long a filter averages
_MEMORY = 60.0  # s over which its square is averaged
_DOUBT = 4.0  # s of samples that the file's word counts for
_MARGIN = 1.5  # times what was found is taken
_LEAST_STEP = 1e-3  # s
_LEAST = 0.05  # of the file's variance, whatever was found


class Unrest(NamedTuple):
    """State of a :class:`NoiseLearner`, for each sensor.

    Attributes:
        low: (k,) low-passed innovation over the file's 1σ.
        share: (k,) of the file's variance that was found.
        age: (k,) s since the last sample.
        heard: (k,) s of samples so far.
    """

    low: Float[Array, " k"]
    share: Float[Array, " k"]
    age: Float[Array, " k"]
    heard: Float[Array, " k"]


class NoiseLearner(eqx.Module):
    """Averages the squares of low-passed innovations, per sensor.

    A low pass y of white noise of variance R, sampled every Δ, has variance R α/(2 − α) with
    α = 1 − e^(−Δ/τ); so y² (2 − α)/α is what white noise as strong as the innovation is at low frequency
    would have, and that is what decides in a filter: fast vibration averages out, errors that last do not.
    States that are not yet known add to innovations, so what is found is never too little on average. The
    file's figure is the most there is: a sensor that errs more than that has a fault, which noise does not
    describe.
    """

    def init(self, count: int) -> Unrest:
        """As the file says."""
        zero = jnp.zeros(count)
        return Unrest(zero, zero + 1.0, zero, zero)

    def learn(
        self,
        state: Unrest,
        innovation: Float[Array, " k"],
        stated: Float[Array, " k"],
        usual: Bool[Array, " k"],
        dt: Float[Array, ""],
    ) -> Unrest:
        """Take innovations ``dt`` after the last.

        Args:
            state: from :meth:`init` or the last call.
            innovation: NaN where there is none.
            stated: the file's 1σ of a sample, in the same unit.
            usual: whether that is the sensor's usual one.
            dt: s.
        """
        age = state.age + dt
        seen = jnp.isfinite(innovation)
        counts = seen & usual
        pace = -jnp.expm1(-jnp.maximum(age, _LEAST_STEP) / _SLOW)
        ratio = jnp.where(counts, innovation, 0.0) / stated
        low = state.low + jnp.where(counts, pace, 0.0) * (ratio - state.low)
        found = low**2 * (2 - pace) / pace
        heard = state.heard + jnp.where(counts, age, 0.0)
        weight = jnp.where(counts, age / jnp.minimum(heard + _DOUBT, _MEMORY), 0.0)
        share = state.share + jnp.minimum(weight, 0.5) * (jnp.minimum(found, 4.0) - state.share)
        return Unrest(low, share, jnp.where(seen, 0.0, age), heard)

    def scale(self, state: Unrest) -> Float[Array, " k"]:
        """(k,) what to multiply the file's 1σ by."""
        return jnp.sqrt(jnp.clip(_MARGIN * state.share, _LEAST, 1.0))
