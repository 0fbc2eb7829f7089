"""The smoother against the whole trajectory solved at once, and against the filter."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from filters.models import Bent, random_time_varying, simulate
from oracles.batch import arrays_of, condition, least_squares, trajectory
from roadstate.consistency import nees, nees_test
from roadstate.core.gaussian import Gaussian
from roadstate.filters import KF, UKF
from roadstate.filters.marginal import MarginalUKF
from roadstate.filters.smoother import smooth

NAN = np.nan


def linear(n: int, m: int, steps: int = 20) -> tuple[Any, Any, Any, Any]:
    model, u, dt = random_time_varying(1, n, m, steps)
    _, z = simulate(model, u, jnp.asarray(dt), jax.random.PRNGKey(0))
    return model, u, jnp.asarray(dt), z.at[5, 1].set(NAN).at[7].set(NAN)


@pytest.mark.parametrize(("n", "m"), [(3, 2), (10, 3)])
def test_it_is_batch_least_squares(n: int, m: int) -> None:
    model, u, dt, z = linear(n, m)
    result = smooth(model, KF(), u, z, dt)
    means, covs = least_squares(**arrays_of(model, u, dt), z=np.asarray(z))
    np.testing.assert_allclose(result.means, means, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(result.factors @ result.factors.mT, covs, rtol=1e-6, atol=1e-8)
    assert (np.triu(result.factors, 1) == 0).all()


@pytest.mark.parametrize("method", [UKF(), UKF(alpha=1e-2), MarginalUKF(), MarginalUKF(exact=True)])
def test_every_gaussian_filter_smooths_a_linear_model_alike(method: Any) -> None:
    model, u, dt, z = linear(3, 2)
    expected, result = smooth(model, KF(), u, z, dt), smooth(model, method, u, z, dt)
    np.testing.assert_allclose(result.means, expected.means, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(result.factors, expected.factors, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize(("n", "noisy"), [(3, 1), (6, 2), (6, 0)])
def test_states_without_noise_and_a_prior_without_rank(n: int, noisy: int) -> None:
    model, u, dt, z = linear(n, 2)
    u = u._replace(G=np.where(np.arange(u.G.shape[-1]) < noisy, u.G, 0))
    factor = jnp.linalg.qr(jnp.zeros((n, n)).at[0].set(1.0).at[1, : n - 1].set(0.3).at[2:].set(0), mode="r").T
    model = type(model)(model.states, model.sensors, Gaussian(model.start.mean, jnp.tril(factor)))
    result = smooth(model, KF(), u, z, dt)
    a = arrays_of(model, u, dt)
    mean, cov = trajectory(a["F"], a["b"], a["Q"], a["mean"], a["cov"])
    mean, cov = condition(mean, cov, a["H"], a["c"], a["R"], np.asarray(z))
    scale = 1 + np.abs(mean).max()
    np.testing.assert_allclose(result.means, mean.reshape(-1, n), atol=1e-8 * scale)
    for k in range(len(z)):
        block = cov[k * n : (k + 1) * n, k * n : (k + 1) * n]
        np.testing.assert_allclose(
            result.factors[k] @ result.factors[k].T, block, atol=1e-8 * (1 + np.abs(cov).max())
        )


def test_the_last_sample_is_the_filters_and_nothing_gets_wider() -> None:
    model, u, dt, z = linear(3, 2)
    result = smooth(model, KF(), u, z, dt)
    np.testing.assert_array_equal(result.means[-1], result.filtered.mean[-1])
    filtered = np.sqrt(np.sum(np.asarray(result.filtered.factor) ** 2, axis=-1))
    assert (np.asarray(result.std) <= filtered * (1 + 1e-9)).all()
    assert (np.asarray(result.std)[:5] < filtered[:5]).any()


def test_a_step_the_filter_refused_is_none() -> None:
    model = Bent()
    u, dt = jnp.sin(jnp.arange(30) * 0.3).at[12].set(NAN), jnp.full(30, 0.1)
    _, z = simulate(model, jnp.nan_to_num(u), dt, jax.random.PRNGKey(0))
    result = smooth(model, KF(), u, z, dt)
    assert np.isfinite(result.means).all()
    assert not result.infos.ok[12]
    np.testing.assert_allclose(result.means[11], result.means[12], rtol=1e-12)


def test_single_precision() -> None:
    model, u, dt, z = linear(4, 2)
    single = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), (model, u, z, dt))
    result = smooth(single[0], KF(), *single[1:])
    assert result.means.dtype == result.factors.dtype == jnp.float32
    expected = smooth(model, KF(), u, z, dt)
    np.testing.assert_allclose(result.means, expected.means, atol=2e-3 * np.abs(expected.means).max())


@pytest.mark.parametrize("method", [KF(), UKF()])
def test_nees_lies_in_its_band(method: Any) -> None:
    """On a curved world for the unscented one: 150 seeds, before, amid and at the end of the samples."""
    curvature = 0.0 if isinstance(method, KF) else 0.3
    model = Bent(curvature=jnp.asarray(curvature))
    steps, seeds = 40, 150
    u, dt = jnp.sin(jnp.arange(steps) * 0.3), jnp.where(jnp.arange(steps) % 3 == 0, 0.2, 0.05)
    x, z = jax.vmap(lambda key: simulate(model, u, dt, key))(jax.random.split(jax.random.PRNGKey(5), seeds))
    result = jax.vmap(lambda z: smooth(model, method, u, z, dt))(z)
    test = nees_test(nees(result.means - x, result.factors), 3)
    assert np.mean(test.inside) > 0.85
    assert test.inside[[0, 20]].all() or np.mean(test.inside) > 0.95
    filtered = np.mean((np.asarray(result.filtered.mean) - x) ** 2)
    assert np.mean((np.asarray(result.means) - x) ** 2) < 0.8 * filtered
