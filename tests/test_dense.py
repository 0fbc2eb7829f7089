"""Factorisations of small matrices against numpy's."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from roadstate import dense

SIZES = [1, 2, 3, 4, 8, 9, 15, 30]  # on both sides of every change of method


def random(*shape: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng([seed, *shape]).normal(size=shape)


def positive(n: int) -> np.ndarray:
    """Five positive definite matrices."""
    A = random(5, n, n + 2)
    return A @ np.swapaxes(A, -1, -2)


@pytest.mark.parametrize("n", SIZES)
def test_cholesky(n: int) -> None:
    A = positive(n)
    L = jax.jit(dense.cholesky)(A)
    np.testing.assert_allclose(L, np.linalg.cholesky(A), rtol=1e-9, atol=1e-12)
    assert (np.triu(L, 1) == 0).all()


def test_cholesky_of_an_indefinite_matrix_is_no_factor() -> None:
    A = np.diag([1.0, -1.0, 2.0])
    assert not np.isfinite(dense.cholesky(A)).all()


@pytest.mark.parametrize("n", SIZES)
@pytest.mark.parametrize("more", [0, 1, 20])
def test_row_triangle(n: int, more: int) -> None:
    A = random(5, n, n + more)
    L = jax.jit(dense.row_triangle)(A)
    size = np.linalg.norm(A, axis=-1)
    error = L @ np.swapaxes(L, -1, -2) - A @ np.swapaxes(A, -1, -2)
    assert (np.abs(error) < 1e-14 * size[..., None] * size[..., None, :]).all()
    assert (np.triu(L, 1) == 0).all()
    assert (np.diagonal(L, axis1=-2, axis2=-1) >= 0).all()


def test_row_triangle_keeps_the_digits_of_rows_whose_squares_underflow() -> None:
    A = random(9, 12)
    scale = 10.0 ** np.linspace(-30, 5, 9)[:, None]
    L = jax.jit(dense.row_triangle)((scale * A).astype(np.float32)).astype(np.float64)
    np.testing.assert_allclose(L / scale, np.linalg.cholesky(A @ A.T), atol=1e-5)


@pytest.mark.parametrize("n", SIZES)
def test_solve_lower(n: int) -> None:
    L, B = np.tril(random(5, n, n)) + 3 * np.eye(n), random(5, n, 4)
    above = np.triu(np.full((n, n), np.nan), 1)
    found = jax.jit(dense.solve_lower)(L + above if n > 1 else L, B)
    np.testing.assert_allclose(found, np.linalg.solve(L, B), rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("n", SIZES)
def test_solve_upper(n: int) -> None:
    L, B = np.tril(random(5, n, n)) + 3 * np.eye(n), random(5, n, 4)
    found = jax.jit(dense.solve_upper)(L, B)
    np.testing.assert_allclose(found, np.linalg.solve(np.swapaxes(L, -1, -2), B), rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("n", SIZES)
def test_solve(n: int) -> None:
    A, B = random(5, n, n), random(5, n, 3)
    A[0, 0, 0] = 0.0 if n > 1 else 1.0  # a pivot that wants an exchange
    X = jax.jit(dense.solve)(A, B)
    conditioned = np.linalg.cond(A).max()
    np.testing.assert_allclose(A @ np.asarray(X), B, atol=1e-14 * n * conditioned)


def test_solve_of_a_singular_matrix_is_not_finite() -> None:
    assert not np.isfinite(dense.solve(np.ones((2, 2)), np.eye(2))).all()


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 9])
@pytest.mark.parametrize("kind", ["random", "diagonal", "equal", "graded", "zero"])
def test_eigh(n: int, kind: str) -> None:
    A = random(20, n, n)
    A = A + np.swapaxes(A, -1, -2)
    A = {
        "random": A,
        "diagonal": A * np.eye(n),
        "equal": np.broadcast_to(3 * np.eye(n), A.shape),
        "graded": A * np.outer(10.0 ** -np.arange(n), 10.0 ** -np.arange(n)),
        "zero": 0 * A,
    }[kind]
    values, V = jax.jit(dense.eigh)(A)
    size = np.abs(A).max(axis=(-2, -1))
    error = np.abs((V * values[:, None]) @ np.swapaxes(V, -1, -2) - A).max(axis=(-2, -1))
    assert (error <= 1e-14 * size).all()
    np.testing.assert_allclose(
        np.swapaxes(V, -1, -2) @ V, np.broadcast_to(np.eye(n), A.shape), rtol=0, atol=1e-14
    )
    wrong = np.abs(np.sort(values) - np.linalg.eigvalsh(A)).max(axis=-1)
    assert (wrong <= 1e-14 * size).all()


@pytest.mark.parametrize("make", [dense.cholesky, dense.row_triangle])
@pytest.mark.parametrize("n", [4, 12])
def test_derivatives(make: Any, n: int) -> None:
    A = jnp.asarray(positive(n)[0])
    check_grads(jax.jit(make), (A,), order=1, modes=["fwd", "rev"], atol=1e-4, rtol=1e-4)


def test_derivative_of_a_solution() -> None:
    A, B = jnp.asarray(random(5, 5)), jnp.asarray(random(5, 2))
    check_grads(jax.jit(dense.solve), (A, B), order=1, modes=["fwd", "rev"], atol=1e-4, rtol=1e-4)
