"""Square-root covariance algebra: what every Gaussian filter is made of.

A covariance P is kept as a lower-triangular S with P = S Sᵀ and only ever formed anew by an orthogonal
triangularisation, which cannot lose definiteness and works with half the digits a covariance would need
(Grewal & Andrews, *Kalman Filtering*, ch. 6; Bierman, *Factorization Methods*, ch. V).
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar, cast

import jax
import jax.numpy as jnp
import jax.scipy.linalg as jsl
import numpy as np
from jaxtyping import Array, Bool, Float

T = TypeVar("T")
_UNROLLED = 8
"""Up to this many rows, code unrolled at trace time beats a call into LAPACK (by 1 to 2 µs)."""


def tria(A: Float[Array, "n k"]) -> Float[Array, "n n"]:
    """Lower-triangular L with non-negative diagonal and L Lᵀ = A Aᵀ (k ≥ n); rank-deficient A is fine.

    Small A by modified Gram–Schmidt, whose triangular factor is as backward stable as Householder's
    (Björck 1967; Higham, *Accuracy and Stability of Numerical Algorithms*, ch. 19.8), larger by LAPACK's QR.
    """
    if A.shape[0] > _UNROLLED:
        upper = jnp.linalg.qr(A.T, mode="r")
        sign = jnp.where(jnp.diagonal(upper) < 0, -1.0, 1.0).astype(A.dtype)
        return (upper * sign[:, None]).T
    columns = []
    for i in range(A.shape[0]):
        square = jnp.sum(A[i] ** 2)
        direction = A[i] * jnp.where(square > 0, 1 / jnp.sqrt(jnp.where(square > 0, square, 1)), 0)
        along = product(A, direction[:, None])
        columns.append(along[:, 0])
        A = A - along * direction
    return jnp.tril(jnp.stack(columns, axis=1))


def product(A: Float[Array, "n k"], B: Float[Array, "k m"]) -> Float[Array, "n m"]:
    """A B; for small matrices as sums that the compiler fuses with their neighbours."""
    if A.shape[0] > _UNROLLED or B.shape[1] > _UNROLLED:
        return A @ B
    return jnp.sum(A[:, :, None] * B[None], axis=1)


def solve_lower(L: Float[Array, "m m"], b: Float[Array, " m"]) -> Float[Array, " m"]:
    """L⁻¹ b for a lower-triangular L."""
    if L.shape[0] > _UNROLLED:
        return jsl.solve_triangular(L, b, lower=True)
    rows: list[Float[Array, ""]] = []
    for i in range(L.shape[0]):
        rows.append((b[i] - sum((L[i, j] * x for j, x in enumerate(rows)), jnp.zeros((), b.dtype))) / L[i, i])
    return jnp.stack(rows)


def root(x: Array) -> Array:
    """√x for x ≥ 0, with derivative 0 instead of infinity at 0: the noise of a step that takes no time."""
    return jnp.sqrt(jnp.maximum(x, float(np.finfo(x.dtype).tiny)))


def once(tree: T) -> T:
    """The same values, computed once.

    Without this the compiler may fuse an expression into each of its uses and evaluate it anew for every
    element there, exponentials and roots included, which costs more than the fusion saves.
    """
    return cast(T, jax.lax.optimization_barrier(tree))  # type: ignore[no-untyped-call]


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
    top = jnp.concatenate([jnp.where(keep, sqrt_R, 0), skipped, jnp.where(keep, sensor_rows, 0)], axis=1)
    bottom = jnp.concatenate([jnp.zeros((n, sqrt_R.shape[1] + m), dtype), state_rows], axis=1)
    L = tria(jnp.concatenate([top, bottom]))
    sqrt_S, gain = L[:m, :m], L[m:, :m]
    whitened = solve_lower(sqrt_S, jnp.where(used, innovation, 0))
    return Correction(
        delta=product(gain, whitened[:, None])[:, 0],
        factor=L[m:, m:],
        nis=jnp.sum(whitened**2),
        log_det=2 * jnp.sum(jnp.log(jnp.diagonal(sqrt_S))),
    )
