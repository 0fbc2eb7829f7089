"""Factorisations of small dense matrices, written so that a compiler can make them part of a larger kernel.

A call into LAPACK that stands in a loop keeps the loop from being one kernel
(:func:`roadstate.core.numerics.jit_loop`), and a filter's step then takes two to four times as long. Within a
kernel these take as long as LAPACK's own up to 20 rows, and twice as long at 30. The methods are the textbook
ones (Golub & Van Loan, *Matrix Computations*, 4th ed.). Leading axes are batches.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TypeVar, cast

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.core.kernel import once

T = TypeVar("T")
_WRITTEN_OUT = 16
"""Up to this many rows a factorisation is written out at trace time, without what is known to be zero."""
LANES = 4
"""Numbers that XLA's loops for a CPU take at once, in double precision."""
_UNROLLED = 8
"""Up to this many rows a loop over them is unrolled at trace time."""
_AT_ONCE = 3
"""Rows of larger matrices that one pass of the compiled loop takes."""
_ROTATED = 4
"""Up to this many rows Jacobi's rotations take as long as LAPACK."""
_SWEEPS = {1: 0, 2: 1, 3: 6, 4: 7}
"""By number of rows: convergence is quadratic; of 10⁵ random matrices each was done one sweep earlier."""

_row = partial(jax.lax.dynamic_index_in_dim, axis=-2)
_put = partial(jax.lax.dynamic_update_index_in_dim, axis=-2)


def _over_rows(count: int, step: Callable[[Array, T], T], start: T, *, is_rare: bool = False) -> T:
    if not count:
        return start
    unroll = 1 if is_rare else count if count <= _UNROLLED else _AT_ONCE
    return cast(T, jax.lax.fori_loop(0, count, step, start, unroll=unroll))


def cholesky(A: Float[Array, "... n n"]) -> Float[Array, "... n n"]:
    """Lower-triangular L with L Lᵀ = A for a positive definite A (§4.2.5, by outer products).

    Where A is not positive definite, NaN or infinities.
    """
    n = A.shape[-1]
    if n <= _WRITTEN_OUT:
        return jnp.swapaxes(_upper(A), -1, -2)

    def eliminate(j: Array, work: tuple[Array, Array]) -> tuple[Array, Array]:
        rest, upper = work
        row = _row(rest, j, keepdims=False)
        # before the pivot there is rounding, which spoils nothing that is still to be read
        row = row * (1 / jnp.sqrt(jax.lax.dynamic_index_in_dim(row, j, axis=-1)))
        return rest - row[..., :n, None] * row[..., None, :], _put(upper, row, j)

    # whole vectors: what is left over of a row would be taken one by one
    wide = jnp.pad(A, [(0, 0)] * (A.ndim - 1) + [(0, -n % LANES)])
    upper = _over_rows(n, eliminate, (wide, jnp.zeros_like(wide)))[1]
    return jnp.tril(jnp.swapaxes(upper[..., :n], -1, -2))


def _upper(A: Float[Array, "... n n"]) -> Float[Array, "... n n"]:
    """The upper-triangular U with Uᵀ U = A, written out row by row."""
    rows, rest = list[Array](), A
    for j in range(A.shape[-1]):
        row = once(rest[..., :1, :] * (1 / jnp.sqrt(rest[..., :1, :1])))
        rows.append(jax.lax.pad(row, jnp.zeros((), A.dtype), [(0, 0, 0)] * (A.ndim - 1) + [(j, 0, 0)]))
        after = row[..., 1:]
        rest = rest[..., 1:, 1:] - jnp.swapaxes(after, -1, -2) * after
    return _below(rows, A)


def _below(rows: list[Array], like: Array) -> Array:
    return once(jnp.concatenate(rows, axis=-2)) if rows else like


def row_triangle(A: Float[Array, "... n k"], *, is_rare: bool = False) -> Float[Array, "... n n"]:
    """Lower-triangular L with non-negative diagonal and L Lᵀ = A Aᵀ (k ≥ n); rank-deficient A is fine.

    By modified Gram–Schmidt, whose triangular factor is as backward stable as Householder's (Björck 1967;
    Higham, *Accuracy and Stability of Numerical Algorithms*, ch. 19.8).

    Args:
        A: (…, n, k).
        is_rare: it will hardly ever run: rather compiled quickly than fast.
    """
    n = A.shape[-2]
    # squares of small rows would underflow in single precision
    size = jnp.max(jnp.abs(A), axis=-1, keepdims=True, initial=0)
    size = jax.lax.stop_gradient(jnp.where(size > 0, size, 1))

    def project(i: Array, work: tuple[Array, Array]) -> tuple[Array, Array]:
        rest, upper = work
        row = _row(rest, i, keepdims=False)
        square = jnp.sum(row**2, axis=-1, keepdims=True)
        direction = row * jnp.where(square > 0, 1 / jnp.sqrt(jnp.where(square > 0, square, 1)), 0)
        along = jnp.sum(rest * direction[..., None, :], axis=-1)
        return rest - along[..., None] * direction[..., None, :], _put(upper, along, i)

    upper = _over_rows(n, project, (A / size, jnp.zeros((*A.shape[:-1], n), A.dtype)), is_rare=is_rare)[1]
    return jnp.tril(size * jnp.swapaxes(upper, -1, -2))


def solve_lower(L: Float[Array, "... m m"], B: Float[Array, "... m k"]) -> Float[Array, "... m k"]:
    """L⁻¹ B for a lower-triangular L (§3.1.3); what stands above its diagonal is not read."""
    n = L.shape[-1]
    if n <= _WRITTEN_OUT:
        rows, rest = list[Array](), B
        for j in range(n):
            rows.append(once(rest[..., :1, :] / L[..., j : j + 1, j : j + 1]))
            rest = rest[..., 1:, :] - L[..., j + 1 :, j : j + 1] * rows[-1]
        return _below(rows, B)
    index = jnp.arange(n)[:, None]

    def substitute(j: Array, rest: Array) -> Array:
        column = jax.lax.dynamic_index_in_dim(L, j, axis=-1)
        solved = _row(rest, j) / _row(column, j)
        return jnp.where(index > j, rest - column * solved, jnp.where(index == j, solved, rest))

    return _over_rows(n, substitute, B)


def solve_upper(L: Float[Array, "... m m"], B: Float[Array, "... m k"]) -> Float[Array, "... m k"]:
    """L⁻ᵀ B for a lower-triangular L: with rows and columns in reverse, Lᵀ is lower-triangular."""
    reverse = jnp.flip(jnp.swapaxes(L, -1, -2), axis=(-2, -1))
    return jnp.flip(solve_lower(reverse, jnp.flip(B, axis=-2)), axis=-2)


def solve(A: Float[Array, "... n n"], B: Float[Array, "... n k"]) -> Float[Array, "... n k"]:
    """A⁻¹ B, by Gauss and Jordan's elimination with row exchanges (§3.4); not finite where A is singular."""
    n = A.shape[-1]
    index = jnp.arange(n)

    def eliminate(j: Array, rows: Array) -> Array:
        column = jax.lax.dynamic_index_in_dim(rows, j, axis=-1, keepdims=False)
        largest = jnp.argmax(jnp.where(index >= j, jnp.abs(column), -1), axis=-1, keepdims=True)
        is_largest = index == largest
        chosen = jnp.sum(jnp.where(is_largest[..., None], rows, 0), axis=-2, keepdims=True)
        moved = jnp.where(is_largest[..., None], _row(rows, j), rows)
        column = jax.lax.dynamic_index_in_dim(moved, j, axis=-1)
        pivot = chosen / jax.lax.dynamic_index_in_dim(chosen, j, axis=-1)
        return jnp.where((index == j)[:, None], pivot, moved - column * pivot)

    return _over_rows(n, eliminate, jnp.concatenate([A, B], axis=-1))[..., n:]


def eigh(A: Float[Array, "... n n"]) -> tuple[Float[Array, "... n"], Float[Array, "... n n"]]:
    """Eigenvalues λ, in any order, and eigenvectors V, as columns, of a symmetric A = V diag(λ) Vᵀ.

    Up to 4 × 4 by Jacobi's cyclic rotations (§8.5.3), larger by LAPACK.
    """
    n = A.shape[-1]
    if n > _ROTATED:
        values, vectors = jnp.linalg.eigh(A)
        return values, vectors
    V = jnp.broadcast_to(jnp.eye(n, dtype=A.dtype), A.shape)
    pairs = [(p, q) for p in range(n) for q in range(p + 1, n)]

    def sweep(_: Array, work: tuple[Array, Array]) -> tuple[Array, Array]:
        A, V = work
        for p, q in pairs:
            J = _rotation(A, p, q)
            A, V = jnp.swapaxes(J, -1, -2) @ A @ J, V @ J
        return A, V

    turned, V = jax.lax.fori_loop(0, _SWEEPS[n], sweep, (A, V))
    return jnp.diagonal(turned, axis1=-2, axis2=-1), V


def _rotation(A: Array, p: int, q: int) -> Array:
    """The rotation J in the plane of p and q after which (Jᵀ A J)_pq is 0, by the smaller of the angles."""
    needed = A[..., p, q] != 0
    ratio = (A[..., q, q] - A[..., p, p]) / (2 * jnp.where(needed, A[..., p, q], 1))
    tangent = jnp.where(ratio >= 0, 1, -1) / (jnp.abs(ratio) + jnp.sqrt(1 + ratio**2))
    tangent = jnp.where(needed, tangent, 0)
    cosine = 1 / jnp.sqrt(1 + tangent**2)
    sine = tangent * cosine
    J = jnp.broadcast_to(jnp.eye(A.shape[-1], dtype=A.dtype), A.shape)
    J = J.at[..., p, p].set(cosine).at[..., q, q].set(cosine)
    return J.at[..., p, q].set(sine).at[..., q, p].set(-sine)
