"""The unscented filter against the Kalman filter, the textbook's sums, and exact moments."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from filters.models import Bent, Matrices, TimeVarying, bend, look, run_jit
from oracles.covariance_kf import Belief, Unscented
from roadstate.core.gaussian import Gaussian
from roadstate.filters import KF, UKF

NAN = np.nan
STEPS = 30
# (α, β, κ); the second is the cubature rule, for which and the third every weight is positive as it stands
SETTINGS = [(1.0, 2.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.5, 1.0), (1e-3, 2.0, 0.0), (0.6, 2.0, -1.5)]


@pytest.fixture(scope="module")
def data() -> dict[str, Any]:
    random = np.random.default_rng(2)
    z = random.normal(scale=0.5, size=(STEPS, 2))
    z[random.random(z.shape) < 0.2] = NAN
    z[7] = NAN
    return {"u": random.normal(size=STEPS), "z": z, "dt": random.uniform(0.02, 0.3, STEPS)}


@pytest.fixture(scope="module")
def linear(data: dict[str, Any]) -> tuple[Any, Any]:
    return run_jit(KF(), Bent(), **data)[:2]


@pytest.mark.parametrize(("alpha", "beta", "kappa"), SETTINGS)
class TestSettings:
    def test_on_a_linear_model_it_is_the_kalman_filter(
        self, alpha: float, beta: float, kappa: float, data: dict[str, Any], linear: tuple[Any, Any]
    ) -> None:
        posteriors, infos, _ = run_jit(UKF(alpha=alpha, beta=beta, kappa=kappa), Bent(), **data)
        # differences of points that lie α apart lose 1/α of the digits
        close = partial(np.testing.assert_allclose, rtol=1e-11 / alpha, atol=1e-12 / alpha)
        close(posteriors.mean, linear[0].mean)
        close(posteriors.factor, linear[0].factor)
        for name in ("innovation", "S", "nis", "log_likelihood"):
            close(getattr(infos, name), getattr(linear[1], name))
        np.testing.assert_array_equal(infos.reason, linear[1].reason)

    def test_on_a_curved_model_it_is_the_textbook(
        self, alpha: float, beta: float, kappa: float, data: dict[str, Any]
    ) -> None:
        curvature = 0.8
        model = Bent(curvature=jnp.asarray(curvature))
        posteriors, infos, _ = run_jit(UKF(alpha=alpha, beta=beta, kappa=kappa), model, **data)
        oracle = Unscented(alpha, beta, kappa)
        belief = Belief(np.asarray(model.start.mean), np.asarray(model.start.cov))
        R = np.asarray(model.noise @ model.noise.T)
        # the textbook's sums with weights of ±1/α² lose as many digits
        close = partial(np.testing.assert_allclose, rtol=1e-12 / alpha**2, atol=1e-12 / alpha**2)
        for k in range(STEPS):
            f = partial(bend, u=data["u"][k], dt=data["dt"][k], curvature=curvature, xp=np)
            Q = np.diag(np.asarray(model.process) ** 2 * data["dt"][k])
            belief = oracle.predict(belief, f, Q)
            belief, told = oracle.update(belief, partial(look, curvature=curvature, xp=np), R, data["z"][k])
            close(posteriors.mean[k], belief.mean)
            close(posteriors.factor[k] @ posteriors.factor[k].T, belief.cov)
            close(infos.nis[k], told.nis)
            close(infos.log_likelihood[k], told.log_likelihood)


def test_curvature_matters(data: dict[str, Any], linear: tuple[Any, Any]) -> None:
    """So that the comparison on the curved model is not one on a linear model again."""
    curved, _, _ = run_jit(UKF(), Bent(curvature=jnp.asarray(0.8)), **data)
    assert np.abs(curved.mean - linear[0].mean).max() > 0.05


class Square(TimeVarying):
    """z = Σ x² + v."""

    def h(self, x: Any, u: Any) -> Any:
        return jnp.sum(x**2)[None]


def measured_square(method: UKF, mean: Any, factor: Any) -> tuple[float, float]:
    """Mean and variance of Σ x² as the filter has them."""
    n = len(mean)
    model = Square(tuple("abc"[:n]), ("z",), Gaussian(jnp.asarray(mean), jnp.asarray(factor)))
    u = Matrices(jnp.eye(n), jnp.zeros(n), jnp.zeros((n, 1)), None, None, jnp.asarray([[0.5]]))
    _, info = method.update(model, method.init(model), u, jnp.zeros(1))
    return -float(info.innovation[0]), float(info.S[0, 0]) - 0.25


@pytest.mark.parametrize(("alpha", "beta", "kappa"), SETTINGS)
def test_the_mean_of_a_square_is_exact(alpha: float, beta: float, kappa: float) -> None:
    factor = np.array([[0.4, 0, 0], [0.1, 0.5, 0], [0.0, -0.1, 0.3]])
    mean = np.array([1.0, -2.0, 0.5])
    expected = mean @ mean + np.trace(factor @ factor.T)
    assert measured_square(UKF(alpha=alpha, beta=beta, kappa=kappa), mean, factor)[0] == pytest.approx(
        expected, rel=1e-9
    )


@pytest.mark.parametrize(("alpha", "beta", "kappa"), [(1.0, 0.0, 2.0), (1.0, 2.0, 0.0), (1e-2, 2.0, 0.0)])
def test_the_variance_of_a_square_is_exact_where_the_kurtosis_is_a_gaussians(
    alpha: float, beta: float, kappa: float
) -> None:
    """Var x² = 2P² + 4m²P: by n + κ = 3 with β = 0; by β = 2 at α = 1 and in the limit of small α."""
    mean, variance = 0.7, 0.3
    expected = 2 * variance**2 + 4 * mean**2 * variance
    found = measured_square(
        UKF(alpha=alpha, beta=beta, kappa=kappa), np.array([mean]), np.array([[math.sqrt(variance)]])
    )[1]
    assert found == pytest.approx(expected, rel=1e-3)


def test_the_cubature_points_lie_at_root_n() -> None:
    gaussian = Gaussian(jnp.zeros(3), jnp.eye(3))
    points = np.asarray(UKF(beta=0.0)._points(gaussian))
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), [0, *[math.sqrt(3)] * 6])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"alpha": 0.0}, r"alpha must lie in \(0, 1\], got 0.0"),
        ({"alpha": 1.1}, "alpha must lie"),
        ({"alpha": NAN}, "alpha must lie"),
        ({"beta": -0.1}, "beta must not be negative, got -0.1"),
        ({"beta": NAN}, "beta must not be negative"),
        (
            {"alpha": 0.5, "beta": 0.2},
            "beta < alpha² can give an indefinite covariance here; choose beta = 2",
        ),
        ({"beta": 0.5, "kappa": -0.5}, "indefinite covariance"),
    ],
)
def test_settings_that_can_fail_are_refused(settings: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        UKF(**settings)


@pytest.mark.parametrize("kappa", [-3.0, -5.0, NAN])
def test_a_spread_that_is_not_positive_is_refused(kappa: float) -> None:
    with pytest.raises(ValueError, match="kappa must exceed -3 with 3 states"):
        UKF(kappa=kappa).init(Bent())


@pytest.mark.parametrize(("alpha", "beta", "kappa"), [(1e-3, 2.0, 0.0), (1.0, 0.0, 0.0)])
def test_a_covariance_stays_one_where_the_textbooks_does_not(alpha: float, beta: float, kappa: float) -> None:
    """In single precision the sums of a small α cancel to rubbish; the square-root form's do not."""
    random = np.random.default_rng(3)
    steps = 200
    model = jax.tree.map(lambda a: a.astype(jnp.float32), Bent(curvature=jnp.asarray(0.8)))
    data = [jnp.asarray(random.normal(scale=0.5, size=s), jnp.float32) for s in ((steps,), (steps, 2))]
    dt = jnp.full(steps, 0.05, jnp.float32)
    posteriors, infos, _ = run_jit(UKF(alpha=alpha, beta=beta, kappa=kappa), model, *data, dt)
    assert posteriors.factor.dtype == jnp.float32
    assert np.asarray(infos.ok).all()
    assert (np.diagonal(posteriors.factor, axis1=1, axis2=2) > 0).all()


def test_settings_go_by_name() -> None:
    with pytest.raises(TypeError, match="positional"):
        UKF(0.5, 2.0, 0.0)
