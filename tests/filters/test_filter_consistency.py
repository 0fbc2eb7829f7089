"""Filters on worlds that are as their model says: errors and innovations as large as announced."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2

from filters.models import Bent, run, simulate
from roadstate.filters import KF, UKF

SEEDS, STEPS = 200, 60


@eqx.filter_jit
def trials(method: Any, model: Any, world: Any) -> tuple[Any, Any, Any]:
    """NEES (seeds, T), NIS (seeds, T) and innovations over their own deviation (seeds, T, m)."""
    u = jnp.sin(jnp.arange(STEPS) * 0.3)
    dt = jnp.where(jnp.arange(STEPS) % 3 == 0, 0.2, 0.05)

    def one(key: Any) -> tuple[Any, Any, Any]:
        for_world, for_gaps = jax.random.split(key)
        x, z = simulate(world, u, dt, for_world)
        z = jnp.where(jax.random.bernoulli(for_gaps, 0.2, z.shape), jnp.nan, z)
        posteriors, infos, _ = run(method, model, u, z, dt)
        whitened = jax.vmap(jnp.linalg.solve)(posteriors.factor, x - posteriors.mean)
        spread = jnp.sqrt(jnp.diagonal(infos.S, axis1=1, axis2=2))
        return jnp.sum(whitened**2, axis=1), infos.nis, infos.innovation / spread

    return jax.vmap(one)(jax.random.split(jax.random.PRNGKey(0), SEEDS))


def band(degrees: int) -> tuple[float, float]:
    """The 95 % band of a sum of that many squares, over its expectation."""
    low, high = chi2.ppf([0.025, 0.975], degrees) / degrees
    return float(low), float(high)


CASES = {
    "kf": (KF(), Bent()),
    "ukf": (UKF(), Bent(curvature=jnp.asarray(0.3))),
    "cubature": (UKF(beta=0.0), Bent(curvature=jnp.asarray(0.3))),
}


@pytest.fixture(scope="module", params=CASES)
def result(request: pytest.FixtureRequest) -> tuple[np.ndarray, ...]:
    method, model = CASES[request.param]
    return tuple(np.asarray(a) for a in trials(method, model, model))


def test_nees_lies_in_its_band(result: tuple[np.ndarray, ...]) -> None:
    nees = result[0]
    low, high = band(3 * SEEDS)
    mean = nees.mean(axis=0) / 3
    assert low < mean[-1] < high
    # at any instant it may leave the band one time in twenty; neighbouring instants are alike
    assert np.mean((mean > low) & (mean < high)) > 0.85


def test_nis_lies_in_its_band(result: tuple[np.ndarray, ...]) -> None:
    _, nis, normal = result
    samples = int(np.isfinite(normal).sum())
    low, high = band(samples)
    assert low < nis.sum() / samples < high


def test_innovations_are_white(result: tuple[np.ndarray, ...]) -> None:
    normal = result[2]
    pairs = normal[:, 1:] * normal[:, :-1]
    for lagged in (pairs[..., 0], pairs[..., 1]):
        count = int(np.isfinite(lagged).sum())
        assert abs(np.nanmean(lagged)) < 2.6 / np.sqrt(count)  # 99 %


def test_a_wrong_model_leaves_the_band() -> None:
    """So that the band is one that can be left: a noise taken for half of what it is."""
    boast = Bent(noise=0.5 * Bent().noise, process=0.5 * Bent().process)
    nees = trials(KF(), boast, Bent())[0]
    assert nees[:, -1].mean() / 3 > 2 * band(3 * SEEDS)[1]
