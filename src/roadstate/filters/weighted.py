"""Weighted samples: what the filters that carry particles share."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax.scipy.special import logsumexp
from jaxtyping import Array, Bool, Float, Int

from roadstate.core.gaussian import Gaussian, Info, Reason
from roadstate.linalg import product, solve_lower, tria


def normalized(log_weights: Float[Array, " N"]) -> tuple[Float[Array, " N"], Float[Array, ""]]:
    """Log weights that sum to 1, and the logarithm of what they summed to; as they were if that is no number.

    Args:
        log_weights: (N,), −∞ for none.
    """
    largest = jax.lax.stop_gradient(jnp.max(log_weights))
    largest = jnp.where(jnp.isfinite(largest), largest, 0)
    # in two steps, since a large total has too few digits behind the point for weights to sum to 1
    shifted = log_weights - largest
    total = logsumexp(shifted)
    return jnp.where(jnp.isfinite(total), shifted - total, log_weights), largest + total


def effective_number(log_weights: Float[Array, " N"]) -> Float[Array, ""]:
    """N_eff = 1/Σw² (paper 003 eq. 46).

    Args:
        log_weights: (N,) normalised.
    """
    return 1 / jnp.sum(jnp.exp(2 * log_weights))


def deviations(
    columns: Float[Array, "n N"], log_weights: Float[Array, " N"]
) -> tuple[Float[Array, " n"], Float[Array, "n N"]]:
    """Weighted mean, and columns √w (x − mean) whose outer products sum to the covariance.

    Args:
        columns: (n, N) one sample a column.
        log_weights: (N,) normalised.
    """
    weights = jnp.exp(log_weights)
    mean = columns @ weights
    return mean, (columns - mean[:, None]) * jnp.sqrt(weights)


def gaussian(mean: Float[Array, " n"], columns: Float[Array, "n k"]) -> Gaussian:
    """N(mean, columns columnsᵀ), with any number of columns.

    Args:
        mean: (n,).
        columns: (n, k).
    """
    n, k = columns.shape
    return Gaussian(mean, tria(jnp.pad(columns, ((0, 0), (0, max(0, n - k))))))


def masked(sqrt_R: Float[Array, "m k"], used: Bool[Array, " m"]) -> Float[Array, "m m"]:
    """Lower-triangular factor of R over the sensors used, and of 1 for each of the others.

    Args:
        sqrt_R: (m, k) any factor of R.
        used: (m,).
    """
    rows = jnp.where(used[:, None], sqrt_R, 0)
    return tria(jnp.concatenate([rows, jnp.diag((~used).astype(sqrt_R.dtype))], axis=1))


def told(
    innovation: Float[Array, " m"],
    factor: Float[Array, "m m"],
    log_likelihood: Float[Array, ""],
    used: Bool[Array, " m"],
    codes: Int[Array, " m"],
    ok: Bool[Array, ""],
) -> Info:
    """What an update tells whose predicted measurement is no Gaussian: NIS by its first two moments.

    Args:
        innovation: (m,) z − ẑ, NaN where the sample is missing.
        factor: (m, m) lower-triangular factor of S.
        log_likelihood: log p(z) of the sensors used.
        used: (m,) sensors taken.
        codes: (m,) gate codes.
        ok: whether the state was updated.
    """
    whitened = solve_lower(masked(factor, used), jnp.where(used, innovation, 0))
    reason = jnp.where(ok, jnp.where(jnp.any(used), Reason.OK, Reason.NO_MEASUREMENT), Reason.NOT_FINITE)
    return Info(
        innovation=innovation,
        S=product(factor, factor.T),
        nis=jnp.sum(whitened**2),
        log_likelihood=jnp.where(jnp.any(used), log_likelihood, 0),
        gate=codes,
        ok=ok,
        reason=reason,
    )
