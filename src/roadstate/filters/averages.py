"""Running means of what a filter sees of its own noise: over a window, or with forgetting."""

from __future__ import annotations

from abc import abstractmethod
from math import log
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int


class AverageState(NamedTuple):
    """What an :class:`Average` remembers; leading axis of ``kept`` as the rule needs it.

    Attributes:
        kept: (L, …) last values, or (1, …) their mean.
        taken: (…) how many values so far, per entry.
    """

    kept: Float[Array, "L ..."]
    taken: Int[Array, "*shape"]


class Average(eqx.Module):
    """A running mean of arrays whose entries may each be missing at any time."""

    @abstractmethod
    def init(self, shape: tuple[int, ...], dtype: Any) -> AverageState:
        """Nothing seen yet."""

    @abstractmethod
    def add(
        self, state: AverageState, value: Float[Array, "*shape"], fresh: Bool[Array, "*shape"]
    ) -> AverageState:
        """Take the entries that are ``fresh``; the others may be anything."""

    @property
    @abstractmethod
    def span(self) -> float:
        """Over how many values it averages: 1/Σ weight², once there were enough."""

    def is_filled(self, state: AverageState, least: int) -> Bool[Array, "*shape"]:
        """Where ``least`` values were seen, or as many as it can tell apart if that is fewer."""
        return state.taken >= least

    @abstractmethod
    def mean(self, state: AverageState) -> Float[Array, "*shape"]:
        """Mean per entry; 0 where nothing was seen."""


class Window(Average):
    """Mean of each entry's last ``length`` values, however long ago they came (paper 000 eq. 48).

    Attributes:
        length: L ≥ 2.

    Raises:
        ValueError: L < 2.
    """

    length: int = eqx.field(default=50, static=True)

    def __check_init__(self) -> None:
        """Refuse a window that averages nothing."""
        if self.length < 2:
            raise ValueError(f"a window of at least 2 values is needed, got {self.length}")

    @property
    def span(self) -> float:
        """L."""
        return float(self.length)

    def init(self, shape: tuple[int, ...], dtype: Any) -> AverageState:
        """Nothing seen yet."""
        return AverageState(jnp.zeros((self.length, *shape), dtype), jnp.zeros(shape, jnp.int32))

    def add(
        self, state: AverageState, value: Float[Array, "*shape"], fresh: Bool[Array, "*shape"]
    ) -> AverageState:
        """Take the entries that are ``fresh``; each replaces its own oldest."""
        # the count goes round in steps of the window once it is full, so that no log is too long for it
        slots = jnp.arange(self.length).reshape((-1,) + (1,) * value.ndim)
        here = (slots == state.taken % self.length) & fresh
        count = state.taken + fresh
        count = jnp.where(count >= 2 * self.length, count - self.length, count)
        return AverageState(jnp.where(here, value, state.kept), count)

    def is_filled(self, state: AverageState, least: int) -> Bool[Array, "*shape"]:
        """Where ``least`` values were seen, or the window is full if it holds fewer."""
        return state.taken >= min(least, self.length)

    def mean(self, state: AverageState) -> Float[Array, "*shape"]:
        """Mean per entry; summed anew each time, so that no rounding builds up."""
        seen = jnp.clip(state.taken, 1, self.length).astype(state.kept.dtype)
        return jnp.sum(state.kept, axis=0) / seen


class Forgetting(Average):
    """Mean with weights that fade: m ← m + d(value − m), d = (1 − b)/(1 − bᵏ) at the k-th value.

    The weights of Sage and Husa's estimator: equal at first, a time constant of 1/(1 − b) values later.

    Attributes:
        factor: b, in (0, 1).

    Raises:
        ValueError: b outside (0, 1).
    """

    factor: float = eqx.field(default=0.98, static=True)

    @property
    def span(self) -> float:
        """(1 + b)/(1 − b)."""
        return (1 + self.factor) / (1 - self.factor)

    def __check_init__(self) -> None:
        """Refuse a factor that does not fade."""
        if not 0 < self.factor < 1:
            raise ValueError(f"the forgetting factor must lie in (0, 1), got {self.factor}")

    def init(self, shape: tuple[int, ...], dtype: Any) -> AverageState:
        """Nothing seen yet."""
        return AverageState(jnp.zeros((1, *shape), dtype), jnp.zeros(shape, jnp.int32))

    def add(
        self, state: AverageState, value: Float[Array, "*shape"], fresh: Bool[Array, "*shape"]
    ) -> AverageState:
        """Take the entries that are ``fresh``."""
        mean = state.kept[0]
        count = jnp.minimum(state.taken + fresh, 2**30)
        faded = jnp.exp(log(self.factor) * jnp.maximum(count, 1).astype(mean.dtype))
        new = mean + (1 - self.factor) / (1 - faded) * (value - mean)
        return AverageState(jnp.where(fresh, new, mean)[None], count)

    def mean(self, state: AverageState) -> Float[Array, "*shape"]:
        """Mean per entry."""
        return state.kept[0]


def unbiased(average: Average) -> float:
    """What a variance about the average's own mean is to be multiplied with."""
    return average.span / (average.span - 1)
