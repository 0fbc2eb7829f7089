"""What a filter holds (:class:`Gaussian`) and what it tells of each step (:class:`Info`)."""

from __future__ import annotations

from enum import IntEnum

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from roadstate.core import numerics as numerics  # float64 before the first array


class Gaussian(eqx.Module):
    """A normal distribution in square-root form, so that its covariance cannot lose definiteness.

    Attributes:
        mean: (n,).
        factor: (n, n) lower-triangular S with P = S Sᵀ.
    """

    mean: Float[Array, " n"]
    factor: Float[Array, "n n"]

    @property
    def cov(self) -> Float[Array, "n n"]:
        """Covariance P = S Sᵀ."""
        return self.factor @ self.factor.T

    @property
    def std(self) -> Float[Array, " n"]:
        """Standard deviation of each component."""
        return jnp.sqrt(jnp.sum(self.factor**2, axis=1))


class Gate(IntEnum):
    """What became of one sensor's sample."""

    NOT_TESTED = 0
    PASSED = 1
    REJECTED = 2


class Reason(IntEnum):
    """What a step has to say; :attr:`Info.ok` is false for ``NOT_FINITE`` only."""

    OK = 0
    NO_MEASUREMENT = 1
    NOT_FINITE = 2
    THETA_REDUCED = 3
    """An H∞ filter could not hold its bound here and took a weaker one."""
    MEMORY_KEPT = 4
    """A limited-memory filter kept old samples in a direction that the recent ones do not determine."""
    PROJECTED = 5
    """The mean lay outside its bounds and was moved onto them."""


class Info(eqx.Module):
    """What one step of a filter tells.

    Attributes:
        innovation: (m,) z − ẑ; NaN where the sample is missing.
        S: (m, m) innovation covariance, including sensors whose sample is missing.
        nis: normalised innovation squared over the sensors used; 0 where none was.
        log_likelihood: log p(z) of the sensors used.
        gate: (m,) :class:`Gate` codes.
        ok: the state is finite and, if a sample was there, updated.
        reason: :class:`Reason` code.
    """

    innovation: Float[Array, " m"]
    S: Float[Array, "m m"]
    nis: Float[Array, ""]
    log_likelihood: Float[Array, ""]
    gate: Int[Array, " m"]
    ok: Bool[Array, ""]
    reason: Int[Array, ""]
