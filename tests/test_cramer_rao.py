"""The posterior Cramér–Rao bound against the Kalman filter, the textbook recursion, and errors that occur."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from filters.models import Bent, random_time_varying, run, run_jit, simulate
from oracles.filter_models import Radar
from roadstate.core.gaussian import Gaussian
from roadstate.cramer_rao import cramer_rao_bound
from roadstate.filters import EKF, KF
from roadstate.statespace import StateSpaceModel


def test_on_a_linear_gaussian_system_it_is_the_kalman_filters_covariance() -> None:
    model, u, dt = random_time_varying(2, 4, 2, 25)
    states, z = simulate(model, u, jnp.asarray(dt), jax.random.PRNGKey(0))
    present = np.random.default_rng(0).random(z.shape) < 0.7
    posterior = run_jit(KF(), model, u, jnp.where(present, z, jnp.nan), jnp.asarray(dt))[0]
    bound = cramer_rao_bound(model, states, u, jnp.asarray(dt), present=present)  # type: ignore[arg-type]
    np.testing.assert_allclose(bound.factor, posterior.factor, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(bound.std**2, np.einsum("tij,tij->ti", posterior.factor, posterior.factor))
    # in a linear world every drive is as good as another: several make no difference
    several = cramer_rao_bound(model, jnp.stack([states, 3 * states]), u, jnp.asarray(dt), present=present)  # type: ignore[arg-type]
    np.testing.assert_allclose(several.factor, bound.factor, rtol=1e-8, atol=1e-10)


@pytest.fixture(scope="module")
def radar() -> tuple[Any, Any, Any]:
    """A model near enough to curve, 400 drives of it (M, T, n) and (M, T, m), and the steps."""
    model = Radar(range_std=0.5, bearing_std=0.02, mean=(25.0, 10.0, -2.0, 1.0))
    dt = jnp.full(50, 0.1)
    keys = jax.random.split(jax.random.PRNGKey(1), 400)
    x, z = jax.vmap(lambda key: simulate(model, jnp.zeros(50), dt, key))(keys)
    return model, (x, z), dt


def information(model: Any, x: np.ndarray, dt: np.ndarray) -> np.ndarray:
    """Covariances by the recursion of Tichavský et al. as it is printed, with inverses of Q, of M drives."""
    F_of, H_of = (
        jax.jit(jax.jacfwd(model.f), static_argnums=1),
        jax.jit(jax.jacfwd(model.h), static_argnums=1),
    )
    prior = np.asarray(model.prior().cov)
    J, out = np.linalg.inv(prior), []
    R = np.asarray(model.sqrt_R(None) @ model.sqrt_R(None).T)
    for k in range(x.shape[1]):
        root = np.asarray(model.sqrt_Q(None, jnp.asarray(dt[k])))
        Q = np.linalg.inv(root @ root.T)
        F = np.stack([F_of(a, None, dt[k]) for a in x[:, max(k - 1, 0)]])
        H = np.stack([H_of(a, None) for a in x[:, k]])
        D11 = np.mean(F.transpose(0, 2, 1) @ Q @ F, axis=0)
        D12 = -np.mean(F, axis=0).T @ Q
        D22 = Q + np.mean(H.transpose(0, 2, 1) @ np.linalg.inv(R) @ H, axis=0)
        J = D22 - D12.T @ np.linalg.inv(J + D11) @ D12
        out.append(np.linalg.inv(J))
    return np.array(out)


@pytest.mark.parametrize("which", ["radar", "bent"])
def test_it_is_the_recursion_in_information_form(radar: Any, which: str) -> None:
    """Of 6 drives; :class:`Bent` curves in f as well, so that V is not zero."""
    if which == "radar":
        model, (x, _), dt = radar
        x, dt = np.asarray(x)[:6, :20], np.asarray(dt)[:20]
    else:
        model, dt = Bent(curvature=jnp.asarray(0.8)), np.full(20, 0.1)
        keys = jax.random.split(jax.random.PRNGKey(0), 6)
        x = np.asarray(jax.vmap(lambda key: simulate(model, jnp.zeros(20), jnp.asarray(dt), key)[0])(keys))
    inputs = jnp.zeros(len(dt))
    found = cramer_rao_bound(model, x, inputs, dt).factor  # type: ignore[arg-type]
    given = jax.tree.map(lambda a: a, model)
    if which == "bent":
        given = Unforced(model)
    np.testing.assert_allclose(found @ found.mT, information(given, x, dt), rtol=1e-6, atol=1e-10)


class Unforced:
    """A model whose input is zero, whatever it is given."""

    def __init__(self, model: Any) -> None:
        self.prior, self.sqrt_R = model.prior, model.sqrt_R
        self.sqrt_Q = model.sqrt_Q
        self.f = lambda x, u, dt: model.f(x, 0.0, dt)
        self.h = lambda x, u: model.h(x, 0.0)


def test_no_filters_errors_are_below_it(radar: Any) -> None:
    """EKF over 400 drives: no state's RMSE lies below the bound by more than 3.5 times its noise."""
    model, (x, z), dt = radar
    posterior = eqx.filter_jit(jax.vmap(lambda z: run(EKF(), model, jnp.zeros(50), z, dt)[0].mean))(z)
    rmse = np.sqrt(np.mean((np.asarray(posterior) - x) ** 2, axis=0))
    bound = np.asarray(cramer_rao_bound(model, x, None, dt).std)
    assert (rmse > bound * (1 - 3.5 / np.sqrt(2 * 400))).all()
    # and it is a bound worth having: this filter comes near it
    assert np.median(rmse[10:] / bound[10:]) < 1.25


def test_of_one_drive_it_is_the_filter_that_linearises_at_the_truth(radar: Any) -> None:
    model, (x, _), dt = radar
    bound = cramer_rao_bound(model, x[0], None, dt)
    P = np.asarray(model.prior().cov)
    R = np.asarray(model.sqrt_R(None) @ model.sqrt_R(None).T)
    for k in range(50):
        F = np.asarray(jax.jacfwd(lambda a, k=k: model.f(a, None, dt[k]))(x[0, max(k - 1, 0)]))
        H = np.asarray(jax.jacfwd(lambda a: model.h(a, None))(x[0, k]))
        root = np.asarray(model.sqrt_Q(None, dt[k]))
        P = F @ P @ F.T + root @ root.T
        P = P - P @ H.T @ np.linalg.solve(H @ P @ H.T + R, H @ P)
        np.testing.assert_allclose(bound.factor[k] @ bound.factor[k].T, P, rtol=1e-7, atol=1e-9)


class Dragged(StateSpaceModel):
    """Position and a speed that drag slows, pushed by one noise: Q has rank 1, and F varies."""

    states: tuple[str, ...] = eqx.field(default=("p", "v"), static=True)
    sensors: tuple[str, ...] = eqx.field(default=("p",), static=True)
    floor: Any = eqx.field(default=0.0, converter=jnp.asarray)

    def f(self, x: Any, u: Any, dt: Any) -> Any:
        return jnp.stack([x[0] + dt * x[1], x[1] - 0.3 * dt * x[1] ** 2])

    def h(self, x: Any, u: Any) -> Any:
        return x[:1]

    def sqrt_Q(self, u: Any, dt: Any) -> Any:
        return jnp.stack(
            [jnp.stack([dt / 2, self.floor]), jnp.stack([jnp.ones_like(dt), self.floor])]
        ) * jnp.sqrt(dt)

    def sqrt_R(self, u: Any) -> Any:
        return jnp.full((1, 1), 0.2)

    def prior(self) -> Gaussian:
        return Gaussian(jnp.asarray([0.0, 3.0]), jnp.eye(2))


def test_noise_in_one_direction_only() -> None:
    """There is no inverse of Q; the bound is a number, between those of one drive and of no variation."""
    model, dt = Dragged(), jnp.full(20, 0.1)
    keys = jax.random.split(jax.random.PRNGKey(0), 50)
    x = jax.vmap(lambda key: simulate(model, jnp.zeros(20), dt, key)[0])(keys)
    bound = np.asarray(cramer_rao_bound(model, x, None, dt).std)
    assert np.isfinite(bound).all()
    linear = np.asarray(cramer_rao_bound(model, jnp.mean(x, axis=0), None, dt).std)
    assert (bound[1:] < 1.1 * linear[1:]).all()
    assert (bound[1:] > 0.5 * linear[1:]).all()


def test_a_step_of_no_time_teaches_nothing() -> None:
    model, dt = Dragged(), jnp.zeros(3)
    x = jnp.ones((5, 3, 2)) * jnp.arange(1.0, 6)[:, None, None]
    bound = cramer_rao_bound(model, x, None, dt, present=jnp.zeros((3, 1), bool))
    np.testing.assert_allclose(bound.std, 1.0, rtol=1e-12)
