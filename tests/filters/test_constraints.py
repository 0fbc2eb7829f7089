"""Bounds: truncation against integration, and a covariance that claims nothing a bound did not give."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import truncnorm

from filters.models import random_time_varying, run, run_jit
from oracles.filter_models import Friction, drive
from roadstate.core.gaussian import Gaussian, Reason
from roadstate.filters import EKF, UKF, Bounded, ExtendedHInfinity, LimitedMemoryEKF, project, truncate
from roadstate.filters.constraints import truncated_moments

INF, NAN = np.inf, np.nan
truncate_jit, project_jit = jax.jit(truncate), jax.jit(project)


def arrays(*values: Any, dtype: Any = np.float64) -> list[jax.Array]:
    return [jnp.asarray(v, dtype) for v in values]


@pytest.mark.parametrize(
    ("low", "high"),
    [(-1.0, 2.0), (0.0, INF), (-INF, 0.5), (-3.0, INF), (3.0, INF), (-INF, -7.0), (-0.5, -0.4), (2.0, 2.01)],
)
def test_truncated_moments_are_scipys(low: float, high: float) -> None:
    mean, variance = truncated_moments(*arrays(low, high))
    np.testing.assert_allclose(mean, truncnorm.mean(low, high), rtol=1e-9)
    np.testing.assert_allclose(variance, truncnorm.var(low, high), rtol=1e-6)


@pytest.mark.parametrize("low", [12.0, 100.0, 1e6])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_truncated_moments_far_in_the_tail(low: float, dtype: Any) -> None:
    """Where density is exp(−low t): mean low + 1/low, variance 1/low², up to their next terms."""
    mean, variance = truncated_moments(*arrays(low, INF, dtype=dtype))
    assert mean.dtype == dtype
    np.testing.assert_allclose(mean - low, 1 / low, rtol=0.02, atol=low * np.finfo(dtype).eps)
    np.testing.assert_allclose(variance, low**-2, rtol=0.05)
    mirrored = truncated_moments(*arrays(-INF, -low, dtype=dtype))
    np.testing.assert_array_equal(mirrored[0], -mean)
    np.testing.assert_array_equal(mirrored[1], variance)


def test_truncated_moments_have_derivatives() -> None:
    for low, high in ((-1.0, 2.0), (3.0, INF), (-INF, -2.0), (-INF, INF)):
        slope = jax.grad(lambda a, b: sum(truncated_moments(a, b)), argnums=(0, 1))(*arrays(low, high))
        assert np.isfinite(slope).all()


def spread(seed: int, n: int = 3) -> Gaussian:
    rng = np.random.default_rng(seed)
    return Gaussian(
        jnp.asarray(rng.normal(size=n)), jnp.asarray(np.tril(rng.normal(size=(n, n))) + np.eye(n))
    )


@pytest.mark.parametrize("component", [0, 1, 2])
def test_one_bounded_component_is_exact(component: int) -> None:
    """Given the component, the others are Gaussian as before: so all moments follow from one dimension."""
    gaussian = spread(component)
    mean, P = np.asarray(gaussian.mean), np.asarray(gaussian.cov)
    std = np.sqrt(P[component, component])
    low, high = mean[component] + 0.4 * std, mean[component] + 1.9 * std

    def moment(power: int) -> float:
        def density(x: float) -> float:
            return float(np.exp(-0.5 * ((x - mean[component]) / std) ** 2))

        return quad(lambda x: x**power * density(x), low, high)[0] / quad(density, low, high)[0]

    first, variance = moment(1), moment(2) - moment(1) ** 2
    gain = P[:, component] / std**2
    expected = P - np.outer(gain, gain) * (std**2 - variance)
    lower, upper = np.full(3, -INF), np.full(3, INF)
    lower[component], upper[component] = low, high
    cut = truncate_jit(gaussian, *arrays(lower, upper))
    np.testing.assert_allclose(cut.mean, mean + gain * (first - mean[component]), rtol=1e-9)
    np.testing.assert_allclose(cut.cov, expected, rtol=1e-8, atol=1e-10)
    assert (np.triu(cut.factor, 1) == 0).all()


def test_several_bounds_are_close_to_integration() -> None:
    """The components' order matters a little; brute force says how little."""
    gaussian = Gaussian(*arrays([0.3, 0.9], [[0.4, 0.0], [0.2, 0.3]]))
    cut = truncate_jit(gaussian, *arrays([0.0, 0.0], [1.0, 1.0]))
    draws = np.random.default_rng(0).normal(size=(2_000_000, 2)) @ np.asarray(gaussian.factor).T
    draws += np.asarray(gaussian.mean)
    draws = draws[((draws > 0) & (draws < 1)).all(axis=1)]
    np.testing.assert_allclose(cut.mean, draws.mean(axis=0), atol=0.02)
    np.testing.assert_allclose(cut.cov, np.cov(draws.T), atol=0.006)


def test_bounds_that_are_far_away_do_nothing() -> None:
    gaussian = spread(5)
    cut = truncate_jit(gaussian, *arrays(np.full(3, -1e3), np.full(3, INF)))
    np.testing.assert_allclose(cut.mean, gaussian.mean, rtol=1e-12)
    np.testing.assert_allclose(cut.cov, gaussian.cov, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("far", [2.0, 50.0, 1e5])
def test_stays_definite_and_within_however_far_out_the_mean_is(far: float, dtype: Any) -> None:
    mean, factor, lower, upper = arrays(
        [far, -far, 0.5], [[0.1, 0, 0], [0.05, 0.1, 0], [1.0, 1.0, 1e-6]], [0, 0, 0], [1, 1, 1], dtype=dtype
    )
    cut = truncate_jit(Gaussian(mean, factor), lower, upper)
    assert cut.factor.dtype == dtype
    assert ((cut.mean >= 0) & (cut.mean <= 1)).all()
    assert (np.diagonal(cut.factor) > 0).all()
    # a mean that far out is the model's fault; the bound is not taken for a measurement of 1/far of the std
    assert cut.std[0] > 0.02


def test_a_state_known_exactly_stays() -> None:
    gaussian = Gaussian(*arrays([0.5, 2.0], [[0.0, 0.0], [0.0, 1.0]]))
    cut = truncate_jit(gaussian, *arrays([0.0, 0.0], [1.0, 1.0]))
    assert cut.mean[0] == 0.5
    assert cut.std[0] == 0
    assert np.isfinite(cut.factor).all()


def test_projection_is_the_nearest_point_within() -> None:
    gaussian = spread(2)
    P, mean = np.asarray(gaussian.cov), np.asarray(gaussian.mean)
    bound = float(mean[1]) + 0.7
    moved = project_jit(gaussian, *arrays([-INF, bound, -INF], [INF, INF, INF]))
    np.testing.assert_allclose(moved.mean, mean + P[:, 1] / P[1, 1] * 0.7, rtol=1e-12)
    np.testing.assert_array_equal(moved.factor, gaussian.factor)


def problem() -> tuple[Any, ...]:
    steps = 300
    u = drive(steps, 0.01, 1.0)
    z = np.einsum("tij,j->ti", u, np.array([0.02, 0.02, 0.9, 0.9]))
    z += 0.5 * np.random.default_rng(0).normal(size=z.shape)
    model = Friction(walk=jnp.asarray(0.05), noise=jnp.asarray(0.5))
    return model, jnp.asarray(u), jnp.asarray(z), jnp.full(steps, 0.01)


FILTERS = {"ekf": EKF(), "ukf": UKF(), "h-infinity": ExtendedHInfinity(), "lm-aekf": LimitedMemoryEKF()}


@pytest.mark.parametrize("name", FILTERS)
def test_any_filter_can_be_bounded(name: str) -> None:
    method = Bounded(FILTERS[name], lower=0.0, upper=1.0)
    posteriors, infos, last = run_jit(method, *problem())
    assert ((posteriors.mean >= 0) & (posteriors.mean <= 1)).all()
    assert np.isfinite(posteriors.factor).all()
    assert infos.ok.all()
    inside = FILTERS[name].posterior(last)
    assert ((inside.mean >= 0) & (inside.mean <= 1)).all()
    assert (infos.reason == Reason.PROJECTED).any()


def test_without_feedback_the_filter_inside_is_untouched() -> None:
    arguments = problem()
    method = Bounded(EKF(), lower=0.0, upper=1.0, feedback=False)
    plain = run_jit(EKF(), *arguments)[2]
    _, infos, last = run_jit(method, *arguments)
    # another program, compiled otherwise: the same to rounding
    np.testing.assert_allclose(last.gaussian.mean, plain.gaussian.mean, rtol=1e-10, atol=1e-13)
    assert not (infos.reason == Reason.PROJECTED).any()


def test_without_bounds_it_is_the_filter() -> None:
    model, u, dt = random_time_varying(5, 3, 2, 40)
    z = np.random.default_rng(0).normal(scale=3, size=(40, 2))
    arguments = (model, jax.tree.map(jnp.asarray, u), z, dt)
    plain, bounded = run_jit(EKF(), *arguments)[0], run_jit(Bounded(EKF()), *arguments)[0]
    np.testing.assert_allclose(bounded.mean, plain.mean, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(bounded.factor, plain.factor, rtol=1e-11, atol=1e-12)


def test_checking_a_bound_again_and_again_teaches_nothing() -> None:
    """10 000 steps without a sample leave the covariance as it was."""
    model, u, *_ = problem()
    steps = 10_000
    idle, nothing = jnp.broadcast_to(u[0], (steps, 3, 4)), jnp.full((steps, 3), NAN)
    method = Bounded(EKF(), lower=0.0, upper=1.0)
    still = Friction(walk=jnp.asarray(0.0))
    posteriors = run_jit(method, still, idle, nothing, jnp.full(steps, 0.01))[0]
    np.testing.assert_allclose(posteriors.factor[-1], posteriors.factor[0], rtol=1e-9, atol=1e-12)
    # what would become of it if the truncated Gaussian were fed back, and why it is not
    fed_back = model.prior()
    for _ in range(100):
        fed_back = truncate_jit(fed_back, jnp.zeros(4), jnp.ones(4))
    assert (fed_back.std < 0.7 * posteriors.factor[0].diagonal()).all()


def test_bounds_help_and_the_interval_still_holds() -> None:
    """Friction near zero under strong noise: smaller errors than unbounded, and 2σ that cover."""
    model, u, _, dt = problem()
    truth = jnp.asarray([0.05, 0.05, 0.1, 0.1])

    def one(key: Any) -> tuple[Any, Any, Any]:
        z = jnp.einsum("tij,j->ti", u, truth) + 0.5 * jax.random.normal(key, (len(u), 3))
        method = Bounded(EKF(), lower=0.0, upper=1.2)
        plain, bounded = run(EKF(), model, u, z, dt)[0], run(method, model, u, z, dt)[0]
        std = jnp.sqrt(jnp.sum(bounded.factor**2, axis=2))
        return plain.mean - truth, bounded.mean - truth, std

    plain, bounded, std = jax.jit(jax.vmap(one))(jax.random.split(jax.random.PRNGKey(0), 100))
    settled = slice(100, None)
    assert np.sqrt(np.mean(bounded[:, settled] ** 2)) < 0.8 * np.sqrt(np.mean(plain[:, settled] ** 2))
    assert np.mean(np.abs(bounded[:, settled]) < 2 * std[:, settled]) > 0.93


@pytest.mark.parametrize("bounds", [(1.0, 1.0), (1.0, 0.0), ([0.0, 2.0], [1.0, 1.0]), (NAN, 1.0)])
def test_bounds_that_leave_no_room_are_refused(bounds: tuple[Any, Any]) -> None:
    with pytest.raises(ValueError, match="below"):
        Bounded(EKF(), lower=jnp.asarray(bounds[0]), upper=jnp.asarray(bounds[1]))
