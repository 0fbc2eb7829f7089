"""The particle filter against Bayes' rule on a grid, the Kalman filter, and its own promises."""

from __future__ import annotations

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from filters.models import Bent, run, run_jit, simulate
from oracles.grid import grid_filter
from roadstate.core.gaussian import Gate, Gaussian, Reason
from roadstate.core.numerics import loop_options
from roadstate.filters import KF
from roadstate.filters.base import GateRule
from roadstate.filters.jitter import Regularization, Roughening
from roadstate.filters.particle import ParticleFilter
from roadstate.filters.resampling import RESAMPLING
from roadstate.filters.weighted import effective_number
from roadstate.statespace import StateSpaceModel

STEPS = 25


class Scalar(StateSpaceModel):
    """x⁺ = f(x) + q √Δt w, z = h(x) + r v, of one state; ``kind`` says which functions."""

    states: tuple[str, ...] = eqx.field(default=("x",), static=True)
    sensors: tuple[str, ...] = eqx.field(default=("z",), static=True)
    kind: str = eqx.field(default="growth", static=True)
    q: Any = eqx.field(default=np.sqrt(10.0), converter=jnp.asarray)
    r: Any = eqx.field(default=1.0, converter=jnp.asarray)
    mean: Any = eqx.field(default=0.0, converter=jnp.asarray)
    std: Any = eqx.field(default=2.0, converter=jnp.asarray)

    def f(self, x: Any, u: Any, dt: Any) -> Any:
        if self.kind == "growth":
            return x / 2 + 25 * x / (1 + x**2) + u
        return jnp.sqrt(x) if self.kind == "root" else x

    def h(self, x: Any, u: Any) -> Any:
        if self.kind == "growth":
            return x**2 / 20
        return jnp.log(x) if self.kind == "log" else x

    def sqrt_Q(self, u: Any, dt: Any) -> Any:
        return (self.q * jnp.sqrt(dt)).reshape(1, 1)

    def sqrt_R(self, u: Any) -> Any:
        return self.r.reshape(1, 1)

    def prior(self) -> Gaussian:
        return Gaussian(self.mean.reshape(1), self.std.reshape(1, 1))


@eqx.filter_jit
def begun(method: ParticleFilter, model: StateSpaceModel) -> Any:
    return method.init(model)


@eqx.filter_jit
def stepped(method: ParticleFilter, model: StateSpaceModel, state: Any, z: Any, dt: Any) -> Any:
    """One step of a model whose input is zero, and the posterior after it."""
    state, info = method.step(model, state, jnp.zeros((), dt.dtype), z, dt)
    return state, info, method.posterior(state)


@eqx.filter_jit
def predicted(method: ParticleFilter, model: StateSpaceModel, state: Any, u: Any, dt: Any) -> Any:
    return method.predict(model, state, u, dt)


@eqx.filter_jit
def updated(method: ParticleFilter, model: StateSpaceModel, state: Any, u: Any, z: Any) -> Any:
    return method.update(model, state, u, z)[0]


@pytest.fixture(scope="module")
def growth() -> dict[str, Any]:
    """Gordon, Salmond and Smith's growth model: the square hides the sign, so the posterior has two modes."""
    u = 8 * np.cos(1.2 * np.arange(STEPS))
    _, z = simulate(Scalar(), jnp.asarray(u), jnp.ones(STEPS), jax.random.PRNGKey(4))
    return {"u": jnp.asarray(u), "z": z.at[7].set(jnp.nan), "dt": jnp.ones(STEPS)}


@pytest.fixture(scope="module")
def exact(growth: dict[str, Any]) -> tuple[np.ndarray, ...]:
    return grid_filter(
        lambda x, u: x / 2 + 25 * x / (1 + x**2) + u,
        lambda x: x**2 / 20,
        np.sqrt(10.0),
        1.0,
        0.0,
        2.0,
        np.asarray(growth["u"]),
        np.asarray(growth["z"])[:, 0],
        np.linspace(-45, 45, 2401),
    )


@pytest.mark.parametrize("name", RESAMPLING)
def test_it_is_bayes_rule(growth: dict[str, Any], exact: tuple[np.ndarray, ...], name: str) -> None:
    """Errors are measured in what N_eff allows, σ/√N; the grid's own are far below."""
    method = ParticleFilter(particles=20_000, resampling=name)
    posteriors, infos, _ = run_jit(method, Scalar(), **growth)
    mean, std, log_likelihood = exact
    error = (np.asarray(posteriors.mean)[:, 0] - mean) / std
    assert np.sqrt(np.mean(error**2)) < 4 / np.sqrt(20_000)
    assert np.abs(error).max() < 0.08
    # a mode far away that has next to no weight is a matter of few particles, and moves σ by some tenths
    assert np.median(np.abs(np.asarray(posteriors.factor[:, 0, 0]) / std - 1)) < 0.02
    np.testing.assert_allclose(infos.log_likelihood, log_likelihood, atol=0.08)


def test_the_case_has_two_modes_that_no_kalman_filter_could_follow(
    growth: dict[str, Any], exact: tuple[np.ndarray, ...]
) -> None:
    """So that the test above says something: σ is at times far above that of one mode."""
    assert exact[1].max() > 5
    linear = run_jit(KF(), Scalar(), **growth)[0]
    assert np.sqrt(np.mean(((np.asarray(linear.mean)[:, 0] - exact[0]) / exact[1]) ** 2)) > 1


@pytest.fixture(scope="module")
def linear() -> dict[str, Any]:
    u, dt = jnp.sin(jnp.arange(STEPS) * 0.3), jnp.full(STEPS, 0.1)
    _, z = simulate(Bent(), u, dt, jax.random.PRNGKey(2))
    return {"u": u, "z": z.at[4, 0].set(jnp.nan), "dt": dt}


# hundreds of runs of hundreds of particles each
@partial(eqx.filter_jit, compiler_options={k: 1 for k in loop_options() if k.endswith("optimization_level")})
def seeds(method: Any, model: Any, data: dict[str, Any], count: int) -> tuple[Any, Any]:
    """Means (seeds, T, n) and log-likelihoods (seeds,) of the whole run."""

    def one(seed: Any) -> tuple[Any, Any]:
        own = eqx.tree_at(lambda m: m.seed, method, seed)
        posteriors, infos, _ = run(own, model, **data)
        return posteriors.mean, jnp.sum(infos.log_likelihood)

    return jax.vmap(one)(jnp.arange(count))


def test_error_falls_with_the_root_of_the_number_of_particles(linear: dict[str, Any]) -> None:
    expected = run_jit(KF(), Bent(), **linear)[0].mean
    numbers = np.array([80, 320, 1280])
    error = [
        np.sqrt(
            np.mean(
                (np.asarray(seeds(ParticleFilter(particles=int(n)), Bent(), linear, 60)[0]) - expected) ** 2
            )
        )
        for n in numbers
    ]
    slope = np.polyfit(np.log(numbers), np.log(error), 1)[0]
    assert slope == pytest.approx(-0.5, abs=0.06)


@pytest.mark.parametrize("threshold", [0.5, 1.0])
@pytest.mark.parametrize("name", RESAMPLING)
def test_the_likelihood_is_without_bias_whatever_the_scheme(
    linear: dict[str, Any], name: str, threshold: float
) -> None:
    """E[p̂(z)] = p(z) for any N, if resampling is unbiased and weights are carried on (Del Moral 2004)."""
    exact = float(jnp.sum(run_jit(KF(), Bent(), **linear)[1].log_likelihood))
    method = ParticleFilter(particles=300, resampling=name, threshold=threshold)
    ratio = np.exp(np.asarray(seeds(method, Bent(), linear, 400)[1]) - exact)
    assert abs(ratio.mean() - 1) < 4 * ratio.std() / np.sqrt(len(ratio))
    assert ratio.std() < 2  # so that the bound above is one


def cloud(count: int = 20_000) -> tuple[Any, Gaussian]:
    factor = jnp.asarray([[2.0, 0.0], [0.01, 0.02]])
    particles = jnp.asarray([[5.0], [-3.0]]) + factor @ jax.random.normal(jax.random.PRNGKey(0), (2, count))
    return particles, Gaussian(jnp.asarray([5.0, -3.0]), factor)


@pytest.mark.parametrize(
    "jitter", [Roughening(), Regularization(), Regularization(shrink=False), Roughening(scale=0.05)]
)
def test_jitter_keeps_the_mean_and_widens_as_it_says(jitter: Any) -> None:
    particles, moments = cloud()
    count = particles.shape[1]
    moved = jitter(particles, moments, jax.random.normal(jax.random.PRNGKey(1), particles.shape))
    std = np.sqrt(np.diagonal(moments.cov))
    assert (np.abs(np.mean(moved - particles, axis=1)) < 4 * std / np.sqrt(count)).all()
    before, after = np.cov(particles), np.cov(moved)
    if isinstance(jitter, Roughening):
        reach = np.ptp(np.asarray(particles), axis=1)
        expected = before + np.diag((jitter.scale * reach / np.sqrt(count)) ** 2)
    else:
        h = (4 / 4) ** (1 / 6) * count ** (-1 / 6)  # n = 2
        expected = before if jitter.shrink else before + h**2 * np.asarray(moments.cov)
    scale = np.outer(std, std)
    np.testing.assert_allclose(after / scale, expected / scale, atol=0.03)
    assert (np.abs(moved - particles).max(axis=1) > 0).all()


@pytest.mark.parametrize("jitter", [None, Roughening(), Regularization()])
def test_a_state_without_noise_keeps_its_particles_apart_by_jitter_only(jitter: Any) -> None:
    """A constant seen 40 times: resampling alone leaves few distinct values; the exact answer is the mean."""
    model = Scalar(kind="still", q=0.0, r=1.0, mean=0.0, std=2.0)
    random = np.random.default_rng(1)
    z = jnp.asarray(1.5 + random.normal(size=(40, 1)))
    data = {"u": jnp.zeros(40), "z": z, "dt": jnp.ones(40)}
    method = ParticleFilter(particles=500, threshold=1.0, jitter=jitter)
    posteriors, _, last = run_jit(method, model, **data)
    distinct = len(np.unique(np.asarray(last.particles)))
    expected = run_jit(KF(), model, **data)[0]
    error = abs(float(posteriors.mean[-1, 0] - expected.mean[-1, 0])) / float(expected.factor[-1, 0, 0])
    if jitter is None:
        assert distinct < 100
    else:
        assert distinct == 500
        assert error < 0.5
        share = float(posteriors.factor[-1, 0, 0] / expected.factor[-1, 0, 0])
        assert 0.8 < share < (1.5 if isinstance(jitter, Regularization) else 3.0)


@pytest.mark.parametrize("dtype", [jnp.float64, jnp.float32])
def test_weights_survive_likelihoods_that_no_number_holds(dtype: Any) -> None:
    """A sample 1000 σ away: every likelihood is e^−500000, its logarithm and the estimate are fine."""
    model = jax.tree.map(lambda a: a.astype(dtype), Scalar(kind="still", q=0.1, r=0.01, mean=0.0, std=1e-3))
    method = ParticleFilter(particles=400)
    state, info, posterior = stepped(
        method, model, begun(method, model), jnp.full(1, 10.0, dtype), jnp.asarray(1e-6, dtype)
    )
    assert info.ok
    assert info.log_likelihood < -450_000
    assert np.isfinite(info.log_likelihood)
    assert np.sum(np.exp(np.asarray(state.log_weights))) == pytest.approx(1.0, abs=1e-5)
    assert posterior.mean.dtype == dtype
    assert np.isfinite(posterior.mean).all()
    # the best particle, the one farthest out, has the weight
    best = float(np.max(state.particles))
    assert float(posterior.mean[0]) == pytest.approx(best, abs=1e-3)


@pytest.mark.parametrize("threshold", [0.0, 0.3, 0.5, 0.9, 1.0])
def test_resampling_waits_for_the_threshold(linear: dict[str, Any], threshold: float) -> None:
    method, model = ParticleFilter(particles=200, threshold=threshold), Bent()
    state = begun(method, model)
    happened = []
    for k in range(12):
        u, z, dt = (linear[name][k] for name in ("u", "z", "dt"))
        share = 1 / np.sum(np.exp(2 * np.asarray(state.log_weights))) / 200
        ahead = predicted(method, model, state, u, dt)
        equal = np.ptp(ahead.log_weights) == 0
        if k:  # at first all weights are equal
            assert equal == (share < threshold)
            happened.append(equal)
        state = updated(method, model, ahead, u, z)
    assert any(happened) == (threshold > 0)
    assert all(happened) == (threshold == 1)


def test_a_step_of_no_time_does_not_resample(linear: dict[str, Any]) -> None:
    method, model = ParticleFilter(particles=200, threshold=1.0), Bent()
    state = updated(method, model, begun(method, model), linear["u"][0], linear["z"][0])
    ahead = predicted(method, model, state, linear["u"][1], jnp.asarray(0.0))
    np.testing.assert_array_equal(ahead.particles, state.particles)
    np.testing.assert_allclose(ahead.log_weights, state.log_weights, atol=1e-12)


def test_degenerate_weights_recover() -> None:
    """One sample far outside leaves one particle all the weight; some steps later all is well."""
    model = Scalar(kind="still", q=0.5, r=0.2, std=1.0)
    random = np.random.default_rng(0)
    x = np.cumsum(0.5 * random.normal(size=60))
    x[20:] += 8.0
    z = jnp.asarray((x + 0.2 * random.normal(size=60))[:, None])
    data = {"u": jnp.zeros(60), "z": z, "dt": jnp.ones(60)}
    method = ParticleFilter(particles=1000)

    def body(state: Any, row: Any) -> tuple[Any, Any]:
        new, info = method.step(model, state, *row)
        return new, (effective_number(new.log_weights), method.posterior(new), info.ok)

    _, (number, posterior, ok) = jax.lax.scan(body, begun(method, model), tuple(data.values()))
    assert number[20] < 2
    assert np.asarray(ok).all()
    assert (np.asarray(number[25:]) > 10).all()
    assert np.mean(np.asarray(number[25:])) > 300
    expected = run_jit(KF(), model, **data)[0]
    late = slice(30, None)
    np.testing.assert_allclose(posterior.mean[late], expected.mean[late], atol=0.06)
    np.testing.assert_allclose(posterior.factor[late], expected.factor[late], rtol=0.25)


@pytest.mark.parametrize(("kind", "where"), [("root", "f"), ("log", "h")])
def test_particles_that_fall_off_the_model_lose_their_weight(kind: str, where: str) -> None:
    """√x and ln x of the negative ones are no numbers: what is left is the prior cut off at zero."""
    model = Scalar(kind=kind, q=1e-6, r=1e3, mean=0.5, std=0.5)
    method = ParticleFilter(particles=20_000, threshold=0.0)
    start = begun(method, model)
    state, info, posterior = stepped(method, model, start, jnp.ones(1), jnp.asarray(1.0))
    assert info.ok
    negative = np.asarray(start.particles)[0] <= 0
    assert 0.1 < negative.mean() < 0.2
    weights = np.exp(np.asarray(state.log_weights))
    assert (weights[negative] == 0).all()
    np.testing.assert_allclose(weights[~negative], 1 / np.sum(~negative), rtol=0.05)
    kept = np.random.default_rng(0).normal(0.5, 0.5, 10**6)
    kept = kept[kept > 0]
    expected = np.sqrt(kept).mean() if where == "f" else kept.mean()
    assert float(posterior.mean[0]) == pytest.approx(expected, abs=0.01)


def test_where_no_particle_is_left_the_state_stays() -> None:
    model = Scalar(kind="root", q=0.1, r=0.1, mean=-50.0, std=0.1)
    method = ParticleFilter(particles=50)
    start = begun(method, model)
    state, info, _ = stepped(method, model, start, jnp.ones(1), jnp.asarray(1.0))
    assert not info.ok
    assert info.reason == Reason.NOT_FINITE
    np.testing.assert_array_equal(state.particles, start.particles)
    np.testing.assert_array_equal(state.log_weights, start.log_weights)


def test_a_gate_refuses_an_outlier() -> None:
    model = Scalar(kind="still", q=0.1, r=0.1, std=1.0)
    method = ParticleFilter(particles=500, gate=GateRule())
    one = jnp.asarray(1.0)
    state, info, posterior = stepped(method, model, begun(method, model), jnp.full(1, 100.0), one)
    assert info.gate[0] == Gate.REJECTED
    assert info.reason == Reason.NO_MEASUREMENT
    assert abs(float(posterior.mean[0])) < 0.2
    info = stepped(method, model, state, jnp.full(1, 1.0), one)[1]
    assert info.gate[0] == Gate.PASSED
    variance = float(info.S[0, 0])
    assert float(info.nis) == pytest.approx(float(info.innovation[0]) ** 2 / variance, rel=1e-9)
    assert variance == pytest.approx(1.0 + 2 * 0.01 + 0.01, rel=0.2)


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"particles": 0}, "at least one particle"),
        ({"threshold": 1.5}, "share of the particles, 0 to 1, got 1.5"),
        ({"threshold": float("nan")}, "share of the particles"),
        ({"resampling": "roulette"}, "no resampling 'roulette'; choose one of systematic, stratified"),
    ],
)
def test_settings_that_cannot_run_are_refused(settings: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        ParticleFilter(**settings)
