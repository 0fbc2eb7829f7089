"""What every filter must do; a file under ``roadstate/filters`` that defines one is found and held to it."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import roadstate.filters
from filters.models import Bent, run, simulate
from roadstate.core.gaussian import Gate, Reason
from roadstate.filters import Filter

NAN = np.nan
STEPS = 60
GAP = slice(20, 24)  # no sensor at all
HALF = slice(30, 34)  # the first sensor only


def discover() -> dict[str, type[Filter[Any]]]:
    found: dict[str, type[Filter[Any]]] = {}
    for module in pkgutil.iter_modules(roadstate.filters.__path__, "roadstate.filters."):
        for value in vars(importlib.import_module(module.name)).values():
            is_filter = isinstance(value, type) and issubclass(value, Filter)
            if is_filter and "name" in vars(value) and not inspect.isabstract(value):
                assert found.setdefault(value.name, value) is value, f"two filters are called {value.name}"
    return dict(sorted(found.items()))


FILTERS = discover()
compiled = eqx.filter_jit(run)


class Run(NamedTuple):
    """A filter over one data set: posteriors (T, …), infos (T, …), its last state, and the truth (T, n)."""

    mean: np.ndarray
    factor: np.ndarray
    infos: Any
    last: Any


def over(method: Filter[Any], data: dict[str, Any], **changed: Any) -> Run:
    """Run on the data with some arrays changed: always the same compiled program."""
    arrays = {**data, **changed}
    posteriors, infos, last = compiled(method, Bent(), arrays["u"], arrays["z"], arrays["dt"])
    return Run(np.asarray(posteriors.mean), np.asarray(posteriors.factor), infos, last)


@pytest.fixture(scope="module")
def data() -> dict[str, Any]:
    u = jnp.sin(jnp.arange(STEPS) * 0.3)
    dt = jnp.where(jnp.arange(STEPS) % 3 == 0, 0.2, 0.05).at[0].set(0.0)
    x, z = simulate(Bent(), u, dt, jax.random.PRNGKey(1))
    z = z.at[GAP].set(NAN).at[HALF, 1].set(NAN)
    return {"u": u, "z": z, "dt": dt, "x": np.asarray(x)}


@pytest.fixture(scope="module", params=FILTERS)
def method(request: pytest.FixtureRequest) -> Filter[Any]:
    return FILTERS[request.param]()


@pytest.fixture(scope="module")
def usual(method: Filter[Any], data: dict[str, Any]) -> Run:
    return over(method, data)


def test_there_are_filters() -> None:
    assert {"kf", "ukf"} <= set(FILTERS)


def test_is_named_and_documented(method: Filter[Any]) -> None:
    kind = type(method)
    assert kind.name == kind.name.lower()
    assert " " not in kind.name
    assert kind.__doc__
    assert len(kind.__doc__.splitlines()[0]) > 10


def test_shapes_and_codes(usual: Run, data: dict[str, Any]) -> None:
    T, n, m = STEPS, 3, 2
    assert usual.mean.shape == (T, n)
    assert usual.factor.shape == (T, n, n)
    infos = usual.infos
    assert infos.innovation.shape == infos.gate.shape == (T, m)
    assert infos.S.shape == (T, m, m)
    for scalar in (infos.nis, infos.log_likelihood, infos.ok, infos.reason):
        assert scalar.shape == (T,)
    assert set(np.unique(infos.gate)) <= {int(g) for g in Gate}
    assert set(np.unique(infos.reason)) <= {int(r) for r in Reason}
    np.testing.assert_array_equal(np.isnan(infos.innovation), np.isnan(data["z"]))
    np.testing.assert_allclose(infos.S, np.swapaxes(infos.S, 1, 2), atol=1e-12)
    assert (np.linalg.eigvalsh(infos.S) > 0).all()


def test_everything_is_finite_and_the_covariance_is_one(usual: Run) -> None:
    assert np.isfinite(usual.mean).all()
    assert np.isfinite(usual.factor).all()
    assert (np.triu(usual.factor, 1) == 0).all()
    assert (np.sum(usual.factor**2, axis=2) > 0).all()
    for scalar in (usual.infos.nis, usual.infos.log_likelihood):
        assert np.isfinite(scalar).all()


def test_finds_the_state_of_a_matched_world(usual: Run, data: dict[str, Any]) -> None:
    spread = np.sqrt(np.sum(usual.factor**2, axis=2))
    settled = slice(10, None)
    assert (np.abs(usual.mean - data["x"])[settled] < 5 * spread[settled] + 0.05).all()


def test_a_sample_missing_throughout_is_a_prediction(usual: Run) -> None:
    infos = usual.infos
    assert (infos.reason[GAP] == Reason.NO_MEASUREMENT).all()
    assert infos.ok[GAP].all()
    assert (infos.gate[GAP] == Gate.NOT_TESTED).all()
    np.testing.assert_array_equal(infos.nis[GAP], 0)
    np.testing.assert_array_equal(infos.log_likelihood[GAP], 0)
    growth = np.sum(usual.factor**2, axis=(1, 2))[19:24]
    assert (np.diff(growth) > 0).all()


def test_one_sensor_missing_leaves_the_other(usual: Run, method: Filter[Any], data: dict[str, Any]) -> None:
    assert (usual.infos.reason[HALF] == Reason.OK).all()
    assert (usual.infos.nis[HALF] > 0).all()
    blind = over(method, data, z=data["z"].at[HALF].set(NAN))
    assert np.sum(usual.factor[33] ** 2) < np.sum(blind.factor[33] ** 2)


def test_the_same_in_gives_the_same_out(method: Filter[Any], usual: Run, data: dict[str, Any]) -> None:
    again = over(method, data)
    for a, b in zip(jax.tree.leaves(usual), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(a, b)


def test_no_time_and_no_sample_change_nothing(method: Filter[Any], data: dict[str, Any]) -> None:
    idle = over(method, data, z=data["z"].at[40:].set(NAN), dt=data["dt"].at[40:].set(0.0))
    np.testing.assert_allclose(idle.mean[-1], idle.mean[39], rtol=1e-12)
    np.testing.assert_allclose(
        idle.factor[-1] @ idle.factor[-1].T, idle.factor[39] @ idle.factor[39].T, rtol=1e-9, atol=1e-12
    )


@pytest.mark.parametrize("rubbish", [NAN, np.inf])
def test_rubbish_in_the_input_is_told_and_survived(
    method: Filter[Any], usual: Run, data: dict[str, Any], rubbish: float
) -> None:
    hit = over(method, data, u=data["u"].at[25].set(rubbish))
    assert not hit.infos.ok[25]
    assert hit.infos.reason[25] == Reason.NOT_FINITE
    assert np.isfinite(hit.mean).all()
    assert np.isfinite(hit.factor).all()
    assert np.asarray(hit.infos.ok)[30:].all()
    spread = np.sqrt(np.sum(usual.factor[-1] ** 2, axis=1))
    assert (np.abs(hit.mean[-1] - usual.mean[-1]) < 2 * spread).all()


def test_an_infinite_sample_counts_as_missing(method: Filter[Any], usual: Run, data: dict[str, Any]) -> None:
    inf = over(method, data, z=jnp.where(jnp.isnan(data["z"]), jnp.inf, data["z"]))
    np.testing.assert_array_equal(inf.mean, usual.mean)
    np.testing.assert_array_equal(inf.factor, usual.factor)


def test_vectorises(method: Filter[Any], usual: Run, data: dict[str, Any]) -> None:
    z = jnp.stack([data["z"], data["z"] + 0.3])
    many = eqx.filter_jit(jax.vmap(lambda z: run(method, Bent(), data["u"], z, data["dt"])[0].mean))(z)
    np.testing.assert_allclose(many[0], usual.mean, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(many[1], over(method, data, z=z[1]).mean, rtol=1e-9, atol=1e-10)


def test_gradients_are_finite(method: Filter[Any], data: dict[str, Any]) -> None:
    """Of a step of no time, of no sample, and of half a sample, by every parameter and by the state.

    A step's derivatives make a run's, and compile in a fraction of the time.
    """

    @eqx.filter_jit
    @eqx.filter_grad(has_aux=True)
    def gradient(at: tuple[Any, Any], u: Any, z: Any, dt: Any) -> tuple[Any, Any]:
        model, state = at
        new, info = method.step(model, state, u, z, dt)
        posterior = method.posterior(new)
        value = jnp.sum(posterior.mean) + jnp.sum(posterior.factor**2) + info.log_likelihood + info.nis
        return value, new

    model = Bent(curvature=jnp.asarray(0.1))
    state = method.init(model)
    moved = 0.0
    for k in (0, 1, 2, GAP.start, HALF.start, 3):
        slopes, state = gradient((model, state), *(data[name][k] for name in ("u", "z", "dt")))
        for leaf in jax.tree.leaves(slopes):
            assert np.isfinite(leaf).all()
        moved += abs(float(slopes[0].curvature))
    assert moved > 0


def test_single_precision_stays_single(method: Filter[Any], usual: Run, data: dict[str, Any]) -> None:
    model = jax.tree.map(lambda a: a.astype(jnp.float32), Bent())
    single = [jnp.asarray(data[k], jnp.float32) for k in ("u", "z", "dt")]
    posteriors, infos, last = compiled(method, model, *single)
    for leaf in jax.tree.leaves((posteriors, infos, last)):
        assert leaf.dtype != jnp.float64
    np.testing.assert_allclose(posteriors.mean, usual.mean, atol=0.02)
    assert np.asarray(infos.ok).all()
