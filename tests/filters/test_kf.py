"""The square-root Kalman filter against the covariance form, and what every Gaussian filter shares."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from filters.models import Bent, TimeVarying, random_time_varying, run, run_jit
from oracles.covariance_kf import Belief, kf_predict, kf_update
from roadstate.core.gaussian import Gate, Reason
from roadstate.filters import KF

NAN = np.nan


@pytest.mark.parametrize(("n", "m"), [(1, 1), (2, 3), (4, 2), (9, 3)])
def test_is_the_covariance_form(n: int, m: int) -> None:
    steps = 60
    model, u, dt = random_time_varying(10 * n + m, n, m, steps)
    random = np.random.default_rng(n)
    z = random.normal(scale=3, size=(steps, m))
    z[random.random(z.shape) < 0.3] = NAN
    z[5:9] = NAN
    posteriors, infos, _ = run_jit(KF(), model, jax.tree.map(jnp.asarray, u), z, dt)

    belief = Belief(np.asarray(model.start.mean), np.asarray(model.start.cov))
    for k in range(steps):
        F, b, G, H, c, L = (np.asarray(a[k]) for a in u)
        belief = kf_predict(belief, F, b * dt[k], G @ G.T * dt[k])
        S = H @ belief.cov @ H.T + L @ L.T
        belief, told = kf_update(belief, H, c, L @ L.T, z[k])
        there = np.isfinite(z[k])
        scale = np.abs(belief.cov).max()
        np.testing.assert_allclose(posteriors.mean[k], belief.mean, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(
            posteriors.factor[k] @ posteriors.factor[k].T, belief.cov, rtol=1e-10, atol=1e-10 * scale
        )
        np.testing.assert_allclose(infos.innovation[k][there], told.innovation, rtol=1e-10, atol=1e-10)
        assert np.isnan(infos.innovation[k][~there]).all()
        np.testing.assert_allclose(infos.S[k], S, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(infos.nis[k], told.nis, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(infos.log_likelihood[k], told.log_likelihood, rtol=1e-9, atol=1e-12)
        assert infos.ok[k]
        assert infos.reason[k] == (Reason.OK if there.any() else Reason.NO_MEASUREMENT)
    assert (infos.gate == Gate.NOT_TESTED).all()


def test_log_likelihood_is_the_normal_density() -> None:
    model, u, dt = random_time_varying(3, 3, 3, 4)
    z = np.random.default_rng(0).normal(size=(4, 3))
    z[1, 1] = z[2, [0, 2]] = z[3] = NAN
    _, infos, _ = run_jit(KF(), model, jax.tree.map(jnp.asarray, u), z, dt)
    for k in range(4):
        there = np.isfinite(z[k])
        S = np.asarray(infos.S[k])[np.ix_(there, there)]
        z_hat = z[k][there] - np.asarray(infos.innovation[k])[there]
        expected = multivariate_normal(z_hat, S).logpdf(z[k][there]) if there.any() else 0.0
        assert float(infos.log_likelihood[k]) == pytest.approx(expected, rel=1e-12)


@pytest.fixture(scope="module")
def bent() -> tuple[Bent, dict[str, Any]]:
    random = np.random.default_rng(1)
    steps = 20
    arrays = {
        "u": random.normal(size=steps),
        "z": random.normal(size=(steps, 2)),
        "dt": np.full(steps, 0.1),
    }
    return Bent(), arrays


def test_an_infinite_sample_is_missing(bent: tuple[Bent, dict[str, Any]]) -> None:
    model, arrays = bent
    z = {x: arrays["z"].copy() for x in (NAN, np.inf)}
    for x in z:
        z[x][4, 0] = z[x][7] = x
    nan, inf = (run_jit(KF(), model, **{**arrays, "z": values}) for values in z.values())
    for a, b in zip(jax.tree.leaves(nan), jax.tree.leaves(inf), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("rubbish", [NAN, np.inf, -np.inf])
def test_an_input_that_is_not_finite_costs_one_step(
    bent: tuple[Bent, dict[str, Any]], rubbish: float
) -> None:
    model, arrays = bent
    u = arrays["u"].copy()
    u[5] = rubbish
    posteriors, infos, _ = run_jit(KF(), model, **{**arrays, "u": u})
    np.testing.assert_array_equal(infos.ok, np.arange(len(u)) != 5)
    assert infos.reason[5] == Reason.NOT_FINITE
    np.testing.assert_array_equal(posteriors.mean[5], posteriors.mean[4])
    np.testing.assert_array_equal(posteriors.factor[5], posteriors.factor[4])
    for leaf in jax.tree.leaves((posteriors, infos)):
        assert np.isfinite(leaf).all()
    clean, _, _ = run_jit(KF(), model, **arrays)
    np.testing.assert_allclose(posteriors.mean[-1], clean.mean[-1], atol=0.2)  # and is forgotten


def test_an_update_that_overflows_is_not_made(bent: tuple[Bent, dict[str, Any]]) -> None:
    model, arrays = bent
    z = arrays["z"].copy()
    z[3] = [1.7e308, -1.7e308]
    posteriors, infos, _ = run_jit(KF(), model, **{**arrays, "z": z})
    assert not infos.ok[3]
    assert infos.reason[3] == Reason.NOT_FINITE
    missing = arrays["z"].copy()
    missing[3] = NAN
    predicted, _, _ = run_jit(KF(), model, **{**arrays, "z": missing})
    np.testing.assert_allclose(posteriors.mean, predicted.mean, rtol=1e-12)  # the prediction goes on


def test_an_exactly_known_state_stays_so() -> None:
    """P = 0 and Q = 0: nothing can be learned, and nothing breaks."""
    model, u, dt = random_time_varying(5, 2, 1, 10)
    known = dataclasses.replace(model.start, factor=jnp.zeros((2, 2)))
    model = TimeVarying(model.states, model.sensors, known)
    u = jax.tree.map(jnp.asarray, u._replace(G=0 * u.G))
    posteriors, infos, _ = jax.jit(run, static_argnums=0)(KF(), model, u, np.ones((10, 1)), dt)
    np.testing.assert_array_equal(posteriors.factor, 0)
    assert np.asarray(infos.ok).all()
