"""The extended Kalman filter against its printed form; the iterated one against the posterior's mode."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

from filters.models import random_time_varying, run_jit, simulate
from oracles.covariance_kf import Belief, kf_predict, kf_update
from oracles.filter_models import Radar
from roadstate.core.gaussian import Gate, Gaussian
from roadstate.filters import EKF, KF, FilterState, GateRule, IteratedEKF
from roadstate.filters.kf import linearize
from roadstate.statespace import StateSpaceModel

NAN = np.nan


def sees(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Range and bearing, and their Jacobian by hand."""
    r2, r = x[0] ** 2 + x[1] ** 2, np.hypot(x[0], x[1])
    H = np.array([[x[0] / r, x[1] / r, 0, 0], [-x[1] / r2, x[0] / r2, 0, 0]])
    return np.array([r, np.arctan2(x[1], x[0])]), H


def test_is_the_printed_form_on_a_curved_model() -> None:
    model, steps, dt = Radar(), 80, 0.3
    u, times = jnp.zeros(steps), jnp.full(steps, dt)
    _, z = simulate(model, u, times, jax.random.PRNGKey(3))
    z = z.at[10:13, 0].set(NAN).at[20:22].set(NAN)
    posteriors, _, _ = run_jit(EKF(), model, u, z, times)

    F = np.eye(4) + dt * np.eye(4, k=2)
    root = np.asarray(model.sqrt_Q(0.0, jnp.asarray(dt)))
    white = np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    np.testing.assert_allclose(root @ root.T, 0.25 * np.kron(white, np.eye(2)), rtol=1e-12)
    belief = Belief(np.asarray(model.mean), np.diag(np.asarray(model.std) ** 2))
    for k in range(steps):
        belief = kf_predict(belief, F, np.zeros(4), root @ root.T)
        z_hat, H = sees(belief.mean)
        belief, _ = kf_update(belief, H, z_hat - H @ belief.mean, np.diag([1.0, 1e-4]), np.asarray(z[k]))
        np.testing.assert_allclose(posteriors.mean[k], belief.mean, rtol=1e-9)
        np.testing.assert_allclose(
            posteriors.factor[k] @ posteriors.factor[k].T, belief.cov, rtol=1e-8, atol=1e-10
        )


def test_linearize_evaluates_once_and_is_right() -> None:
    calls = 0

    def function(x: Any) -> Any:
        nonlocal calls
        calls += 1
        return Radar().h(x, None)

    x = jnp.asarray([3.0, 4.0, 1.0, 2.0])
    value, jacobian = linearize(function, x)
    assert calls == 1
    expected, H = sees(np.asarray(x))
    np.testing.assert_allclose(value, expected, rtol=1e-14)
    np.testing.assert_allclose(jacobian, H, rtol=1e-14)


def test_iterated_is_the_kalman_filter_where_nothing_is_curved() -> None:
    model, u, dt = random_time_varying(5, 4, 3, 40)
    z = np.random.default_rng(0).normal(scale=3, size=(40, 3))
    z[np.random.default_rng(1).random(z.shape) < 0.3] = NAN
    u = jax.tree.map(jnp.asarray, u)
    plain, _, _ = run_jit(KF(), model, u, z, dt)
    iterated, _, _ = run_jit(IteratedEKF(), model, u, z, dt)
    np.testing.assert_allclose(iterated.mean, plain.mean, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(iterated.factor, plain.factor, rtol=1e-8, atol=1e-10)


update = eqx.filter_jit(lambda method, model, state, z: method.update(model, state, None, z))


def start(model: StateSpaceModel) -> FilterState:
    return EKF().init(model)


@pytest.mark.parametrize("z", [(30.0, 1.2), (12.0, 0.3), (75.0, NAN), (NAN, 2.0)])
def test_iterated_finds_the_mode_of_the_posterior(z: tuple[float, float]) -> None:
    model = Radar(mean=(30.0, 20.0, 0.0, 0.0), std=(15.0, 15.0, 1.0, 1.0), bearing_std=0.1)
    state, _ = update(IteratedEKF(iterations=20), model, start(model), jnp.asarray(z))

    there = np.isfinite(z)
    prior, noise = np.array([30.0, 20, 0, 0]), np.array([1.0, 0.1])

    def cost(x: np.ndarray) -> float:
        misfit = ((np.array(z) - sees(x)[0]) / noise)[there]
        return float(np.sum(((x - prior) / [15, 15, 1, 1]) ** 2) + np.sum(misfit**2))

    best = minimize(cost, np.asarray(state.gaussian.mean), tol=1e-14, method="BFGS")
    assert cost(np.asarray(state.gaussian.mean)) <= best.fun + 1e-8
    H = sees(best.x)[1][there]
    information = np.diag([15.0**-2, 15.0**-2, 1, 1]) + H.T @ np.diag(noise[there] ** -2.0) @ H
    np.testing.assert_allclose(state.gaussian.cov, np.linalg.inv(information), rtol=1e-3, atol=1e-4)


class Bend(StateSpaceModel):
    """A sensor on whose flanks a full Gauss–Newton step overshoots without end."""

    states: tuple[str, ...] = eqx.field(default=("x",), static=True)
    sensors: tuple[str, ...] = eqx.field(default=("z",), static=True)
    noise: float = 0.01

    def f(self, x: Any, u: Any, dt: Any) -> Any:
        return x

    def h(self, x: Any, u: Any) -> Any:
        return jnp.arctan(x)

    def sqrt_Q(self, u: Any, dt: Any) -> Any:
        return jnp.zeros((1, 1))

    def sqrt_R(self, u: Any) -> Any:
        return jnp.asarray([[self.noise]])

    def prior(self) -> Gaussian:
        return Gaussian(jnp.asarray([4.0]), jnp.asarray([[10.0]]))


def test_iterated_does_not_run_away_where_full_steps_do() -> None:
    model = Bend()
    plain, _ = update(EKF(), model, start(model), jnp.zeros(1))
    assert plain.gaussian.mean[0] < -15  # one full step: past the answer by far
    state, info = update(IteratedEKF(iterations=10), model, start(model), jnp.zeros(1))
    assert abs(state.gaussian.mean[0]) < 0.02
    np.testing.assert_allclose(state.gaussian.std[0], 0.01, rtol=0.01)
    assert info.ok


def test_iterated_falls_back_to_the_first_step_for_a_sensor_without_noise() -> None:
    model = Bend(noise=0.0)
    first, _ = update(EKF(), model, start(model), jnp.asarray([1.2]))
    state, info = update(IteratedEKF(), model, start(model), jnp.asarray([1.2]))
    np.testing.assert_array_equal(state.gaussian.mean, first.gaussian.mean)
    assert info.ok


def test_iterated_ignores_what_the_gate_refused() -> None:
    model = Radar()
    method = IteratedEKF(gate=GateRule())
    off, info = update(method, model, start(model), jnp.asarray([72.0, 1.4]))
    without, _ = update(method, model, start(model), jnp.asarray([72.0, NAN]))
    np.testing.assert_array_equal(info.gate, [Gate.PASSED, Gate.REJECTED])
    np.testing.assert_allclose(off.gaussian.mean, without.gaussian.mean, rtol=1e-12)
    np.testing.assert_allclose(off.gaussian.factor, without.gaussian.factor, rtol=1e-12, atol=1e-14)


@eqx.filter_jit
def one_update(method: Any, model: Any) -> tuple[Any, Any]:
    """NEES and squared error of positions after one sample, over many draws from the prior."""

    def one(key: Any) -> tuple[Any, Any]:
        for_x, for_v = jax.random.split(key)
        prior = model.prior()
        x = prior.mean + prior.factor @ jax.random.normal(for_x, (4,))
        z = model.h(x, None) + model.sqrt_R(None) @ jax.random.normal(for_v, (2,))
        posterior = method.update(model, method.init(model), None, z)[0].gaussian
        error = x - posterior.mean
        whitened = jax.scipy.linalg.solve_triangular(posterior.factor, error, lower=True)
        return jnp.sum(whitened**2), jnp.sum(error[:2] ** 2)

    return jax.vmap(one)(jax.random.split(jax.random.PRNGKey(0), 2000))


def test_iterating_pays_where_the_sensor_is_sharp_and_curved() -> None:
    model = Radar(std=(15.0, 15.0, 1.0, 1.0), range_std=0.1, bearing_std=0.001)
    plain, iterated = one_update(EKF(), model), one_update(IteratedEKF(), model)
    assert jnp.sqrt(jnp.mean(iterated[1])) < 0.2 * jnp.sqrt(jnp.mean(plain[1]))
    assert 3.88 < jnp.mean(iterated[0]) < 4.12  # the 95 % band
    assert jnp.mean(plain[0]) > 100
