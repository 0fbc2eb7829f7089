"""The Rao–Blackwellised particle filter against the filters between which it stands."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from filters.models import Bent, TimeVarying, random_time_varying, run, run_jit, simulate
from roadstate.core.gaussian import Gate, Gaussian
from roadstate.filters import KF
from roadstate.filters.base import GateRule
from roadstate.filters.particle import ParticleFilter
from roadstate.filters.rao_blackwell import RaoBlackwellPF
from roadstate.statespace import StateSpaceModel

STEPS = 20


class Named(Bent):
    """:class:`Bent` that says which of its states are nonlinear."""

    curved: tuple[str, ...] = eqx.field(default=("angle",), static=True)

    @property
    def nonlinear(self) -> tuple[str, ...]:
        return self.curved


class Chosen(TimeVarying):
    """A linear system that takes some states for nonlinear, out of order; its noises are correlated."""

    @property
    def nonlinear(self) -> tuple[str, ...]:
        return ("x3", "x1")


@pytest.fixture(scope="module")
def data() -> dict[str, Any]:
    u, dt = jnp.sin(jnp.arange(STEPS) * 0.3), jnp.full(STEPS, 0.1)
    _, z = simulate(Bent(), u, dt, jax.random.PRNGKey(2))
    return {"u": u, "z": z.at[4, 0].set(jnp.nan).at[9].set(jnp.nan), "dt": dt}


@eqx.filter_jit
def seeds(method: Any, model: Any, data: dict[str, Any], count: int) -> tuple[Any, Any]:
    """Means (seeds, T, n) and log-likelihoods (seeds,) of the whole run."""

    def one(seed: Any) -> tuple[Any, Any]:
        own = eqx.tree_at(lambda m: m.seed, method, seed)
        posteriors, infos, _ = run(own, model, **data)
        return posteriors.mean, jnp.sum(infos.log_likelihood)

    return jax.vmap(one)(jnp.arange(count))


@pytest.mark.parametrize("gate", [None, GateRule(threshold=2.0)])
def test_without_nonlinear_states_it_is_the_kalman_filter(data: dict[str, Any], gate: Any) -> None:
    a = run_jit(RaoBlackwellPF(particles=7, gate=gate), Named(curved=()), **data)
    b = run_jit(KF(gate=gate), Bent(), **data)
    np.testing.assert_allclose(a[0].mean, b[0].mean, rtol=1e-10, atol=1e-11)
    np.testing.assert_allclose(a[0].factor, b[0].factor, rtol=1e-9, atol=1e-11)
    for name in ("innovation", "S", "nis", "log_likelihood", "gate"):
        np.testing.assert_allclose(getattr(a[1], name), getattr(b[1], name), rtol=1e-9, atol=1e-9)
    assert (gate is not None) == bool(np.any(a[1].gate == Gate.REJECTED))


def test_with_nothing_but_nonlinear_states_it_is_the_particle_filter(data: dict[str, Any]) -> None:
    """The same draws and the same weights, so the same numbers."""
    every = Named(curvature=jnp.asarray(0.5), curved=("angle", "rate", "damping"))
    a = run_jit(RaoBlackwellPF(particles=200), every, **data)
    b = run_jit(ParticleFilter(particles=200), every, **data)
    np.testing.assert_allclose(a[0].mean, b[0].mean, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(a[0].factor, b[0].factor, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(a[1].log_likelihood, b[1].log_likelihood, atol=1e-8)


@pytest.mark.parametrize("curved", [("angle",), ("rate", "damping")])
def test_it_needs_fewer_particles(data: dict[str, Any], curved: tuple[str, ...]) -> None:
    """The error against the exact answer, over 60 seeds, with 200 particles each."""
    expected = run_jit(KF(), Bent(), **data)[0].mean

    def error(method: Any) -> Any:
        means = seeds(method, Named(curved=curved), data, 60)[0]
        return np.sqrt(np.mean((np.asarray(means) - expected) ** 2))

    plain = error(ParticleFilter(particles=200))
    assert error(RaoBlackwellPF(particles=200)) < 0.8 * plain
    if len(curved) == 1:
        assert error(RaoBlackwellPF(particles=50)) < plain


def test_correlated_noises_and_states_out_of_order() -> None:
    """Four states with full Q, R and prior, two of them sampled: mean and likelihood have no bias."""
    plain, u, dt = random_time_varying(3, 4, 2, 12)
    model = Chosen(plain.states, plain.sensors, plain.start)
    _, z = simulate(model, u, jnp.asarray(dt), jax.random.PRNGKey(0))
    data = {"u": u, "z": z, "dt": jnp.asarray(dt)}
    posteriors, infos, _ = run_jit(KF(), model, **data)
    means, log_likelihoods = (np.asarray(a) for a in seeds(RaoBlackwellPF(particles=200), model, data, 150))
    std = np.sqrt(np.sum(np.asarray(posteriors.factor) ** 2, axis=2))
    away = (means.mean(axis=0) - posteriors.mean) / std
    noise = means.std(axis=0) / std / np.sqrt(150)
    assert np.abs(away).max() < 4.5 * noise.max() + 2 / 200  # weighted means err by O(1/N)
    ratio = np.exp(log_likelihoods - float(jnp.sum(infos.log_likelihood)))
    assert abs(ratio.mean() - 1) < 4 * ratio.std() / np.sqrt(150)
    assert ratio.std() < 2
    one = run_jit(RaoBlackwellPF(particles=2000), model, **data)[0]
    scale = std[:, :, None] * std[:, None, :]
    covs = [np.asarray(g.factor @ g.factor.mT) / scale for g in (one, posteriors)]
    np.testing.assert_allclose(covs[0], covs[1], atol=0.15)


class Product(StateSpaceModel):
    """z = (a b, b) + v, both wandering: linear in b with a slope that is a; b itself settles the sign."""

    states: tuple[str, ...] = eqx.field(default=("b", "a"), static=True)
    sensors: tuple[str, ...] = eqx.field(default=("product", "b"), static=True)

    @property
    def nonlinear(self) -> tuple[str, ...]:
        return ("a",)

    def f(self, x: Any, u: Any, dt: Any) -> Any:
        return jnp.stack([x[0] + dt * x[1] ** 2 * x[0], x[1]])

    def h(self, x: Any, u: Any) -> Any:
        return jnp.stack([x[0] * x[1], x[0]])

    def sqrt_Q(self, u: Any, dt: Any) -> Any:
        return jnp.diag(jnp.asarray([0.2, 0.3])) * jnp.sqrt(dt)

    def sqrt_R(self, u: Any) -> Any:
        return jnp.diag(jnp.asarray([0.3, 0.5]))

    def prior(self) -> Gaussian:
        return Gaussian(jnp.asarray([1.0, -0.5]), jnp.asarray([[0.5, 0.0], [0.2, 0.6]]))


def test_on_a_curved_model_it_is_what_many_particles_say() -> None:
    model, dt = Product(), jnp.full(15, 0.1)
    _, z = simulate(model, jnp.zeros(15), dt, jax.random.PRNGKey(3))
    data = {"u": jnp.zeros(15), "z": z, "dt": dt}
    many, infos, _ = run_jit(ParticleFilter(particles=40_000), model, **data)
    few, told, _ = run_jit(RaoBlackwellPF(particles=10_000), model, **data)
    std = np.sqrt(np.sum(np.asarray(many.factor) ** 2, axis=2))
    assert np.sqrt(np.mean(((few.mean - many.mean) / std) ** 2)) < 0.04
    np.testing.assert_allclose(np.sqrt(np.sum(np.asarray(few.factor) ** 2, axis=2)), std, rtol=0.06)
    np.testing.assert_allclose(told.log_likelihood, infos.log_likelihood, atol=0.06)
    np.testing.assert_allclose(told.S, infos.S, rtol=0.1, atol=0.02)


class Slow(StateSpaceModel):
    """Ten constants but the first, which alone has noise: √Q has one column."""

    states: tuple[str, ...] = eqx.field(default=tuple(f"x{i}" for i in range(10)), static=True)
    sensors: tuple[str, ...] = eqx.field(default=("z",), static=True)
    sampled: int = eqx.field(default=10, static=True)

    @property
    def nonlinear(self) -> tuple[str, ...]:
        return self.states[: self.sampled]

    def f(self, x: Any, u: Any, dt: Any) -> Any:
        return x

    def h(self, x: Any, u: Any) -> Any:
        return jnp.sum(x[:2])[None]

    def sqrt_Q(self, u: Any, dt: Any) -> Any:
        return jnp.zeros((10, 1)).at[0, 0].set(jnp.sqrt(dt))

    def sqrt_R(self, u: Any) -> Any:
        return jnp.eye(1)

    def prior(self) -> Gaussian:
        return Gaussian(jnp.zeros(10), jnp.eye(10))


@pytest.mark.parametrize("sampled", [0, 3, 10])
def test_fewer_noises_than_sampled_states(sampled: int) -> None:
    model, dt = Slow(sampled=sampled), jnp.full(5, 0.5)
    data = {"u": jnp.zeros(5), "z": jnp.full((5, 1), 2.0), "dt": dt}
    a = run_jit(RaoBlackwellPF(particles=2000, threshold=0.0), model, **data)[0]
    b = run_jit(KF(), model, **data)[0]
    np.testing.assert_allclose(a.mean, b.mean, atol=1e-9 if not sampled else 0.18)
    np.testing.assert_allclose(
        a.factor @ a.factor.mT, b.factor @ b.factor.mT, atol=1e-9 if not sampled else 0.2
    )


def test_single_precision(data: dict[str, Any]) -> None:
    model = jax.tree.map(lambda a: a.astype(jnp.float32), Named(curvature=jnp.asarray(0.3)))
    single = {k: jnp.asarray(v, jnp.float32) for k, v in data.items()}
    posteriors, infos, last = run_jit(RaoBlackwellPF(particles=300), model, **single)
    for leaf in jax.tree.leaves((posteriors, infos, last)):
        assert leaf.dtype != jnp.float64
    double = run_jit(RaoBlackwellPF(particles=300), Named(curvature=jnp.asarray(0.3)), **data)[0]
    np.testing.assert_allclose(posteriors.mean, double.mean, atol=0.1)
    assert np.asarray(infos.ok).all()
