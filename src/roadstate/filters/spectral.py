"""Functions of symmetric matrices, with derivatives that exist where eigenvalues coincide."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from roadstate.dense import eigh


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def spectral(
    functions: Callable[..., Float[Array, "k n"]], W: Float[Array, "n n"], *parameters: Any
) -> tuple[Float[Array, "k n n"], Float[Array, " n"]]:
    """V diag(f(λ)) Vᵀ for each of k functions f of the eigenvalues λ of a symmetric W = V diag(λ) Vᵀ, and λ.

    Derivatives are Daleckii and Krein's, by divided differences of f (Higham, *Functions of Matrices*,
    theorem 3.11); those of V itself, which automatic differentiation would take, do not exist where
    eigenvalues coincide.

    Args:
        functions: elementwise, from (n,) eigenvalues, in any order, and the parameters to (k, n).
        W: (n, n) symmetric.
        parameters: what else ``functions`` depends on.
    """
    eigenvalues, V = eigh(W)
    return (V * functions(eigenvalues, *parameters)[:, None]) @ V.T, eigenvalues


@spectral.defjvp
def _spectral_jvp(
    functions: Callable[..., Float[Array, "k n"]], primals: tuple[Any, ...], tangents: tuple[Any, ...]
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    (W, *parameters), (dW, *dparameters) = primals, tangents
    eigenvalues, V = eigh(W)
    values, slopes = jax.jvp(
        lambda x: functions(x, *parameters), (eigenvalues,), (jnp.ones_like(eigenvalues),)
    )
    if parameters:
        moved = jax.jvp(lambda *p: functions(eigenvalues, *p), tuple(parameters), tuple(dparameters))[1]
    else:
        moved = jnp.zeros_like(values)
    gap = eigenvalues[:, None] - eigenvalues
    near = jnp.abs(gap) <= float(np.finfo(W.dtype).eps) ** 0.5 * jnp.max(jnp.abs(eigenvalues))
    mean_slope = (slopes[:, :, None] + slopes[:, None]) / 2
    divided = (values[:, :, None] - values[:, None]) / jnp.where(near, 1, gap)
    seen = V.T @ ((dW + dW.T) / 2) @ V
    rotated = jnp.where(near, mean_slope, divided) * seen + jax.vmap(jnp.diag)(moved)
    primal = (V * values[:, None]) @ V.T, eigenvalues
    return primal, (V @ rotated @ V.T, jnp.diagonal(seen))
