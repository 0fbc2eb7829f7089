"""The limited-memory adaptive EKF: each of its ideas against its printed form, and what they are good for."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from filters.models import Matrices, TimeVarying, named, random_time_varying, run_jit
from oracles.covariance_kf import Belief, kf_predict
from oracles.filter_models import Friction, Radar, drive
from oracles.robust_filters import last_samples_alone, limited_memory, strong_tracking_update
from roadstate.core.gaussian import Gaussian, Reason
from roadstate.filters import EKF, FuzzyNoise, GateRule, LimitedMemoryEKF, StrongTracking
from roadstate.filters.transitions import SlidingPrediction, Transition

NAN = np.nan


def memory(length: int | None, **options: Any) -> LimitedMemoryEKF:
    return LimitedMemoryEKF(**{"memory": length, "fading": None, "fuzzy": None, **options})


def cov(posteriors: Any, k: int) -> np.ndarray:
    return np.asarray(posteriors.factor[k] @ posteriors.factor[k].T)


def data(n: int = 3, m: int = 2, steps: int = 60) -> tuple[Any, Matrices, np.ndarray, np.ndarray]:
    model, u, dt = random_time_varying(11, n, m, steps)
    return model, u, dt, np.random.default_rng(4).normal(scale=3, size=(steps, m))


@pytest.mark.parametrize("length", [None, 60])
def test_with_all_ideas_off_or_endless_memory_it_is_the_ekf(length: int | None) -> None:
    model, u, dt, z = data()
    z[np.random.default_rng(1).random(z.shape) < 0.3] = NAN
    z[30] = 1e3
    u = jax.tree.map(jnp.asarray, u)
    plain, plain_infos, _ = run_jit(EKF(gate=GateRule()), model, u, z, dt)
    posteriors, infos, _ = run_jit(memory(length, gate=GateRule()), model, u, z, dt)
    np.testing.assert_allclose(posteriors.mean, plain.mean, rtol=1e-10, atol=1e-11)
    np.testing.assert_allclose(posteriors.factor, plain.factor, rtol=1e-10, atol=1e-11)
    for name in ("innovation", "S", "nis", "gate", "reason", "log_likelihood"):
        np.testing.assert_allclose(getattr(infos, name), getattr(plain_infos, name), rtol=1e-9, atol=1e-12)


def test_with_all_ideas_off_it_is_the_ekf_on_a_curved_model() -> None:
    model, steps = Radar(), 50
    z = jnp.asarray([70.0, 0.6]) + jnp.asarray(np.random.default_rng(0).normal(size=(steps, 2)) * [1, 0.01])
    arguments = (model, jnp.zeros(steps), z, jnp.full(steps, 0.1))
    plain, posteriors = run_jit(EKF(), *arguments)[0], run_jit(memory(None), *arguments)[0]
    np.testing.assert_allclose(posteriors.mean, plain.mean, rtol=1e-11)
    np.testing.assert_allclose(posteriors.factor, plain.factor, rtol=1e-10, atol=1e-13)


@pytest.mark.parametrize("length", [5, 8])
def test_is_the_difference_of_informations(length: int) -> None:
    model, u, dt, z = data()
    z[20:24] = NAN  # the memory counts samples, not steps
    there = np.isfinite(z).any(axis=1)
    arrays = jax.tree.map(jnp.asarray, u)
    running = run_jit(EKF(), model, arrays, z, dt)[0]
    posteriors, infos, last = run_jit(memory(length), model, arrays, z, dt)

    beliefs: list[Belief] = []
    expected = Belief(np.asarray(model.start.mean), np.asarray(model.start.cov))
    steps: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    pending = np.eye(3), np.zeros(3), np.zeros((3, 3))
    compared = 0
    for k in range(len(z)):
        F, b, G = np.asarray(u.F[k]), np.asarray(u.b[k]) * dt[k], np.asarray(u.G[k])
        pending = (
            F @ pending[0],
            F @ pending[1] + b,
            F @ pending[2] @ F.T + G @ G.T * dt[k],
        )
        if not there[k]:
            expected = kf_predict(expected, F, b, G @ G.T * dt[k])
        else:
            beliefs.append(Belief(np.asarray(running.mean[k]), cov(running, k)))
            steps.append(pending)
            pending = np.eye(3), np.zeros(3), np.zeros((3, 3))
            expected = beliefs[-1] if len(beliefs) <= length else limited_memory(beliefs, steps, length)
        if infos.reason[k] == Reason.MEMORY_KEPT:
            expected = Belief(np.asarray(posteriors.mean[k]), cov(posteriors, k))
            continue
        compared += 1
        np.testing.assert_allclose(posteriors.mean[k], expected.mean, rtol=1e-5, atol=1e-6)
        scale = np.abs(expected.cov).max()
        np.testing.assert_allclose(cov(posteriors, k), expected.cov, rtol=1e-5, atol=1e-7 * scale)
    assert compared > 50
    np.testing.assert_allclose(last.kalman.gaussian.mean, running.mean[-1], rtol=1e-12)


def test_without_process_noise_it_is_least_squares_on_the_last_samples_alone() -> None:
    """Whatever the samples before them said."""
    length = 6
    model, u, dt, z = data(steps=40)
    turns = np.linalg.qr(u.F)[0]  # where F contracts, what is old weighs ever more
    u = u._replace(F=turns, G=np.zeros_like(u.G), b=np.zeros_like(u.b), c=np.zeros_like(u.c))
    z[:34] += 1e3
    posteriors = run_jit(memory(length), model, jax.tree.map(jnp.asarray, u), z, dt)[0]
    R = [root @ root.T for root in u.L[-length:]]
    alone = last_samples_alone(list(u.F[-length:]), list(u.H[-length:]), R, list(z[-length:]))
    np.testing.assert_allclose(posteriors.mean[-1], alone.mean, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(cov(posteriors, -1), alone.cov, rtol=1e-5, atol=1e-8)


@pytest.mark.parametrize("length", [2, 3, 6, 7])
def test_sliding_prediction_is_predicting_anew(length: int) -> None:
    sliding, rng = SlidingPrediction(length), np.random.default_rng(length)
    start = Gaussian(jnp.zeros(2), jnp.eye(2))
    push = jax.jit(sliding.push)
    state, posteriors, steps = sliding.init(start), [], []
    for k in range(40):
        F, b, G = rng.normal(size=(2, 2)) * 0.6, rng.normal(size=2), np.tril(rng.normal(size=(2, 2)))
        posterior = Gaussian(jnp.asarray(rng.normal(size=2)), jnp.asarray(np.tril(rng.normal(size=(2, 2)))))
        step = Transition(jnp.asarray(F), jnp.asarray(b), jnp.asarray(G))
        if rng.random() < 0.3:  # one that is not taken leaves no trace
            before = state
            state, _ = push(state, step, posterior, jnp.asarray(False))
            for a, c in zip(jax.tree.leaves(before), jax.tree.leaves(state), strict=True):
                np.testing.assert_array_equal(a, c)
        state, predicted = push(state, step, posterior, jnp.asarray(True))
        posteriors.append(posterior)
        steps.append((F, b, G @ G.T))
        assert bool(sliding.full(state)) == (k >= length)
        if k >= length:
            old = posteriors[-1 - length]
            belief = Belief(np.asarray(old.mean), np.asarray(old.cov))
            for F, b, Q in steps[-length:]:
                belief = kf_predict(belief, F, b, Q)
            np.testing.assert_allclose(predicted.mean, belief.mean, rtol=1e-9, atol=1e-10)
            np.testing.assert_allclose(predicted.cov, belief.cov, rtol=1e-9, atol=1e-10)


def test_a_memory_of_one_is_refused() -> None:
    with pytest.raises(ValueError, match="memory of at least 2"):
        SlidingPrediction(1)


def test_what_recent_samples_do_not_tell_stays_the_ekfs() -> None:
    """Braking in a straight line tells two sums of the four apart; the rest is as before."""
    steps = 200
    model, u = Friction(walk=jnp.asarray(1e-4)), drive(steps, 0.01, 0.0)
    z = np.einsum("tij,j->ti", u, np.full(4, 0.5)) + 0.05 * np.random.default_rng(0).normal(size=(steps, 3))
    arguments = (model, jnp.asarray(u), jnp.asarray(z), jnp.full(steps, 0.01))
    plain = run_jit(EKF(), *arguments)[0]
    posteriors, infos, _ = run_jit(memory(20), *arguments)
    assert (infos.reason[20:] == Reason.MEMORY_KEPT).all()
    assert (infos.reason[:20] == Reason.OK).all()
    assert infos.ok.all()
    seen = np.linalg.svd(u[-1])[2]
    for direction, told in ((seen[0], True), (seen[2], False), (seen[3], False)):
        limited, endless = direction @ cov(posteriors, -1) @ direction, direction @ cov(plain, -1) @ direction
        assert limited > 3 * endless if told else limited < 1.001 * endless
    assert (np.linalg.eigvalsh(cov(posteriors, -1)) > 0).all()


def test_fading_is_the_printed_form() -> None:
    model, u, dt, z = data()
    u = u._replace(L=np.where(np.eye(2, dtype=bool), np.abs(u.L) + 0.5, 0), c=np.zeros_like(u.c))
    z[25:] += 8
    method = memory(None, fading=StrongTracking(softening=1.2, largest=30.0))
    posteriors, _, last = run_jit(method, model, jax.tree.map(jnp.asarray, u), z, dt)

    belief = Belief(np.asarray(model.start.mean), np.asarray(model.start.cov))
    seen: list[np.ndarray] = []
    factors = []
    for k in range(len(z)):
        F, b, G, H, _, root = (np.asarray(a[k]) for a in u)
        R = root @ root.T
        belief = kf_predict(belief, F, b * dt[k], G @ G.T * dt[k])
        seen.append((z[k] - H @ belief.mean) ** 2 / np.diag(R))
        V = np.average(seen, axis=0, weights=0.8 ** np.arange(len(seen))[::-1])
        belief, s = strong_tracking_update(belief, H, R, z[k], V, 1.2, 30.0)
        factors.append(s)
        np.testing.assert_allclose(posteriors.mean[k], belief.mean, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(cov(posteriors, k), belief.cov, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(last.fading, factors[-1], rtol=1e-9)
    assert min(factors) == 1
    assert max(factors) > 1


def test_fading_counts_as_process_noise_of_the_memory() -> None:
    """So that what is removed is never more than what is known: fading and memory together stay definite."""
    model, u, dt, z = data()
    z[25:] += 30
    _, infos, _ = run_jit(memory(6, fading=StrongTracking()), model, jax.tree.map(jnp.asarray, u), z, dt)
    assert (infos.reason == Reason.OK).all()


def test_fading_does_not_inflate_what_is_not_seen() -> None:
    """Noise larger than assumed keeps s above 1 for good; with s P⁻ the other directions would overflow."""
    steps = 5000
    model, u = Friction(walk=jnp.asarray(0.0)), drive(1, 0.01, 0.0).repeat(steps, axis=0)
    z = np.einsum("tij,j->ti", u, np.full(4, 0.5)) + 0.2 * np.random.default_rng(0).normal(size=(steps, 3))
    arguments = (model, jnp.asarray(u), jnp.asarray(z), jnp.full(steps, 0.01))
    posteriors, _, last = run_jit(memory(None, fading=StrongTracking()), *arguments)
    assert last.fading >= 1
    assert np.linalg.eigvalsh(cov(posteriors, -1)).max() < 0.3**2 * (1 + 1e-6)
    seen = np.linalg.svd(u[0])[2][0]
    assert seen @ cov(posteriors, -1) @ seen > 10 * 0.05**2 / np.sum(u[0] ** 2) / steps


def test_an_outlier_does_not_open_the_gate_for_itself() -> None:
    steps = 100
    row = Matrices(*(np.asarray(a) for a in ([[1.0]], [0.0], [[0.1]], [[1.0]], [0.0], [[1.0]])))
    u = jax.tree.map(lambda a: jnp.asarray(np.broadcast_to(a, (steps, *a.shape))), row)
    model = TimeVarying(named("x", 1), named("z", 1), Gaussian(jnp.zeros(1), jnp.eye(1)))
    z = np.random.default_rng(0).normal(size=(steps, 1))
    z[60] = 50
    method = memory(None, fading=StrongTracking(), gate=GateRule())
    posteriors, infos, _ = run_jit(method, model, u, jnp.asarray(z), np.ones(steps))
    assert infos.gate[60, 0] == 2
    np.testing.assert_allclose(posteriors.mean[60], posteriors.mean[59], rtol=1e-12)


def joint_road() -> tuple[jax.Array, np.ndarray, jax.Array]:
    """Inputs, truth and samples (seeds, T, 3) of a drive over a joint road: friction 0.2, then 0.8."""
    steps, jump = 700, 300
    u = drive(steps, 0.01, 1.0)
    truth = np.where(np.arange(steps) < jump, 0.2, 0.8)[:, None] * np.ones(4)
    noise = 0.05 * np.random.default_rng(0).normal(size=(30, steps, 3))
    return jnp.asarray(u), truth, jnp.asarray(np.einsum("tij,tj->ti", u, truth) + noise)


IDEAS = {
    "memory": memory(20),
    "fading": memory(None, fading=StrongTracking()),
    "all": LimitedMemoryEKF(),
}


@pytest.mark.parametrize("idea", IDEAS)
def test_each_idea_finds_the_new_friction_where_the_ekf_does_not(idea: str) -> None:
    """Paper 004 §4.1: with its small Q the EKF hardly moves after the joint; a second later these have."""
    u, truth, z = joint_road()
    model, dt = Friction(walk=jnp.asarray(1e-4)), jnp.full(len(truth), 0.01)

    def error(method: Any) -> tuple[float, float]:
        means = jax.vmap(lambda z: run_jit(method, model, u, z, dt)[0].mean)(z)
        apart = np.asarray(means).mean(axis=2) - truth.mean(axis=1)
        return float(np.sqrt(np.mean(apart[:, 400:500] ** 2))), float(
            np.sqrt(np.mean(apart[:, 200:300] ** 2))
        )

    after, before = error(IDEAS[idea])
    assert error(EKF())[0] > 0.4
    assert after < 0.02
    assert before < 0.01


def test_fuzzy_noise_learns_what_is_wrong_about_a_sensor() -> None:
    steps = 3000
    model, u = Friction(walk=jnp.asarray(1e-3)), drive(steps, 0.01, 1.0)
    noise = 0.05 * np.random.default_rng(0).normal(size=(steps, 3)) * [4.0, 1.0, 0.25]
    z = np.einsum("tij,j->ti", u, np.full(4, 0.5)) + noise
    method = memory(None, fuzzy=FuzzyNoise())
    last = run_jit(method, model, jnp.asarray(u), jnp.asarray(z), jnp.full(steps, 0.01))[2]
    np.testing.assert_allclose(np.sqrt(method.fuzzy.scale(last.fuzzy)), [4, 1, 0.25], rtol=0.25)
