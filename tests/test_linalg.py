"""Square-root algebra against its definitions."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from oracles.covariance_kf import Belief, kf_update
from roadstate.core.kernel import once
from roadstate.linalg import Correction, correct, product, solve_lower, tria

# a compiled program per shape; the sizes lie on both sides of the change from unrolled code to LAPACK
tria_jit = jax.jit(tria)
correct_jit = jax.jit(correct)
SIZES = [(1, 1), (3, 3), (3, 9), (8, 8), (8, 20), (9, 9), (9, 20), (15, 34)]


def random(seed: int, *shape: int, dtype: Any = np.float64) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=shape).astype(dtype)


def check_factor(A: np.ndarray, L: Any, tolerance: float) -> None:
    assert L.shape == (len(A), len(A))
    assert L.dtype == A.dtype
    assert (np.triu(L, 1) == 0).all()
    assert (np.diagonal(L) >= 0).all()
    A64, L64 = A.astype(np.float64), np.asarray(L, np.float64)
    # row by row: a factor is good to the size of each row, however different rows are
    size = np.linalg.norm(A64, axis=1)
    np.testing.assert_array_less(
        np.abs(L64 @ L64.T - A64 @ A64.T), tolerance * np.outer(size, size) + np.finfo(np.float64).tiny
    )


class TestTria:
    @pytest.mark.parametrize(("n", "k"), SIZES)
    def test_is_the_cholesky_factor(self, n: int, k: int) -> None:
        A = random(n * k, n, k)
        L = tria_jit(A)
        check_factor(A, L, 1e-14)
        np.testing.assert_allclose(L, np.linalg.cholesky(A @ A.T), rtol=1e-9, atol=1e-12)

    @pytest.mark.parametrize(("n", "k"), SIZES)
    def test_single_precision(self, n: int, k: int) -> None:
        A = random(n * k, n, k, dtype=np.float32)
        check_factor(A, tria_jit(A), 3e-6)

    @pytest.mark.parametrize("dtype", [np.float64, np.float32])
    @pytest.mark.parametrize(("n", "k"), [(4, 9), (9, 20)])
    def test_rank_deficient(self, n: int, k: int, dtype: Any) -> None:
        A = random(1, n, k, dtype=dtype)
        tolerance = 20 * n * np.finfo(dtype).eps
        for make in (
            lambda A: np.zeros_like(A),
            lambda A: np.where(np.arange(n)[:, None] == 1, 0, A),
            lambda A: np.where(np.arange(n)[:, None] == n - 1, A[0] - 2 * A[1], A),
            lambda A: np.outer(np.arange(n), A[0]),
            lambda A: A * 10.0 ** -np.arange(0, 3 * n, 3)[:, None],
            lambda A: np.where(np.arange(k) < 2, A, 0),
            lambda A: np.where(np.arange(n)[:, None] > 0, A[0] * (1 + 3 * np.finfo(dtype).eps), A),
        ):
            deficient = make(A).astype(dtype)
            check_factor(deficient, tria_jit(deficient), tolerance)

    @pytest.mark.parametrize(("n", "k"), [(3, 7), (9, 20)])
    def test_derivative(self, n: int, k: int) -> None:
        A, direction, weight = random(3, n, k), random(4, n, k), random(5, n, n)

        def value(A: Any) -> Any:
            return jnp.sum(weight * tria(A))

        slope = jnp.vdot(jax.jit(jax.grad(value))(A), direction)
        step = 1e-6
        numeric = (value(A + step * direction) - value(A - step * direction)) / (2 * step)
        assert float(slope) == pytest.approx(float(numeric), rel=1e-6)

    def test_derivative_is_finite_where_rows_vanish(self) -> None:
        A = random(3, 3, 7)
        A[1] = 0
        gradient = jax.jit(jax.grad(lambda A: jnp.sum(tria(A))))(A)
        assert np.isfinite(gradient).all()
        assert np.isfinite(jax.jit(jax.grad(lambda A: jnp.sum(tria(A))))(np.zeros((3, 7)))).all()

    def test_vectorises(self) -> None:
        A = random(1, 5, 3, 7)
        np.testing.assert_allclose(jax.vmap(tria)(A), np.stack([tria_jit(a) for a in A]), atol=1e-14)


@pytest.mark.parametrize(("n", "k", "m"), [(1, 1, 1), (3, 9, 2), (8, 3, 8), (9, 3, 2), (2, 3, 9)])
def test_product(n: int, k: int, m: int) -> None:
    A, B = random(1, n, k), random(2, k, m)
    np.testing.assert_allclose(product(A, B), A @ B, atol=1e-13)


@pytest.mark.parametrize("n", [1, 4, 8, 9, 12])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_solve_lower(n: int, dtype: Any) -> None:
    L = np.tril(random(n, n, n, dtype=dtype)) + 3 * np.eye(n, dtype=dtype)
    b = random(n + 1, n, dtype=dtype)
    x = jax.jit(solve_lower)(L, b)
    assert x.dtype == dtype
    np.testing.assert_allclose(L @ np.asarray(x), b, atol=100 * np.finfo(dtype).eps)


def test_once_is_the_identity_with_its_derivative() -> None:
    tree = {"a": jnp.asarray([1.0, 2.0]), "b": jnp.asarray(3)}
    assert jax.tree.map(np.asarray, once(tree))["a"].tolist() == [1.0, 2.0]
    assert jax.grad(lambda x: once(x) ** 2)(3.0) == 6.0
    np.testing.assert_array_equal(jax.vmap(once)(jnp.arange(3)), np.arange(3))


class Case:
    """A Gaussian and a linear measurement, as arrays and as covariances."""

    def __init__(self, seed: int, n: int, m: int, k: int, dtype: Any = np.float64) -> None:
        self.X = random(seed, n, k, dtype=dtype)
        self.H = random(seed + 1, m, n, dtype=dtype)
        self.sqrt_R = random(seed + 2, m, m, dtype=dtype)  # full: the sensors' errors are correlated
        self.innovation = random(seed + 3, m, dtype=dtype)
        self.prior = Belief(np.zeros(n), self.X.astype(float) @ self.X.astype(float).T)

    def correct(self, used: Any) -> Correction:
        return correct_jit(self.X, self.H @ self.X, self.sqrt_R, self.innovation, jnp.asarray(used))

    def check(self, used: Any, tolerance: float) -> None:
        result = self.correct(used)
        z = np.where(used, self.innovation, np.nan).astype(float)
        R = self.sqrt_R.astype(float) @ self.sqrt_R.T.astype(float)
        posterior, told = kf_update(self.prior, self.H.astype(float), np.zeros(len(z)), R, z)
        factor = np.asarray(result.factor, float)
        close = partial(np.testing.assert_allclose, rtol=tolerance, atol=tolerance)
        close(result.delta, posterior.mean)
        close(factor @ factor.T, posterior.cov)
        close(result.nis, told.nis)
        close(result.log_det, np.log(np.linalg.det(told.S)) if told.S.size else 0)


class TestCorrect:
    @pytest.mark.parametrize(
        ("n", "m", "k"), [(1, 1, 1), (3, 2, 3), (3, 4, 6), (4, 3, 4), (9, 3, 18), (2, 9, 4)]
    )
    def test_is_the_kalman_update(self, n: int, m: int, k: int) -> None:
        case = Case(n + 10 * m, n, m, k)
        masks = [np.ones(m, bool), np.zeros(m, bool), np.arange(m) % 2 == 0, np.arange(m) != 0]
        for used in masks:
            case.check(used, 1e-10)

    def test_single_precision(self) -> None:
        case = Case(5, 3, 2, 6, np.float32)
        for used in ([True, True], [True, False]):
            case.check(np.array(used), 1e-4)
            assert {x.dtype for x in case.correct(used)} == {np.dtype(np.float32)}

    @pytest.mark.parametrize("rubbish", [np.nan, np.inf, 1e300])
    def test_a_sensor_left_out_has_no_effect_at_all(self, rubbish: float) -> None:
        case = Case(7, 3, 3, 6)
        used = np.array([True, False, True])
        expected = case.correct(used)
        case.innovation[1] = rubbish
        case.sqrt_R[1] = 1e9
        case.H[1] = 1e9
        for a, b in zip(case.correct(used), expected, strict=True):
            np.testing.assert_array_equal(a, b)

    def test_no_sensor_leaves_the_state(self) -> None:
        case = Case(8, 3, 2, 6)
        result = case.correct([False, False])
        np.testing.assert_array_equal(result.delta, 0)
        assert result.nis == 0
        assert result.log_det == 0
        np.testing.assert_allclose(result.factor @ result.factor.T, case.prior.cov, atol=1e-13)

    def test_a_perfect_sensor(self) -> None:
        """R = 0 pins the state down to what the sensor says and does no more."""
        case = Case(9, 3, 1, 3)
        case.sqrt_R[:] = 0
        result = case.correct([True])
        assert float(case.H[0] @ result.delta) == pytest.approx(case.innovation[0], abs=1e-12)
        np.testing.assert_allclose(case.H @ result.factor, 0, atol=1e-12)

    def test_gradients_are_finite_with_sensors_left_out(self) -> None:
        case = Case(10, 3, 3, 6)
        case.innovation[1] = np.nan

        def value(X: Any, sqrt_R: Any) -> Any:
            used = jnp.isfinite(case.innovation)
            result = correct(X, product(case.H, X), sqrt_R, case.innovation, used)
            return jnp.sum(result.delta) + jnp.sum(result.factor**2) + result.nis + result.log_det

        gradient = jax.jit(jax.grad(value, argnums=(0, 1)))
        for X in (case.X, np.zeros_like(case.X)):
            dX, dR = gradient(X, case.sqrt_R)
            assert np.isfinite(dX).all()
            assert np.isfinite(dR).all()
            np.testing.assert_array_equal(dR[1], 0)
