"""Square-root covariance algebra: what every Gaussian filter is made of.

A covariance P is kept as a lower-triangular S with P = S Sᵀ and formed anew by an orthogonal
triangularisation, which cannot lose definiteness and works with half the digits a covariance would need
(Grewal & Andrews, *Kalman Filtering*, ch. 6; Bierman, *Factorization Methods*, ch. V). Where float64 has
digits to spare, a Cholesky factorisation of the product gives the same factor in a third of the time; each
use of it is checked.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from roadstate import dense
from roadstate.core.kernel import once
from roadstate.dense import cholesky, row_triangle

T = TypeVar("T")
_SMALL = 8
"""Up to this many rows an orthogonal triangularisation costs no more than a product and its factor."""
_SUMMED = 16
"""Up to this many rows and columns, a product unrolled at trace time beats a call into a library."""
_PIVOT = 1e-6
"""Least share of a row's square that must be left to its pivot: then a factor by Cholesky's method has errors
of 1e-13 of the row and 1e-10 of the pivot."""


def tria(*blocks: Float[Array, "n _"]) -> Float[Array, "n n"]:
    """Lower-triangular L with non-negative diagonal and L Lᵀ = A Aᵀ, of blocks A side by side.

    A has at least as many columns as rows; its rank may be less. Small A by modified Gram–Schmidt
    (:func:`roadstate.dense.row_triangle`), larger by :func:`stacked_tria`.
    """
    A = blocks[0]
    if A.shape[0] > _SMALL:
        return stacked_tria(blocks, jnp.zeros((0, 0), A.dtype)).corner
    return row_triangle(beside(*blocks) if len(blocks) > 1 else A)


class Blocks(NamedTuple):
    """Blocks of a lower-triangular matrix ``[[corner, 0], [side, factor]]``."""

    corner: Float[Array, "m m"]
    side: Float[Array, "n m"]
    factor: Float[Array, "n n"]


@jax.custom_jvp
def stacked_tria(top: tuple[Float[Array, "m _"], ...], bottom: Float[Array, "n k"]) -> Blocks:
    """:func:`tria` of ``[[top], [0, bottom]]``, ``bottom`` under the last of the blocks of ``top``.

    In float64 by the Cholesky factor of the product with its transpose, provided that no pivot is so small
    against its row that rounding could matter (:data:`_PIVOT`), else by Gram and Schmidt's method; in single
    precision always by that. Under ``vmap`` it runs only when some member of the batch needs it.
    """
    return cast(Blocks, _stacked(top, bottom))


_Stack = tuple[tuple[Array, ...], Array]


@stacked_tria.defjvp
def _stacked_tria_jvp(primals: _Stack, tangents: _Stack) -> tuple[Blocks, Blocks]:
    """dL = L Φ(L⁻¹ (dA Aᵀ + A dAᵀ) L⁻ᵀ), Φ the lower triangle with half the diagonal."""
    blocks = stacked_tria(*primals)
    L = _whole(blocks)
    singular = jnp.diag((jnp.diagonal(L) == 0).astype(L.dtype))

    def seen(pair: _Stack) -> Array:
        return dense.solve_lower(L + singular, _dense(*pair))

    half = seen(tangents) @ seen(primals).T
    slope = half + half.T
    change = L @ (jnp.tril(slope) - 0.5 * jnp.diag(jnp.diagonal(slope)))
    return blocks, _split(change, blocks.corner.shape[0])


def _whole(blocks: Blocks) -> Array:
    gap = jnp.zeros_like(_transposed(blocks.side))
    upper = jnp.concatenate([blocks.corner, gap], axis=-1)
    return jnp.concatenate([upper, jnp.concatenate([blocks.side, blocks.factor], axis=-1)], axis=-2)


def _split(L: Array, m: int) -> Blocks:
    return Blocks(L[..., :m, :m], L[..., m:, :m], L[..., m:, m:])


def _transposed(A: Array) -> Array:
    return jnp.swapaxes(A, -1, -2)


def _times_transposed(A: Array, B: Array) -> Array:
    count = B.shape[-2]
    wide = jnp.pad(_transposed(B), [(0, 0)] * (B.ndim - 1) + [(0, -count % dense.LANES)])
    return once(product(A, once(wide)))[..., :count]


def _diagonal(A: Array) -> Array:
    return cast(Array, jnp.diagonal(A, axis1=-2, axis2=-1))


def _dense(top: tuple[Array, ...], bottom: Array) -> Array:
    above = jnp.concatenate(top, axis=-1)
    gap = jnp.zeros((*bottom.shape[:-1], above.shape[-1] - bottom.shape[-1]), bottom.dtype)
    return jnp.concatenate([above, jnp.concatenate([gap, bottom], axis=-1)], axis=-2)


@jax.custom_batching.custom_vmap
def _stacked(top: tuple[Array, ...], bottom: Array) -> Blocks:
    """:func:`stacked_tria` with any leading axes."""
    m = top[0].shape[-2]
    if bottom.dtype != jnp.float64:
        return _split(row_triangle(_dense(top, bottom)), m)
    # block by block: that of a constant noise is computed before the loop
    first = sum((_times_transposed(block, block) for block in top[1:]), _times_transposed(top[0], top[0]))
    corner = cholesky(first)
    cross = _times_transposed(top[-1][..., top[-1].shape[-1] - bottom.shape[-1] :], bottom)
    side = once(_transposed(dense.solve_lower(corner, cross)))
    second = once(_times_transposed(bottom, bottom))
    factor = cholesky(second - _times_transposed(side, side))
    sound = jnp.all(_diagonal(corner) ** 2 > _PIVOT * _diagonal(first), axis=-1)
    sound = sound & jnp.all(_diagonal(factor) ** 2 > _PIVOT * _diagonal(second), axis=-1)

    def with_care() -> Blocks:
        careful = _split(row_triangle(_dense(top, bottom), is_rare=True), m)
        blocks = zip((corner, side, factor), careful, strict=True)
        return Blocks(*(jnp.where(sound[..., None, None], ours, theirs) for ours, theirs in blocks))

    blocks = jax.lax.cond(jnp.all(sound), lambda: Blocks(corner, side, factor), with_care)
    return cast(Blocks, blocks)


@_stacked.def_vmap
def _stacked_batch(
    size: int, batched: list[Any], top: tuple[Array, ...], bottom: Array
) -> tuple[Blocks, Blocks]:
    def of_all(a: Array, has_axis: bool) -> Array:
        return a if has_axis else jnp.broadcast_to(a, (size, *a.shape))

    each = jax.tree.map(of_all, (top, bottom), tuple(batched))
    return _stacked(*each), Blocks(True, True, True)  # type: ignore[arg-type]


def product(A: Float[Array, "... n k"], B: Float[Array, "... k m"]) -> Float[Array, "... n m"]:
    """A B; for small matrices as a sum of outer products, which the compiler makes one vectorised loop.

    Of 15 × 15 that takes half the time of a call into a library.
    """
    if max(A.shape[-2], A.shape[-1], B.shape[-1]) > _SUMMED:
        return A @ B
    ones = [1] * A.shape[-1]
    columns, rows = jax.lax.split(A, ones, axis=A.ndim - 1), jax.lax.split(B, ones, axis=B.ndim - 2)
    terms = [column * row for column, row in zip(columns, rows, strict=True)]
    while len(terms) > 1:  # pairwise, so that no sum waits for all before it
        left_over = terms[len(terms) // 2 * 2 :]
        terms = [a + b for a, b in zip(terms[::2], terms[1::2], strict=False)] + left_over
    return terms[0] if terms else jnp.zeros((*A.shape[:-1], B.shape[-1]), A.dtype)


def solve_lower(L: Float[Array, "m m"], b: Float[Array, " m"]) -> Float[Array, " m"]:
    """L⁻¹ b for a lower-triangular L."""
    return dense.solve_lower(L, b[:, None])[:, 0]


def root(x: Array) -> Array:
    """√x for x ≥ 0, with derivative 0 instead of infinity at 0: the noise of a step that takes no time."""
    return jnp.sqrt(jnp.maximum(x, float(np.finfo(x.dtype).tiny)))


def rss(*parts: ArrayLike) -> Array:
    """√(a² + b² + …): the 1σ of a sum of independent errors, or the length of a vector, by elements.

    Differentiable as :func:`root` is. (``jnp.hypot`` guards against squares too large for floating-point
    numbers, by three times as many operations.)
    """
    first, *others = (jnp.square(part) for part in parts)
    return root(sum(others, first))


def beside(*blocks: Float[Array, "n _"]) -> Float[Array, "n k"]:
    """Blocks in one matrix, side by side.

    Made before they are joined: of expressions the compiler would make one loop that asks, at each element,
    which block it is in.
    """
    return once(jnp.concatenate(once(blocks), axis=1))


class Correction(NamedTuple):
    """Result of :func:`correct`.

    Attributes:
        delta: (n,) what to add to the mean.
        factor: (n, n) posterior factor.
        nis: νᵀS⁻¹ν over the sensors used.
        log_det: log det S over the sensors used.
    """

    delta: Float[Array, " n"]
    factor: Float[Array, "n n"]
    nis: Float[Array, ""]
    log_det: Float[Array, ""]


def correct(
    state_rows: Float[Array, "n k"],
    sensor_rows: Float[Array, "m k"],
    sqrt_R: Float[Array, "m q"],
    innovation: Float[Array, " m"],
    used: Bool[Array, " m"],
) -> Correction:
    """Condition a Gaussian on a measurement, in array form.

    (Kailath, Sayed & Hassibi, *Linear Estimation*, ch. 12.)

    With deviations X (state) and Z (sensors) such that P = X Xᵀ, P_xz = X Zᵀ and S = Z Zᵀ + R, one
    triangularisation of ``[[√R, Z], [0, X]]`` yields √S, the gain and the posterior factor. For a linear
    sensor Z = H X; for sigma points X and Z are their weighted deviations.

    Args:
        state_rows: (n, k) X.
        sensor_rows: (m, k) Z.
        sqrt_R: (m, q) any factor of R; rows belong to sensors.
        innovation: (m,) z − ẑ; may be anything where ``used`` is false.
        used: (m,) sensors to take; the others have no effect at all.
    """
    n, m = state_rows.shape[0], sensor_rows.shape[0]
    dtype = state_rows.dtype
    keep = used[:, None]
    skipped = jnp.diag((~used).astype(dtype))
    top = once((jnp.where(keep, sqrt_R, 0), skipped, jnp.where(keep, sensor_rows, 0)))
    if n + m > _SMALL:
        sqrt_S, gain, factor = stacked_tria(top, state_rows)
    else:
        sqrt_S, gain, factor = _split(tria(_dense(top, state_rows)), m)
    whitened = solve_lower(sqrt_S, jnp.where(used, innovation, 0))
    return Correction(
        delta=product(gain, whitened[:, None])[:, 0],
        factor=factor,
        nis=jnp.sum(whitened**2),
        log_det=2 * jnp.sum(jnp.log(jnp.diagonal(sqrt_S))),
    )
