"""Fuzzy adaptation of the measurement noise: a Mamdani controller as a precomputed surface."""

from __future__ import annotations

from functools import cache
from math import log
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.typing import NDArray

from roadstate.filters.averages import Average, AverageState, Window, unbiased

_SURFACE_POINTS = 257
_UNIVERSE_POINTS = 2001


class Triangle(NamedTuple):
    """A triangular fuzzy set: membership 1 at ``peak``, 0 at and beyond ``left`` and ``right``."""

    left: float
    peak: float
    right: float

    def membership(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Degree, in [0, 1], to which each x belongs."""
        return np.interp(x, self, (0.0, 1.0, 0.0))


class Mamdani(NamedTuple):
    """Fuzzy inference with one input e ∈ [−1, 1]: if e is *input* then the output is *output*.

    Implication by minimum, aggregation by maximum, defuzzification by centroid (Mamdani & Assilian 1975).

    Attributes:
        rules: pairs (set of the input, set of the output).
    """

    rules: tuple[tuple[Triangle, Triangle], ...]

    def surface(self) -> NDArray[np.float64]:
        """Output at 257 inputs evenly over [−1, 1]."""
        return _surface(self)


@cache
def _surface(controller: Mamdani) -> NDArray[np.float64]:
    e = np.linspace(-1, 1, _SURFACE_POINTS)
    low = min(output.left for _, output in controller.rules)
    high = max(output.right for _, output in controller.rules)
    y = np.linspace(low, high, _UNIVERSE_POINTS)
    fired = np.zeros((e.size, y.size))
    for given, output in controller.rules:
        fired = np.maximum(fired, np.minimum(given.membership(e)[:, None], output.membership(y)))
    area = np.sum(fired, axis=1)
    moment = fired @ y
    result: NDArray[np.float64] = np.divide(moment, area, out=np.zeros_like(moment), where=area > 0)
    return result


_NEGATIVE, _ZERO, _POSITIVE = Triangle(-2, -1, 0), Triangle(-1, 0, 1), Triangle(0, 1, 2)
NOISE_RULES = Mamdani(((_NEGATIVE, _NEGATIVE), (_ZERO, _ZERO), (_POSITIVE, _POSITIVE)))
"""Actual variance smaller than theoretical lowers R, equal keeps it, larger raises it.

Paper 004 §3.3 has lower and raise the other way round for its definition of e."""


class FuzzyState(NamedTuple):
    """State of :class:`FuzzyNoise`.

    Attributes:
        innovations: means of ν, ν² and S per sensor.
        log_scale: (m,) ln of R̂ as a multiple of the model's R.
    """

    innovations: AverageState
    log_scale: Float[Array, " m"]


class FuzzyNoise(eqx.Module):
    """Scales each sensor's R so that its innovations become as large as they should be (paper 004 §3.3).

    With r the variance of ν over a window, divided by the mean of S (1 where all is as assumed), the mismatch
    is e = (r − 1)/max(r, 1) ∈ (−1, 1); each sample changes ln R by ``rate`` times the controller's output.
    The variance is about the window's mean, as in the paper: innovations that all point the same way tell of
    a state that is wrong, not of noise, and must not teach the filter to disregard them.

    Attributes:
        rules: the controller.
        average: how the innovations' variance is averaged.
        rate: largest relative change of R at one sample.
        minimum: samples of a sensor before its R may change.
        floor: least R as a multiple of the model's (variance).
        ceiling: largest R, likewise.
    """

    rules: Mamdani = eqx.field(default=NOISE_RULES, static=True, kw_only=True)
    average: Average = eqx.field(default=Window(30), kw_only=True)
    rate: float = eqx.field(default=0.05, static=True, kw_only=True)
    minimum: int = eqx.field(default=10, static=True, kw_only=True)
    floor: float = eqx.field(default=1e-4, static=True, kw_only=True)
    ceiling: float = eqx.field(default=1e4, static=True, kw_only=True)

    def init(self, sensors: int, dtype: Any) -> FuzzyState:
        """The model's R, nothing seen."""
        return FuzzyState(self.average.init((3, sensors), dtype), jnp.zeros(sensors, dtype))

    def scale(self, state: FuzzyState) -> Float[Array, " m"]:
        """(m,) R̂ as a multiple of the model's R (variance)."""
        return jnp.exp(state.log_scale)

    def learn(
        self,
        state: FuzzyState,
        innovation: Float[Array, " m"],
        expected: Float[Array, " m"],
        fresh: Bool[Array, " m"],
    ) -> FuzzyState:
        """Take one sample's ν and S per sensor, in any unit that does not change, where ``fresh``."""
        sample = jnp.stack([innovation, innovation**2, expected])
        average = self.average.add(state.innovations, sample, fresh)
        mean, square, theory = self.average.mean(average)
        actual = (square - mean**2) * unbiased(self.average)
        larger = jnp.maximum(actual, theory)
        change = self.rate * self.respond((actual - theory) / jnp.where(larger > 0, larger, 1))
        moves = fresh & self.average.is_filled(average, self.minimum)[0]
        log_scale = jnp.clip(
            state.log_scale + jnp.where(moves, change, 0), log(self.floor), log(self.ceiling)
        )
        return FuzzyState(average, log_scale)

    def respond(self, mismatch: Float[Array, " m"]) -> Float[Array, " m"]:
        """The controller's output at mismatches in [−1, 1], interpolated on its surface."""
        surface = jnp.asarray(self.rules.surface(), mismatch.dtype)
        place = (jnp.clip(mismatch, -1, 1) + 1) / 2 * (_SURFACE_POINTS - 1)
        left = jnp.minimum(place.astype(jnp.int32), _SURFACE_POINTS - 2)
        share = place - left
        return (1 - share) * surface[left] + share * surface[left + 1]
