"""The extended H∞ filter against its printed form, its limits, and the worst case it is for."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from filters.models import Matrices, TimeVarying, named, random_time_varying, run, run_jit
from oracles.covariance_kf import Belief, kf_predict
from oracles.filter_models import Friction, drive
from oracles.robust_filters import hinfinity_exists, hinfinity_update
from roadstate.core.gaussian import Gaussian, Reason
from roadstate.filters import EKF, ExtendedHInfinity, GateRule

NAN = np.nan
STEPS = 40


def system(n: int = 4, m: int = 3) -> tuple[Any, Matrices, np.ndarray, np.ndarray]:
    model, u, dt = random_time_varying(7, n, m, STEPS)
    z = np.random.default_rng(2).normal(scale=3, size=(STEPS, m))
    return model, u, dt, z


WEIGHTS = {
    "identity": None,
    "diagonal": np.array([1.0, 0.5, 0.0, 2.0]),
    "matrix": np.array([[1.0, 2.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]]),
}


@pytest.mark.parametrize("weight", WEIGHTS)
def test_is_the_printed_form(weight: str) -> None:
    model, u, dt, z = system()
    L = WEIGHTS[weight]
    method = ExtendedHInfinity(theta=0.02, weight=None if L is None else jnp.asarray(L))
    posteriors, infos, last = run_jit(method, model, jax.tree.map(jnp.asarray, u), z, dt)
    rows = np.eye(4) if L is None else np.diag(L) if L.ndim == 1 else L
    S_bar = rows.T @ rows

    belief = Belief(np.asarray(model.start.mean), np.asarray(model.start.cov))
    full = 0
    for k in range(STEPS):
        F, b, G, H, c, root = (np.asarray(a[k]) for a in u)
        belief = kf_predict(belief, F, b * dt[k], G @ G.T * dt[k])
        if infos.reason[k] == Reason.OK:
            full += 1
            R = root @ root.T
            assert hinfinity_exists(belief, H, R, 0.02, S_bar)
            belief = hinfinity_update(belief, H, c, R, z[k], 0.02, S_bar)
            cov = posteriors.factor[k] @ posteriors.factor[k].T
            np.testing.assert_allclose(posteriors.mean[k], belief.mean, rtol=1e-8, atol=1e-8)
            np.testing.assert_allclose(cov, belief.cov, rtol=1e-8, atol=1e-8)
        belief = Belief(
            np.asarray(posteriors.mean[k]), np.asarray(posteriors.factor[k] @ posteriors.factor[k].T)
        )
    assert full > STEPS // 2
    assert last.theta == 0.02


@pytest.mark.parametrize("theta", [0.0, 1e-14])
def test_without_theta_it_is_the_ekf(theta: float) -> None:
    model, u, dt, z = system()
    z[np.random.default_rng(1).random(z.shape) < 0.3] = NAN
    u = jax.tree.map(jnp.asarray, u)
    plain, plain_infos, _ = run_jit(EKF(gate=GateRule()), model, u, z, dt)
    robust, infos, _ = run_jit(ExtendedHInfinity(theta=theta, gate=GateRule()), model, u, z, dt)
    np.testing.assert_allclose(robust.mean, plain.mean, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(robust.factor, plain.factor, rtol=1e-10, atol=1e-10)
    np.testing.assert_array_equal(infos.gate, plain_infos.gate)
    np.testing.assert_allclose(infos.nis, plain_infos.nis, rtol=1e-9)


def test_too_much_theta_is_reduced_and_told() -> None:
    model, u, dt, z = system()
    u = jax.tree.map(jnp.asarray, u)
    theta = 1e3
    posteriors, infos, last = run_jit(ExtendedHInfinity(theta=theta), model, u, z, dt)
    assert (infos.reason == Reason.THETA_REDUCED).all()
    assert infos.ok.all()
    assert last.theta < theta
    assert np.isfinite(posteriors.mean).all()
    assert (np.diagonal(posteriors.factor, axis1=1, axis2=2) > 0).all()


def test_theta_is_reduced_no_further_than_needed() -> None:
    """One state: P⁺ is the printed one up to ceiling/θ, stays there, and beyond that is the EKF's."""
    one = Matrices(*(jnp.asarray(a) for a in ([[1.0]], [0.0], [[0.0]], [[1.0]], [0.0], [[1.0]])))
    theta = 0.5
    method = ExtendedHInfinity(theta=theta)
    update = eqx.filter_jit(method.update)
    for variance in np.geomspace(0.01, 1e4, 40):
        model = TimeVarying(("x",), ("z",), Gaussian(jnp.zeros(1), jnp.asarray([[np.sqrt(variance)]])))
        state, info = update(model, method.init(model), one, jnp.ones(1))
        plain = variance / (1 + variance)
        printed = 1 / (1 / plain - theta)
        expected = max(plain, min(printed, 1 / theta) if printed > 0 else 1 / theta)
        np.testing.assert_allclose(method.posterior(state).cov[0, 0], expected, rtol=1e-10)
        assert (info.reason == Reason.THETA_REDUCED) == (theta * plain > 0.5)
        # so no update ever makes an error larger than it was
        assert abs(1 - method.posterior(state).mean[0]) <= 1


def test_what_is_not_seen_does_not_grow() -> None:
    """Steady braking never tells four wheels apart; a margin on θλ alone would blow P up without end."""
    steps = 20_000
    model = Friction(walk=jnp.asarray(0.0))
    u = jnp.asarray(drive(1, 0.01, 0.0)).repeat(steps, axis=0)
    z = jnp.einsum("tij,j->ti", u, jnp.full(4, 0.5))
    method = ExtendedHInfinity(theta=30.0)
    posteriors, infos, _ = run_jit(method, model, u, z, jnp.full(steps, 0.01))
    assert (infos.reason[-100:] == Reason.THETA_REDUCED).all()
    assert np.linalg.eigvalsh(posteriors.factor[-1] @ posteriors.factor[-1].T).max() < 0.3**2 + 1e-9
    assert np.isfinite(posteriors.mean).all()


def test_no_sample_no_theta() -> None:
    model, u, dt, z = system()
    z[20:] = NAN
    u = jax.tree.map(jnp.asarray, u)
    posteriors, infos, last = run_jit(ExtendedHInfinity(theta=0.02), model, u, z, dt)
    assert (infos.reason[20:] == Reason.NO_MEASUREMENT).all()
    assert last.theta == 0
    F, _, G, *_ = u
    P = posteriors.factor[30] @ posteriors.factor[30].T
    expected = F[31] @ P @ F[31].T + G[31] @ G[31].T * dt[31]
    np.testing.assert_allclose(posteriors.factor[31] @ posteriors.factor[31].T, expected, rtol=1e-10)


def worst_gain(method: Any) -> float:
    """Largest ratio of the energy of the errors to that of all that disturbs: prior, w and v."""
    steps, n, m = 30, 2, 1
    F, G = np.array([[1.0, 0.1], [0.0, 1.0]]), 0.1 * np.eye(2)
    H, root = np.array([[1.0, 0.0]]), np.array([[0.5]])
    row = Matrices(*(jnp.asarray(a) for a in (F, np.zeros(n), G, H, np.zeros(m), root)))
    u = jax.tree.map(lambda a: jnp.broadcast_to(a, (steps, *a.shape)), row)
    model = TimeVarying(named("x", n), named("z", m), Gaussian(jnp.zeros(n), jnp.eye(n)))

    def errors(disturbance: Any) -> Any:
        start, w, v = disturbance[:n], disturbance[n : n + n * steps], disturbance[n + n * steps :]

        def body(x: Any, row: Any) -> Any:
            w, v = row
            x = F @ x + G @ w
            return x, (x, H @ x + root @ v)

        x, z = jax.lax.scan(body, start, (w.reshape(steps, n), v.reshape(steps, m)))[1]
        posteriors, infos, _ = run(method, model, u, z, jnp.ones(steps))
        return (x - posteriors.mean).ravel(), infos.reason

    size = n + (n + m) * steps
    gain, reasons = jax.jit(jax.jacfwd(errors, has_aux=True))(jnp.zeros(size))
    assert (reasons == Reason.OK).all()
    return float(np.linalg.norm(gain, 2) ** 2)


def test_the_worst_case_is_bounded() -> None:
    """The energy gain from any disturbance stays below 1/θ, and below the Kalman filter's."""
    plain = worst_gain(EKF())
    for theta in (0.1, 0.2):
        robust = worst_gain(ExtendedHInfinity(theta=theta))
        assert robust < 1 / theta
        assert robust < (1 - 1.5 * theta) * plain


def test_theta_is_a_leaf() -> None:
    """A sweep over θ compiles once."""
    model, u, dt, z = system()
    u = jax.tree.map(jnp.asarray, u)
    methods = eqx.filter_vmap(lambda theta: ExtendedHInfinity(theta=theta))(jnp.asarray([0.0, 0.01, 0.02]))
    sizes = eqx.filter_jit(
        eqx.filter_vmap(lambda f: jnp.sum(run(f, model, u, z, dt)[0].factor[-1] ** 2), in_axes=(0,))
    )(methods)
    assert sizes[0] < sizes[1] < sizes[2]
