"""Adaptive filters against a loop over windows, and what they learn, or must not, of the noise."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from filters.models import Matrices, TimeVarying, named, random_time_varying, run, run_jit, simulate
from oracles.covariance_kf import Belief, kf_predict, kf_update
from oracles.filter_models import Friction, Radar, drive
from oracles.robust_filters import AdaptiveWindow
from roadstate.core.gaussian import Gaussian
from roadstate.filters import EKF, UKF, AdaptiveEKF, AdaptiveUKF, Forgetting, GateRule, Window

NAN = np.nan


def gaps(z: np.ndarray, seed: int = 1) -> np.ndarray:
    z = z.copy()
    z[np.random.default_rng(seed).random(z.shape) < 0.3] = NAN
    return z


def test_is_the_loop_over_windows() -> None:
    """Paper 000's form, mended: each sensor's own last L samples, however many steps ago."""
    model, u, dt = random_time_varying(5, 3, 2, 90)
    u = u._replace(L=np.where(np.eye(2, dtype=bool), u.L + 1, 0))
    z = gaps(np.random.default_rng(0).normal(scale=4, size=(90, 2)))
    method = AdaptiveEKF(average=Window(12), minimum=5, floor=1e-9, ceiling=1e9, centered=False)
    posteriors, _, last = run_jit(method, model, jax.tree.map(jnp.asarray, u), z, dt)

    belief = Belief(np.asarray(model.start.mean), np.asarray(model.start.cov))
    window = AdaptiveWindow(12, 5, np.ones(2))
    for k in range(90):
        F, b, G, H, c, root = (np.asarray(a[k]) for a in u)
        window.nominal = np.diag(root @ root.T)
        belief = kf_predict(belief, F, b * dt[k], G @ G.T * dt[k])
        belief, _ = kf_update(belief, H, c, np.diag(window.variances()), z[k])
        window.learn(belief, H, c, z[k])
        np.testing.assert_allclose(posteriors.mean[k], belief.mean, rtol=1e-8, atol=1e-9)
        cov = posteriors.factor[k] @ posteriors.factor[k].T
        np.testing.assert_allclose(cov, belief.cov, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(method.noise_scale(last), window.variances() / window.nominal, rtol=1e-8)


@pytest.mark.parametrize("full", [False, True])
def test_unscented_is_extended_on_a_linear_model(full: bool) -> None:
    model, u, dt = random_time_varying(6, 4, 3, 60)
    u = jax.tree.map(jnp.asarray, u)
    z = gaps(np.random.default_rng(0).normal(scale=4, size=(60, 3)))
    extended, _, _ = run_jit(AdaptiveEKF(minimum=5, full=full), model, u, z, dt)
    unscented, _, _ = run_jit(AdaptiveUKF(minimum=5, full=full), model, u, z, dt)
    np.testing.assert_allclose(unscented.mean, extended.mean, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(unscented.factor, extended.factor, rtol=1e-7, atol=1e-8)


@eqx.filter_jit
def learned(method: Any, model: Any, world: Any, seeds: int = 100, steps: int = 400) -> Any:
    """What was learned of each sensor's variance (seeds, m) and the last state."""
    u, dt = jnp.zeros(steps), jnp.full(steps, 0.02)

    def one(key: Any) -> Any:
        _, z = simulate(world, u, dt, key)
        last = run(method, model, u, z, dt)[2]
        return method.noise_scale(last), last

    return jax.vmap(one)(jax.random.split(jax.random.PRNGKey(0), seeds))


METHODS = {
    "adaptive-ekf": AdaptiveEKF(average=Window(200)),
    "adaptive-ukf": AdaptiveUKF(average=Window(200)),
    "paper": AdaptiveUKF(average=Window(200), centered=False),
    "sage-husa": AdaptiveEKF(average=Forgetting(0.99)),
    "full": AdaptiveEKF(average=Window(200), full=True),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("range_factor", "bearing_factor"), [(3.0, 0.5), (0.3, 4.0)])
def test_learns_each_sensors_variance(method: str, range_factor: float, bearing_factor: float) -> None:
    world = Radar()
    model = Radar(range_std=1 / range_factor, bearing_std=0.01 / bearing_factor)
    scale = np.asarray(learned(METHODS[method], model, world)[0])
    truth = np.array([range_factor, bearing_factor]) ** 2
    # 200 samples of variance: 10 % each, and 1 % in the mean of 100 runs, were they free of the state's part
    np.testing.assert_allclose(np.mean(scale, axis=0), truth, rtol=0.06)
    assert (np.std(scale, axis=0) / truth < 0.25).all()


def test_innovation_form_learns_where_the_noise_dominates() -> None:
    method = AdaptiveEKF(average=Window(200), statistic="innovation")
    scale = np.asarray(learned(method, Radar(range_std=0.5, bearing_std=0.005), Radar())[0])
    np.testing.assert_allclose(np.median(scale, axis=0), [4, 4], rtol=0.1)


def test_full_learns_correlations() -> None:
    class Pair(Radar):
        def sqrt_R(self, u: Any) -> Any:
            return jnp.asarray([[1.0, 0.0], [0.008, 0.006]])

    method = AdaptiveEKF(average=Window(300), full=True)
    _, last = learned(method, Radar(), Pair())
    factors = jax.vmap(lambda average: method._learned(average, Radar().sqrt_R(None)))(last.average)
    mean = np.mean(np.asarray(factors @ np.swapaxes(factors, 1, 2)), axis=0)
    assert 0.7 < mean[0, 1] / np.sqrt(mean[0, 0] * mean[1, 1]) < 0.9  # is 0.8


def steady(steps: int) -> tuple[TimeVarying, Matrices, np.ndarray]:
    """One state that hardly moves, read directly."""
    row = Matrices(*(np.asarray(a) for a in ([[1.0]], [0.0], [[1e-3]], [[1.0]], [0.0], [[1.0]])))
    u = jax.tree.map(lambda a: jnp.asarray(np.broadcast_to(a, (steps, *a.shape))), row)
    return TimeVarying(named("x", 1), named("z", 1), Gaussian(jnp.zeros(1), jnp.eye(1))), u, np.ones(steps)


@pytest.mark.parametrize("centered", [True, False])
def test_a_step_of_the_state_is_not_noise(centered: bool) -> None:
    """The paper's form takes it for noise, and then disregards the samples that would correct the state."""
    model, u, dt = steady(600)
    z = np.random.default_rng(0).normal(size=(600, 1))
    z[300:] += 20
    method = AdaptiveEKF(centered=centered)
    scale = float(method.noise_scale(run_jit(method, model, u, jnp.asarray(z), dt)[2])[0])
    assert scale < 2 if centered else scale > 50


def test_noise_that_changes_is_followed() -> None:
    model, u, dt = steady(3000)
    u = u._replace(G=jnp.full_like(u.G, 0.1))
    rng = np.random.default_rng(0)
    factor = np.where(np.arange(3000) // 600 % 2 == 0, 0.3, 3.0)[:, None]
    x = np.cumsum(0.1 * rng.normal(size=(3000, 1)), axis=0)
    z = jnp.asarray(x + factor * rng.normal(size=(3000, 1)))

    def error(method: Any) -> float:
        posteriors = run_jit(method, model, u, z, dt)[0]
        return float(np.sqrt(np.mean((np.asarray(posteriors.mean) - x)[100:] ** 2)))

    for plain, adaptive in ((EKF(), AdaptiveEKF()), (UKF(), AdaptiveUKF())):
        assert error(adaptive) < 0.9 * error(plain)


def test_bounds_hold() -> None:
    model, u, dt = steady(200)
    z = 100 * np.random.default_rng(0).normal(size=(200, 1))
    for size, expected in ((1.0, 9.0), (1e-6, 0.25)):
        for full in (False, True):
            method = AdaptiveEKF(floor=0.25, ceiling=9.0, full=full)
            last = run_jit(method, model, u, jnp.asarray(size * z), dt)[2]
            np.testing.assert_allclose(method.noise_scale(last), expected, rtol=1e-12)


def test_nothing_is_learned_before_there_is_enough_nor_without_excitement() -> None:
    steps = 200
    u = drive(steps, 0.01, 1.0)
    u[:15] = 0
    u[100:] = 0
    z = 5 * np.random.default_rng(0).normal(size=(steps, 3))
    z[:, 2] = NAN
    method = AdaptiveEKF(excited=Friction.excited, minimum=30)
    model, dt = Friction(), np.full(steps, 0.01)

    def after(count: int) -> np.ndarray:
        last = run_jit(method, model, jnp.asarray(u[:count]), jnp.asarray(z[:count]), dt[:count])[2]
        return np.asarray(method.noise_scale(last))

    np.testing.assert_allclose(after(44), 1)  # 29 samples while excited
    assert (after(100)[:2] > 1).all()
    np.testing.assert_array_equal(after(200), after(100))
    assert after(200)[2] == 1


@pytest.mark.parametrize("length", [5, 15, 19])
def test_a_window_that_holds_less_than_the_minimum_is_enough_when_full(length: int) -> None:
    """It never was: and where it held more than half of it, now and then."""
    model, u, dt = steady(200)
    z = 100 * np.random.default_rng(0).normal(size=(200, 1))
    method = AdaptiveEKF(average=Window(length), minimum=20)

    def after(count: int) -> float:
        rows = jax.tree.map(lambda a: a[:count], u)
        last = run_jit(method, model, rows, jnp.asarray(z[:count]), dt[:count])[2]
        return float(method.noise_scale(last)[0])

    assert after(length - 1) == 1
    assert all(after(count) > 2 for count in (length, 2 * length - 1, 2 * length, 3 * length + 1))


def test_what_the_gate_refuses_teaches_nothing() -> None:
    model, u, dt = steady(200)
    z = np.random.default_rng(0).normal(size=(200, 1))
    method = AdaptiveEKF(filter=EKF(gate=GateRule()))
    clean = z.copy()
    clean[50:200:7] = NAN
    z[50:200:7] = 1e3
    first, second = (run_jit(method, model, u, jnp.asarray(a), dt)[2] for a in (z, clean))
    np.testing.assert_allclose(method.noise_scale(first), method.noise_scale(second), rtol=1e-12)


@pytest.mark.parametrize(
    "options", [{"statistic": "both"}, {"floor": 0.0}, {"floor": 2.0}, {"ceiling": 0.5}], ids=str
)
def test_refuses_what_cannot_work(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"statistic|floor"):
        AdaptiveEKF(**options)


def test_window_averages_each_entrys_own_last_values() -> None:
    window = Window(4)
    state, seen = window.init((3,), np.float64), [[], [], []]
    rng = np.random.default_rng(0)
    for _ in range(50):
        value, fresh = rng.normal(size=3), rng.random(3) < [0.9, 0.4, 0.1]
        state = window.add(state, jnp.asarray(np.where(fresh, value, NAN)), jnp.asarray(fresh))
        for i in np.flatnonzero(fresh):
            seen[i].append(value[i])
        expected = [np.mean(s[-4:]) if s else 0 for s in seen]
        np.testing.assert_allclose(window.mean(state), expected, rtol=1e-12, atol=1e-15)
        np.testing.assert_array_equal(np.minimum(state.taken, 4), [min(len(s), 4) for s in seen])


def test_forgetting_weights_are_sage_and_husas() -> None:
    average, b = Forgetting(0.9), 0.9
    state, seen = average.init((2,), np.float64), []
    for k in range(40):
        value = np.random.default_rng(k).normal()
        state = average.add(state, jnp.asarray([value, NAN]), jnp.asarray([True, False]))
        seen.append(value)
        weights = b ** np.arange(k, -1, -1)
        np.testing.assert_allclose(average.mean(state), [np.average(seen, weights=weights), 0], rtol=1e-10)
    assert average.span == pytest.approx(np.sum(weights) ** 2 / np.sum(weights**2), rel=0.05)


@pytest.mark.parametrize("make", [lambda: Forgetting(1.0), lambda: Forgetting(0.0), lambda: Window(1)])
def test_averages_refuse_what_does_not_average(make: Any) -> None:
    with pytest.raises(ValueError, match=r"factor|window"):
        make()
