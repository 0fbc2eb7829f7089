"""Polynomials against numpy's functions."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.estimators.trigonometry import arcsin, arctan, sin_cos

WIDE = np.concatenate([[0.0], np.geomspace(1e-12, 1e12, 10_001), np.linspace(0.5, 2.0, 10_001)])
HALF_TURN = np.linspace(0.0, np.pi, 10_001)


def test_arctan() -> None:
    np.testing.assert_allclose(arctan(jnp.asarray(WIDE)), np.arctan(WIDE), rtol=5e-15)


def test_arcsin() -> None:
    x = np.concatenate([WIDE[WIDE < 1], [1.0]])
    np.testing.assert_allclose(arcsin(jnp.asarray(x)), np.arcsin(x), rtol=1e-14)


def test_sine_and_cosine() -> None:
    sine, cosine = sin_cos(jnp.asarray(HALF_TURN))
    np.testing.assert_allclose(sine, np.sin(HALF_TURN), rtol=0, atol=2e-15)
    np.testing.assert_allclose(cosine, np.cos(HALF_TURN), rtol=0, atol=5e-15)


@pytest.mark.parametrize("x", [0.0, 0.3, 0.999, 1.001, 50.0])
def test_derivatives(x: float) -> None:
    np.testing.assert_allclose(jax.grad(arctan)(x), 1 / (1 + x * x), rtol=1e-11)
    angle = np.arctan(x)
    sine, cosine = jax.jacfwd(sin_cos)(angle)
    np.testing.assert_allclose([sine, cosine], [np.cos(angle), -np.sin(angle)], atol=1e-12)


def test_single_precision() -> None:
    x = jnp.asarray(WIDE, jnp.float32)
    assert arctan(x).dtype == jnp.float32
    np.testing.assert_allclose(arctan(x), np.arctan(x.astype(float)), rtol=3e-7)
    angles = jnp.asarray(HALF_TURN, jnp.float32)
    for value, exact in zip(sin_cos(angles), (np.sin, np.cos), strict=True):
        assert value.dtype == jnp.float32
        np.testing.assert_allclose(value, exact(angles.astype(float)), rtol=0, atol=6e-7)
