"""The fuzzy controller's surface, its sign, and how it lets R settle."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from oracles.robust_filters import mamdani
from roadstate.filters import FuzzyNoise, Window
from roadstate.filters.fuzzy import NOISE_RULES, Mamdani, Triangle

LOPSIDED = Mamdani(
    (
        (Triangle(-2.0, -1.0, 0.5), Triangle(-1.0, -0.5, 0.0)),
        (Triangle(-0.5, 0.2, 0.6), Triangle(-0.2, 0.0, 0.3)),
        (Triangle(0.0, 1.0, 3.0), Triangle(0.0, 1.0, 1.5)),
    )
)


@pytest.mark.parametrize("rules", [NOISE_RULES, LOPSIDED], ids=["noise", "lopsided"])
def test_surface_is_the_inference_point_by_point(rules: Mamdani) -> None:
    surface, at = rules.surface(), np.linspace(-1, 1, 257)
    for i in range(0, 257, 16):
        assert surface[i] == pytest.approx(mamdani(rules.rules, at[i]), abs=2e-3)


def test_interpolation_meets_the_surface_and_what_lies_between() -> None:
    fuzzy = FuzzyNoise(rules=LOPSIDED)
    at = np.linspace(-1, 1, 257)
    np.testing.assert_allclose(fuzzy.respond(jnp.asarray(at)), LOPSIDED.surface(), rtol=1e-12, atol=1e-14)
    between = at[:-1] + 0.3 * (at[1] - at[0])
    expected = np.interp(between, at, LOPSIDED.surface())
    np.testing.assert_allclose(fuzzy.respond(jnp.asarray(between)), expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(fuzzy.respond(jnp.asarray([-5.0, 5.0])), LOPSIDED.surface()[[0, -1]])


def test_larger_than_expected_raises_and_smaller_lowers() -> None:
    surface = NOISE_RULES.surface()
    np.testing.assert_allclose(surface, -surface[::-1], atol=1e-12)
    np.testing.assert_allclose(surface[[0, 128, 256]], [-1, 0, 1], atol=1e-12)
    assert (np.diff(surface) > 0).all()


def settle(fuzzy: FuzzyNoise, true_ratio: float, bias: float, steps: int = 2000) -> np.ndarray:
    """Scales (steps,) of a sensor whose noise is all of its innovation; R wrong by ``true_ratio``."""
    values = np.random.default_rng(0).normal(size=(steps, 1)) * np.sqrt(true_ratio) + bias

    def body(state: Any, value: Any) -> Any:
        scale = fuzzy.scale(state)
        return fuzzy.learn(state, value, scale, jnp.asarray([True])), scale[0]

    return np.asarray(jax.lax.scan(body, fuzzy.init(1, np.float64), jnp.asarray(values))[1])


@pytest.mark.parametrize("ratio", [0.04, 1.0, 25.0])
def test_r_settles_where_it_should(ratio: float) -> None:
    settled = settle(FuzzyNoise(), ratio, 0.0)[500:]
    assert np.exp(np.mean(np.log(settled))) == pytest.approx(ratio, rel=0.1)
    assert np.std(np.log(settled)) < 0.4


def test_innovations_that_all_point_one_way_do_not_raise_r() -> None:
    assert settle(FuzzyNoise(), 1.0, 30.0)[500:].mean() == pytest.approx(1, rel=0.2)


def test_bounds_hold_and_missing_samples_change_nothing() -> None:
    fuzzy = FuzzyNoise(floor=0.25, ceiling=4.0, average=Window(10))
    assert settle(fuzzy, 1e4, 0.0)[-1] == pytest.approx(4)
    assert settle(fuzzy, 1e-4, 0.0)[-1] == pytest.approx(0.25)
    state = fuzzy.init(2, np.float64)
    for k in range(20):
        sample = jnp.asarray([9 * (-1.0) ** k, np.nan])
        state = fuzzy.learn(state, sample, jnp.asarray([1.0, np.nan]), jnp.asarray([True, False]))
    scale = fuzzy.scale(state)
    assert scale[0] > 1
    assert scale[1] == 1
