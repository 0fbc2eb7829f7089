"""A covariance stays one: 10⁵ steps in single precision where a covariance form would long have failed."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from filters.models import Matrices, TimeVarying, named
from oracles.covariance_kf import Belief, kf_update
from roadstate.core.gaussian import Gaussian
from roadstate.filters import KF, UKF

STEPS = 100_000
# one sensor a million times better than the others, and one state without noise
NOISE = np.diag([1e-6, 1.0, 1.0])
SENSORS = np.array([[1.0, 0, 0, 0.5], [0, 1, 0, 0], [1, 1, 1, 1]])
# a prior that is singular to seven digits
PRIOR = np.array([[1.0, 0, 0, 0], [1, 1e-7, 0, 0], [1, 0, 1e-7, 0], [1, 0, 0, 1e-7]])
PROCESS = np.array([[0.0, 0], [1e-3, 0], [0, 1e-4], [0, 0]])


def transition(dt: float) -> np.ndarray:
    return np.eye(4) + np.diag([dt, dt, 0], 1)


@eqx.filter_jit
def walk(method: Any, dtype: Any) -> tuple[Any, Any, Any]:
    """Smallest pivot and whether all is finite over the steps, and the last state: driving, then standing."""
    model = TimeVarying(
        named("x", 4), named("z", 3), Gaussian(jnp.zeros(4, dtype), jnp.asarray(PRIOR, dtype))
    )
    standing = Matrices(
        *(jnp.asarray(a, dtype) for a in (np.eye(4), np.zeros(4), PROCESS, SENSORS, np.zeros(3), NOISE))
    )

    def body(carry: Any, k: Any) -> tuple[Any, None]:
        state, least, sound = carry
        drives = k < STEPS // 2
        u = standing._replace(F=jnp.where(drives, jnp.asarray(transition(0.01), dtype), standing.F))
        # sensors come and go, each at its own rate; the noise is a fixed pattern of its size
        noise = jnp.asarray(np.diag(NOISE), dtype) * jnp.sin(jnp.asarray([1.0, 2.0, 3.0], dtype) * k)
        z = jnp.where(k % jnp.asarray([3, 2, 5]) == 0, noise, jnp.nan)
        state, info = method.step(model, state, u, z, jnp.where(drives, 0.01, 0.0).astype(dtype))
        least = jnp.minimum(least, jnp.min(jnp.diagonal(state.gaussian.factor)))
        spread = method.posterior(state).std
        return (state, least, sound & info.ok & jnp.all(jnp.isfinite(spread)) & jnp.all(spread > 0)), None

    start = (method.init(model), jnp.asarray(jnp.inf, dtype), jnp.asarray(True))
    (state, least, sound), _ = jax.lax.scan(body, start, jnp.arange(STEPS))
    return least, sound, state.gaussian


@pytest.fixture(scope="module")
def exact() -> np.ndarray:
    return np.asarray(walk(KF(), jnp.float64)[2].std)


@pytest.mark.parametrize(
    ("method", "low", "high"),
    [
        (KF(), 0.9, 1.1),
        (UKF(), 0.9, 1.1),
        # differences of points that lie α apart keep 1/α fewer digits: cautious, not wrong
        (UKF(alpha=1e-3), 0.8, 10),
    ],
    ids=["kf", "ukf", "ukf-small-alpha"],
)
def test_single_precision_stays_definite(method: Any, low: float, high: float, exact: np.ndarray) -> None:
    least, sound, last = walk(method, jnp.float32)
    assert last.factor.dtype == jnp.float32
    assert sound
    assert least >= 0
    ratio = np.asarray(last.std) / exact
    assert (ratio > low).all()
    assert (ratio < high).all()


def test_the_covariance_form_fails_here() -> None:
    """So that the test above is one: P = (I − K H) P in single precision loses definiteness at once."""
    prior = Belief(np.zeros(4, np.float32), (PRIOR @ PRIOR.T).astype(np.float32))
    H, R = SENSORS.astype(np.float32), (NOISE**2).astype(np.float32)
    posterior, _ = kf_update(prior, H, np.zeros(3, np.float32), R, np.zeros(3, np.float32))
    assert np.linalg.eigvalsh(posterior.cov.astype(float)).min() < 0
