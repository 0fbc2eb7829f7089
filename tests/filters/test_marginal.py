"""The marginalised UKF against the full one, the Kalman filter, and exact moments."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from filters.models import Bent, run, run_jit, simulate
from roadstate.consistency import nees, nees_test
from roadstate.core.gaussian import Gaussian
from roadstate.filters import KF, UKF
from roadstate.filters.marginal import MarginalUKF
from roadstate.statespace import StateSpaceModel

MASS, INERTIA, FRONT, REAR, TRACK, RADIUS, SPIN, DRAG = 1412.0, 1536.7, 1.0, 1.9, 1.67, 0.325, 0.9, 0.4


class Named(Bent):
    """:class:`Bent` that says which of its states are nonlinear."""

    curved: tuple[str, ...] = eqx.field(default=("angle", "rate"), static=True)

    @property
    def nonlinear(self) -> tuple[str, ...]:
        return self.curved


class Lower(StateSpaceModel):
    """TFOBE's lower layer: 15 states of which v_x, v_y and r enter in products, 7 sensors (paper 002)."""

    states: tuple[str, ...] = eqx.field(
        default=("v_x", "v_y", "r", *(f"{k}_{w}" for k in ("omega", "F_x", "F_y") for w in range(4))),
        static=True,
    )
    sensors: tuple[str, ...] = eqx.field(
        default=("a_x", "a_y", "r", *(f"omega_{w}" for w in range(4))), static=True
    )
    all_curved: bool = eqx.field(default=False, static=True)

    @property
    def nonlinear(self) -> tuple[str, ...]:
        return self.states if self.all_curved else self.states[:3]

    def body(self, x: Any, u: Any) -> Any:
        cos, sin = jnp.cos(u[0]), jnp.sin(u[0])
        force_x, force_y = x[7:11], x[11:15]
        x_body = jnp.concatenate([force_x[:2] * cos - force_y[:2] * sin, force_x[2:]])
        y_body = jnp.concatenate([force_x[:2] * sin + force_y[:2] * cos, force_y[2:]])
        yaw = (
            FRONT * y_body[:2].sum()
            - REAR * y_body[2:].sum()
            + TRACK / 2 * (x_body[1::2] - x_body[::2]).sum()
        )
        return (x_body.sum() - DRAG * x[0] ** 2) / MASS, y_body.sum() / MASS, yaw / INERTIA

    def f(self, x: Any, u: Any, dt: Any) -> Any:
        a_x, a_y, yaw = self.body(x, u)
        rates = jnp.stack([a_x + x[1] * x[2], a_y - x[0] * x[2], yaw])
        return jnp.concatenate([x[:3] + dt * rates, x[3:7] + dt * (u[1:5] - RADIUS * x[7:11]) / SPIN, x[7:]])

    def h(self, x: Any, u: Any) -> Any:
        return jnp.concatenate([jnp.stack(self.body(x, u)[:2]), x[2:7]])

    def sqrt_Q(self, u: Any, dt: Any) -> Any:
        return jnp.diag(jnp.asarray([0.2, 0.2, 0.02, *[0.2] * 4, *[300.0] * 8])) * jnp.sqrt(dt)

    def sqrt_R(self, u: Any) -> Any:
        return jnp.diag(jnp.asarray([0.05, 0.05, 0.002, *[0.05] * 4]))

    def prior(self) -> Gaussian:
        mean = jnp.asarray([20.0, 0, 0, *[20 / RADIUS] * 4, *[0.0] * 8])
        return Gaussian(mean, jnp.diag(jnp.asarray([0.5, 0.2, 0.05, *[0.5] * 4, *[500.0] * 8])))


@pytest.fixture(scope="module")
def data() -> dict[str, Any]:
    random = np.random.default_rng(2)
    z = random.normal(scale=0.5, size=(30, 2))
    z[random.random(z.shape) < 0.2] = np.nan
    return {"u": random.normal(size=30), "z": z, "dt": random.uniform(0.02, 0.3, 30)}


SETTINGS = [{}, {"alpha": 1e-2}, {"beta": 0.0}, {"beta": 0.5, "kappa": 1.0}]


@pytest.mark.parametrize("settings", SETTINGS)
@pytest.mark.parametrize("exact", [False, True])
def test_with_every_state_nonlinear_it_is_the_ukf(data: Any, settings: Any, exact: bool) -> None:
    model = Bent(curvature=jnp.asarray(0.8))
    full = run_jit(UKF(**settings), model, **data)[:2]
    same = run_jit(MarginalUKF(**settings, exact=exact), model, **data)[:2]
    for a, b in zip(jax.tree.leaves(same), jax.tree.leaves(full), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("curved", [(), ("angle",), ("rate",), ("damping", "angle")])
@pytest.mark.parametrize("exact", [False, True])
def test_on_a_linear_model_it_is_the_kalman_filter(data: Any, curved: Any, exact: bool) -> None:
    expected = run_jit(KF(), Bent(), **data)[:2]
    found = run_jit(MarginalUKF(exact=exact), Named(curved=curved), **data)[:2]
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-11)


class Product(StateSpaceModel):
    """z = a b + v: linear in b, with a slope that depends on a."""

    states: tuple[str, ...] = eqx.field(default=("a", "b"), static=True)
    sensors: tuple[str, ...] = eqx.field(default=("z",), static=True)
    spread: Any = eqx.field(default=1.0, converter=jnp.asarray)

    @property
    def nonlinear(self) -> tuple[str, ...]:
        return ("a",)

    def f(self, x: Any, u: Any, dt: Any) -> Any:
        return x

    def h(self, x: Any, u: Any) -> Any:
        return (x[0] * x[1])[None]

    def sqrt_Q(self, u: Any, dt: Any) -> Any:
        return jnp.zeros((2, 2))

    def sqrt_R(self, u: Any) -> Any:
        return jnp.full((1, 1), 0.1)

    def prior(self) -> Gaussian:
        return Gaussian(jnp.asarray([1.5, -2.0]), self.spread * jnp.asarray([[0.6, 0.0], [0.3, 0.5]]))


def told(method: Any, spread: float) -> tuple[float, float]:
    """Mean and variance of z as the filter has them."""
    model = Product(spread=spread)
    info = method.update(model, method.init(model), None, jnp.zeros(1))[1]
    return -float(info.innovation[0]), float(info.S[0, 0])


def exact_moments(spread: float) -> tuple[float, float]:
    """E = ab + C, Var = a²B + b²A + 2abC + AB + C² (+ R) of a product of Gaussians."""
    a, b = 1.5, -2.0
    A, C, B = spread**2 * np.array([0.36, 0.18, 0.34])
    return a * b + C, a * a * B + b * b * A + 2 * a * b * C + A * B + C * C + 0.01


def test_exact_gives_the_moments_of_a_product() -> None:
    mean, variance = told(MarginalUKF(exact=True), 1.0)
    expected = exact_moments(1.0)
    assert mean == pytest.approx(expected[0], rel=1e-12)
    assert variance == pytest.approx(expected[1], rel=1e-12)
    assert told(MarginalUKF(), 1.0)[1] < expected[1] - 0.02  # the part that the cheaper form leaves out


def test_it_differs_from_the_full_filter_in_fourth_order() -> None:
    differences = []
    for spread in (0.4, 0.2, 0.1):
        full, marginal = told(UKF(), spread), told(MarginalUKF(), spread)
        assert marginal[0] == pytest.approx(full[0], rel=1e-12)
        differences.append(abs(full[1] - marginal[1]))
    assert np.log2(differences[0] / differences[1]) > 3.9
    assert np.log2(differences[1] / differences[2]) > 3.9


def test_tfobes_lower_layer_is_the_full_filters_for_half_the_points() -> None:
    model, full = Lower(), Lower(all_curved=True)
    steps = 200
    t = np.arange(steps) * 0.01
    u = jnp.asarray(np.column_stack([0.03 * np.sin(2 * t), *[100 * np.sin(t)] * 4]))
    dt = jnp.full(steps, 0.01)
    _, z = simulate(model, u, dt, jax.random.PRNGKey(1))
    z = z.at[50:60, 0].set(jnp.nan).at[100].set(jnp.nan)
    a, b = run_jit(UKF(), full, u, z, dt)[0], run_jit(MarginalUKF(), model, u, z, dt)[0]
    std = np.sqrt(np.sum(np.asarray(a.factor) ** 2, axis=-1))
    assert np.abs((a.mean - b.mean) / std).max() < 1e-3
    np.testing.assert_allclose(np.sqrt(np.sum(np.asarray(b.factor) ** 2, axis=-1)), std, rtol=1e-3)


def test_nees_lies_in_its_band() -> None:
    model = Named(curvature=jnp.asarray(0.3))
    steps, seeds = 40, 200
    u, dt = jnp.sin(jnp.arange(steps) * 0.3), jnp.full(steps, 0.1)

    @jax.jit
    def one(key: Any) -> Any:
        x, z = simulate(model, u, dt, key)
        posterior = run(MarginalUKF(), model, u, z, dt)[0]
        return posterior.mean - x, posterior.factor

    test = nees_test(nees(*jax.vmap(one)(jax.random.split(jax.random.PRNGKey(3), seeds))), 3)
    assert np.mean(test.inside) > 0.85
    assert test.inside[-1]


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="kappa must exceed -2 with 2 nonlinear states, got -2"):
        MarginalUKF(kappa=-2.0).init(Named())
    with pytest.raises(ValueError, match="nonlinear names speed, which the model has no state for"):
        MarginalUKF().init(Named(curved=("speed",)))
