"""The grade as a process of the distance, against matrix exponentials and Van Loan's integral."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from roadstate.estimators.road import GradePrior

STD, LENGTH = 0.04, 150.0
RATE = np.sqrt(3) / LENGTH
# dy = A y ds + noise of intensity W: its stationary standard deviations must come out as σ and λσ
A = np.array([[0, 1], [-(RATE**2), -2 * RATE]])
W = np.diag([0, 4 * RATE**3 * STD**2])
DISTANCES = [1e-6, 1e-3, 0.01, 0.15, 1.0, 4.32, 4.34, 20.0, 150.0, 700.0, 1e4]


@pytest.fixture(scope="module")
def parts() -> Any:
    """(transition, √Q) at a distance, compiled once."""
    prior = GradePrior(jnp.asarray(STD), jnp.asarray(LENGTH))
    return jax.jit(lambda d: (prior.transition(d), prior.sqrt_Q(d)))


def van_loan(distance: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition and noise covariance (Van Loan 1978), over pieces short enough for its exponentials."""
    pieces = max(1, int(np.ceil(distance / 50)))
    block = np.block([[-A, W], [np.zeros((2, 2)), A.T]]) * distance / pieces
    exponential = expm(block)
    F = exponential[2:, 2:].T
    Q = F @ exponential[:2, 2:]
    step_F, step_Q = F, Q
    for _ in range(pieces - 1):
        F, Q = step_F @ F, step_F @ Q @ step_F.T + step_Q
    return F, Q


@pytest.mark.parametrize("distance", DISTANCES)
def test_is_the_exact_discretisation(parts: Any, distance: float) -> None:
    F, root = (np.asarray(a) for a in parts(distance))
    np.testing.assert_allclose(F, expm(A * distance), rtol=1e-9, atol=1e-300)
    _, Q = van_loan(distance)
    assert root[0, 1] == 0
    assert (np.diagonal(root) >= 0).all()
    # Van Loan's own difference keeps fewer digits of the smallest entry the shorter the distance
    if distance >= 0.01:
        np.testing.assert_allclose(root @ root.T, Q, rtol=1e-6, atol=1e-18)
    x = RATE * distance
    if x < 1e-3:  # the leading terms of the integral, whose next ones are smaller by x
        leading = np.array([[x**3 / 3, RATE * x**2 / 2], [RATE * x**2 / 2, RATE**2 * x]]) * 4 * STD**2
        np.testing.assert_allclose(root @ root.T, leading, rtol=4 * x + 1e-9)


@pytest.mark.parametrize("distance", [0.02, 3.0, 60.0])
def test_a_car_that_backs_up_sees_the_road_turned_round(parts: Any, distance: float) -> None:
    """The same process in the other direction: what changes sign is dθ/ds."""
    turn = np.diag([1.0, -1.0])
    (F, root), (back, back_root) = parts(distance), parts(-distance)
    np.testing.assert_allclose(back, turn @ F @ turn, rtol=1e-12)
    np.testing.assert_allclose(back_root @ back_root.T, turn @ root @ root.T @ turn, rtol=1e-12)


def test_no_distance_changes_nothing(parts: Any) -> None:
    F, root = parts(0.0)
    np.testing.assert_array_equal(F, np.eye(2))
    np.testing.assert_allclose(root, 0, atol=1e-150)


def test_far_away_nothing_is_known(parts: Any) -> None:
    prior = GradePrior(jnp.asarray(STD), jnp.asarray(LENGTH))
    np.testing.assert_allclose(prior.stationary_std, [STD, RATE * STD])
    for distance in (1e4, 1e9):
        F, root = parts(distance)
        np.testing.assert_allclose(F, 0, atol=1e-40)
        np.testing.assert_allclose(root, np.diag([STD, RATE * STD]), rtol=1e-12, atol=1e-40)


@given(st.floats(0, 2000), st.floats(0, 2000))
def test_two_steps_are_one(parts: Any, first: float, second: float) -> None:
    """F(a+b) = F(b) F(a) and Q(a+b) = F(b) Q(a) F(b)ᵀ + Q(b)."""
    (F1, L1), (F2, L2), (F, L) = (
        tuple(np.asarray(a) for a in parts(d)) for d in (first, second, first + second)
    )
    np.testing.assert_allclose(F2 @ F1, F, rtol=1e-9, atol=1e-15)
    scale = np.outer([STD, RATE * STD], [STD, RATE * STD])
    np.testing.assert_allclose((F2 @ L1 @ L1.T @ F2.T + L2 @ L2.T) / scale, L @ L.T / scale, atol=1e-7)


@given(st.floats(1e-3, 1e4))
def test_the_road_stays_as_hilly_as_it_is(parts: Any, distance: float) -> None:
    F, root = (np.asarray(a) for a in parts(distance))
    stationary = np.diag([STD**2, (RATE * STD) ** 2])
    scale = np.sqrt(np.outer(np.diag(stationary), np.diag(stationary)))
    np.testing.assert_allclose((F @ stationary @ F.T + root @ root.T) / scale, stationary / scale, atol=1e-7)
    x = RATE * distance
    assert F[0, 0] == pytest.approx((1 + x) * np.exp(-x), rel=1e-9)  # the documented correlation


@pytest.mark.parametrize("distance", [0.0, 1e-9, 1e-6, 1e-3, 0.15, 4.32, 4.34, 150.0, 1e4, 1e6])
def test_single_precision(parts: Any, distance: float) -> None:
    prior = GradePrior(jnp.asarray(STD, jnp.float32), jnp.asarray(LENGTH, jnp.float32))
    F, root = prior.transition(jnp.float32(distance)), prior.sqrt_Q(jnp.float32(distance))
    assert F.dtype == root.dtype == jnp.float32
    expected_F, expected_root = parts(distance)
    np.testing.assert_allclose(F, expected_F, rtol=1e-5, atol=1e-6)
    # one part in a thousand where the exact form takes over from the series, exact elsewhere
    np.testing.assert_allclose(root, expected_root, rtol=2e-3, atol=1e-12)


def test_derivatives_are_finite_from_standstill_on() -> None:
    @jax.jit
    @jax.vmap
    def slope(distance: Any) -> Any:
        def total(std: Any, length: Any, distance: Any) -> Any:
            prior = GradePrior(std, length)
            return jnp.sum(prior.transition(distance)) + jnp.sum(prior.sqrt_Q(distance))

        return jnp.stack(jax.grad(total, argnums=(0, 1, 2))(jnp.asarray(STD), jnp.asarray(LENGTH), distance))

    assert np.isfinite(slope(jnp.asarray([0.0, 1e-12, *DISTANCES]))).all()
