"""The interacting multiple model filter against the textbook's form, by hand, and on a system that jumps."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from filters.models import Bent, run, run_jit, simulate
from oracles.covariance_imm import Mode, chain, imm_filter
from roadstate.core.gaussian import Gate, Gaussian
from roadstate.filters import EKF, KF, UKF
from roadstate.filters.base import GateRule
from roadstate.filters.imm import IMM
from roadstate.filters.switching import SwitchingModel
from roadstate.statespace import StateSpaceModel

KALMAN = IMM(filter=KF())


class Linear(StateSpaceModel):
    """x⁺ = F x + G w, z = H x + L v, whatever Δt is; the matrices are leaves."""

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    F: Any = eqx.field(converter=jnp.asarray)
    G: Any = eqx.field(converter=jnp.asarray)
    H: Any = eqx.field(converter=jnp.asarray)
    L: Any = eqx.field(converter=jnp.asarray)
    start: Gaussian

    def f(self, x: Any, u: Any, dt: Any) -> Any:
        return self.F @ x

    def h(self, x: Any, u: Any) -> Any:
        return self.H @ x

    def sqrt_Q(self, u: Any, dt: Any) -> Any:
        return self.G

    def sqrt_R(self, u: Any) -> Any:
        return self.L

    def prior(self) -> Gaussian:
        return self.start


def scalar(F: float, q: float, r: float) -> Linear:
    start = Gaussian(jnp.zeros(1), jnp.eye(1))
    return Linear(("x",), ("z",), [[F]], [[q]], [[1.0]], [[r]], start)


def random_modes(seed: int, count: int, n: int, m: int) -> list[Linear]:
    random = np.random.default_rng(seed)
    start = Gaussian(jnp.asarray(random.normal(size=n)), jnp.asarray(np.tril(random.normal(size=(n, n)))))
    names = tuple(f"x{i}" for i in range(n)), tuple(f"z{i}" for i in range(m))
    return [
        Linear(
            *names,
            0.6 * random.normal(size=(n, n)) / np.sqrt(n),
            random.normal(size=(n, n)),
            random.normal(size=(m, n)),
            random.normal(size=(m, m)),
            start,
        )
        for _ in range(count)
    ]


def steps(z: Any, dt: float) -> dict[str, Any]:
    return {"u": jnp.zeros(len(z)), "z": jnp.asarray(z), "dt": jnp.full(len(z), dt)}


@eqx.filter_jit
def modes_of(method: IMM, model: StateSpaceModel, data: dict[str, Any]) -> tuple[Any, Any, Any]:
    """Posteriors, mode probabilities (T, K) and infos."""

    def body(state: Any, row: Any) -> tuple[Any, Any]:
        new, info = method.step(model, state, *row)
        return new, (method.posterior(new), new.probability, info)

    return jax.lax.scan(body, method.init(model), (data["u"], data["z"], data["dt"]))[1]


def test_one_step_by_hand() -> None:
    """Modes F = 1 and F = 0 with Q = 1 and R = 1, from N(0, 1), p = (½, ½), half a jump's chance each way.

    Both filters start from the mixture N(0, 1). P⁻ = 2 and 1, S = 3 and 2, K = 2/3 and 1/2. z = 3 gives
    x̂ = 2 and 3/2, P = 2/3 and 1/2; likelihoods e^(−9/6)/√(6π) and e^(−9/4)/√(4π).
    """
    rate = np.log(2) / 2  # Π_11 = (1 + e^(−2 rate)) / 2 = 3/4 over 1 s
    model = SwitchingModel.of([scalar(1.0, 1.0, 1.0), scalar(0.0, 1.0, 1.0)], rate)
    posterior, probability, info = modes_of(KALMAN, model, steps([[3.0]], 1.0))
    first, second = np.exp(-1.5) / np.sqrt(6 * np.pi), np.exp(-2.25) / np.sqrt(4 * np.pi)
    share = first / (first + second)
    assert probability[0, 0] == pytest.approx(share, rel=1e-12)
    mean = 2 * share + 1.5 * (1 - share)
    assert posterior.mean[0, 0] == pytest.approx(mean, rel=1e-12)
    variance = share * (2 / 3 + (2 - mean) ** 2) + (1 - share) * (0.5 + (1.5 - mean) ** 2)
    assert posterior.factor[0, 0, 0] ** 2 == pytest.approx(variance, rel=1e-12)
    assert info.log_likelihood[0] == pytest.approx(np.log((first + second) / 2), rel=1e-12)
    assert info.S[0, 0, 0] == pytest.approx(2.5, rel=1e-12)  # equal means: the mean of the variances
    assert info.nis[0] == pytest.approx(9 / 2.5, rel=1e-12)


@pytest.mark.parametrize(("count", "n", "m"), [(2, 1, 1), (3, 2, 2), (2, 4, 3)])
def test_it_is_the_textbooks_form(count: int, n: int, m: int) -> None:
    random = np.random.default_rng(5)
    models = random_modes(count, count, n, m)
    rates = random.uniform(0.1, 2, (count, count))
    probability = random.dirichlet(np.ones(count))
    z = random.normal(size=(30, m))
    z[4], z[9, 0] = np.nan, np.nan
    posterior, found, info = modes_of(KALMAN, SwitchingModel.of(models, rates, probability), steps(z, 0.3))
    squared = [
        Mode(np.asarray(a.F), np.asarray(a.G @ a.G.T), np.asarray(a.H), np.asarray(a.L @ a.L.T))
        for a in models
    ]
    prior = models[0].prior()
    means, covs, probabilities, log_likelihoods = imm_filter(
        squared, chain(rates, 0.3), probability, np.asarray(prior.mean), np.asarray(prior.cov), z
    )
    np.testing.assert_allclose(found, probabilities, rtol=2e-3, atol=2e-4)
    np.testing.assert_allclose(posterior.mean, means, rtol=2e-3, atol=2e-3)
    np.testing.assert_allclose(posterior.factor @ posterior.factor.mT, covs, rtol=2e-3, atol=2e-3)
    np.testing.assert_allclose(info.log_likelihood, log_likelihoods, atol=2e-3)
    # and with the very chain that the filter uses, to rounding
    jumps = np.asarray(SwitchingModel.of(models, rates, probability).transition(jnp.asarray(0.3)))
    means, covs, probabilities, log_likelihoods = imm_filter(
        squared, jumps, probability, np.asarray(prior.mean), np.asarray(prior.cov), z
    )
    np.testing.assert_allclose(found, probabilities, rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(posterior.mean, means, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(posterior.factor @ posterior.factor.mT, covs, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(info.log_likelihood, log_likelihoods, atol=1e-8)


transition = eqx.filter_jit(SwitchingModel.transition)


@given(
    rates=st.lists(st.floats(0, 20), min_size=9, max_size=9),
    dt=st.sampled_from([0.0, 1e-4, 0.01, 0.5, 3.0]),
)
def test_the_chain_is_a_matrix_exponential(rates: list[float], dt: float) -> None:
    jumps = np.array(rates).reshape(3, 3)
    model = SwitchingModel.of([scalar(1.0, 1.0, 1.0)] * 3, jumps)
    found = np.asarray(transition(model, jnp.asarray(dt)))
    assert (found >= 0).all()
    np.testing.assert_allclose(found.sum(axis=1), 1, rtol=1e-12)
    expected = chain(jumps, dt)
    off = ~np.eye(3, dtype=bool)
    jumping = max(1.0, 60 * dt)  # jumps in Δt, at most
    np.testing.assert_allclose(found[off], expected[off], rtol=jumping / 1000, atol=1e-13 + 1e-3 * (dt > 0.1))


@pytest.mark.parametrize("inner", [KF(), EKF(), UKF()])
@pytest.mark.parametrize(
    "model", [Bent(), SwitchingModel.of([Bent()] * 2, 0.7), SwitchingModel.alone(Bent())]
)
def test_one_mode_or_equal_modes_are_the_filter_inside(inner: Any, model: Any) -> None:
    u, dt = jnp.sin(jnp.arange(30) * 0.3), jnp.full(30, 0.1)
    _, z = simulate(Bent(), u, dt, jax.random.PRNGKey(0))
    z = z.at[6].set(jnp.nan).at[11, 1].set(jnp.nan)
    a, b = run_jit(IMM(filter=inner), model, u, z, dt), run_jit(inner, Bent(), u, z, dt)
    np.testing.assert_allclose(a[0].mean, b[0].mean, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(a[0].factor, b[0].factor, rtol=1e-9, atol=1e-11)
    for name in ("innovation", "S", "nis", "log_likelihood"):
        np.testing.assert_allclose(getattr(a[1], name), getattr(b[1], name), rtol=1e-8, atol=1e-9)


@pytest.fixture(scope="module")
def jumping() -> tuple[SwitchingModel, Any, Any, Any]:
    """A noise that is small, large from 6 s to 12 s, and small again; with the truth."""
    quiet, loud = scalar(0.95, 0.1, 0.3), scalar(0.95, 2.0, 0.3)
    key, x, xs = jax.random.PRNGKey(3), jnp.zeros(1), []
    for k in range(180):
        mode = loud if 60 <= k < 120 else quiet
        key, own = jax.random.split(key)
        x = mode.F @ x + mode.G @ jax.random.normal(own, (1,))
        xs.append(x)
    truth = jnp.stack(xs)
    z = truth + 0.3 * jax.random.normal(key, truth.shape)
    return SwitchingModel.of([quiet, loud], 0.3), truth, steps(z, 0.1), (quiet, loud)


def test_mode_probabilities_find_the_switch(jumping: Any) -> None:
    model, truth, data, alone = jumping
    posterior, probability, _ = modes_of(KALMAN, model, data)
    loud = np.asarray(probability)[:, 1]
    assert loud[20:60].mean() < 0.15
    assert loud[70:120].mean() > 0.85
    assert loud[130:].mean() < 0.15
    assert (loud[60:66] > 0.5).any()

    def error(gaussians: Any) -> float:
        return float(jnp.mean((gaussians.mean - truth) ** 2))

    assert error(posterior) < min(error(run_jit(KF(), mode, **data)[0]) for mode in alone)
    # its covariance is honest where that of neither mode is: NEES over the whole, of one state
    squared = float(jnp.mean(((posterior.mean - truth) / posterior.factor[..., 0]) ** 2))
    assert 0.75 < squared < 1.3
    assert float(jnp.mean(((run_jit(KF(), alone[0], **data)[0].mean - truth) ** 2)[60:120])) > 1.0


def test_a_mode_that_has_all_but_vanished_comes_back() -> None:
    """Without jumps the evidence of all samples counts: e^−2000 against a mode, then e^+3000 for it."""
    one, other = scalar(0.0, 1e-6, 1.0), scalar(0.0, 1e-6, 4.0)
    z = jnp.concatenate([jnp.zeros((1500, 1)), jnp.full((220, 1), 8.0)])
    for dtype in (jnp.float64, jnp.float32):
        model = jax.tree.map(lambda a, dtype=dtype: a.astype(dtype), SwitchingModel.of([one, other], 0.0))
        data = {k: v.astype(dtype) for k, v in steps(z, 0.1).items()}
        _, probability, info = modes_of(KALMAN, model, data)
        assert probability[1400, 1] == 0  # no number in this precision
        assert probability[-1, 1] == pytest.approx(1.0)
        assert np.asarray(info.ok).all()


@pytest.mark.parametrize("rates", [0.0, 0.2])
def test_derivatives_are_finite_even_for_a_mode_that_cannot_be(rates: float) -> None:
    @eqx.filter_jit
    @eqx.filter_grad
    def slope(model: SwitchingModel) -> Any:
        posteriors, infos, _ = run(KALMAN, model, **steps(jnp.ones((3, 1)), 0.1))
        return jnp.sum(posteriors.mean) + jnp.sum(posteriors.factor) + jnp.sum(infos.log_likelihood)

    model = SwitchingModel.of([scalar(1.0, 1.0, 1.0), scalar(0.5, 1.0, 1.0)], rates, [1.0, 0.0])
    for leaf in jax.tree.leaves(slope(model)):
        assert np.isfinite(leaf).all()


@pytest.mark.parametrize("far", [50.0, 1e160, 1e300])
def test_the_gate_judges_for_all_modes_alike(far: float) -> None:
    """What it refuses has no part in anything, however far out."""
    models = random_modes(3, 2, 2, 2)
    model = SwitchingModel.of(models, 0.5)
    method = IMM(filter=KF(), gate=GateRule())
    z = np.random.default_rng(0).normal(size=(12, 2))
    z[6, 0] = far
    gated, _, info = modes_of(method, model, steps(z, 0.1))
    assert info.gate[6].tolist() == [Gate.REJECTED, Gate.PASSED]
    assert np.asarray(info.ok).all()
    z[6, 0] = np.nan
    without, _, _ = modes_of(KALMAN, model, steps(z, 0.1))
    np.testing.assert_allclose(gated.mean, without.mean, rtol=1e-10, atol=1e-11)


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="give the gate to the IMM"):
        IMM(filter=KF(gate=GateRule()))
    two = [scalar(1.0, 1.0, 1.0)] * 2
    for models, rates, probability, says in (
        ([], 0.1, None, "at least one mode"),
        ([two[0], Bent()], 0.1, None, "alike but for the values"),
        (two, -1.0, None, "finite and not negative"),
        (two, np.nan, None, "finite and not negative"),
        (two, 0.1, [1.0], "must hold 2 numbers"),
        (two, 0.1, [0.0, 0.0], "nor all zero"),
        (two, 0.1, [2.0, -1.0], "not negative"),
    ):
        with pytest.raises(ValueError, match=says):
            SwitchingModel.of(models, rates, probability)
