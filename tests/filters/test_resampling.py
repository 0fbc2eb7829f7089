"""Resampling and the random numbers behind it."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from roadstate.filters.draws import Draws
from roadstate.filters.resampling import RESAMPLING

N = 64
WEIGHTS = np.random.default_rng(0).dirichlet(np.full(N, 0.3))
MANY = 4000


def draws(seed: Any) -> Draws:
    return Draws.seeded(jnp.asarray(seed))


def test_words_are_those_of_jax() -> None:
    """Threefry's two words, xored, are what ``jax.random.bits`` gives for a counter of 64 bits."""
    key = jnp.asarray([123456, 987654321], jnp.uint32)
    a, b = np.split(np.asarray(Draws(key, jnp.zeros(2, jnp.uint32)).words(32)), 2)
    with jax.threefry_partitionable(True):
        expected = jax.random.bits(jax.random.wrap_key_data(key, impl="threefry2x32"), (16,), jnp.uint32)
    np.testing.assert_array_equal(a ^ b, expected)


@pytest.mark.parametrize("dtype", [jnp.float64, jnp.float32])
def test_numbers_are_distributed_as_they_should(dtype: Any) -> None:
    source = draws(3).next()
    normal = source.normal((200_000,), dtype)
    uniform = source.stream(1).uniform((200_000,), dtype)
    assert normal.dtype == uniform.dtype == dtype
    assert stats.kstest(np.asarray(normal, float), "norm").pvalue > 1e-3
    assert stats.kstest(np.asarray(uniform, float), "uniform").pvalue > 1e-3
    assert 0 < uniform.min() < uniform.max() < 1
    assert np.isfinite(normal).all()


def test_streams_places_and_seeds_are_independent() -> None:
    first = draws(0)
    sets = [first, first.next(), first.stream(1), first.next().stream(1), draws(1)]
    numbers = np.stack([np.asarray(s.normal((20_000,), jnp.float64)) for s in sets])
    off_diagonal = np.corrcoef(numbers)[np.triu_indices(len(sets), 1)]
    assert np.abs(off_diagonal).max() < 4 / np.sqrt(20_000)


def test_a_place_gives_the_same_numbers_wherever_it_is_asked() -> None:
    one = draws(7).next().normal((3, 5), jnp.float64)
    many = jax.jit(jax.vmap(lambda s: Draws.seeded(s).next().normal((3, 5), jnp.float64)))(jnp.arange(6, 9))
    np.testing.assert_array_equal(many[1], one)


@pytest.fixture(scope="module", params=RESAMPLING)
def offspring(request: pytest.FixtureRequest) -> tuple[str, np.ndarray]:
    """(MANY, N) how often each particle was chosen."""
    scheme = RESAMPLING[request.param]
    chosen = jax.jit(jax.vmap(lambda s: scheme(jnp.asarray(WEIGHTS), Draws.seeded(s))))(jnp.arange(MANY))
    return request.param, np.apply_along_axis(np.bincount, 1, np.asarray(chosen), minlength=N)


def test_the_number_of_offspring_is_right_on_average(offspring: tuple[str, np.ndarray]) -> None:
    _, count = offspring
    np.testing.assert_array_equal(count.sum(axis=1), N)
    error = np.sqrt(count.var(axis=0) / MANY)
    assert (np.abs(count.mean(axis=0) - N * WEIGHTS) < 4.5 * error + 1e-3).all()


def test_the_spread_of_offspring_is_the_schemes(offspring: tuple[str, np.ndarray]) -> None:
    name, count = offspring
    expected = N * WEIGHTS
    if name == "multinomial":
        np.testing.assert_allclose(count.var(axis=0), expected * (1 - WEIGHTS), rtol=0.15, atol=0.02)
    if name == "systematic":
        assert (np.abs(count - expected) < 1).all()
    if name == "stratified":
        assert (np.abs(count - expected) < 2).all()
    if name == "residual":
        assert (count >= np.floor(expected)).all()
    multinomial = (expected * (1 - WEIGHTS)).sum()
    assert count.var(axis=0).sum() <= 1.05 * multinomial


@pytest.mark.parametrize("name", RESAMPLING)
@pytest.mark.parametrize("dtype", [jnp.float64, jnp.float32])
@given(
    parts=st.lists(st.floats(0, 1), min_size=9, max_size=9).filter(lambda p: sum(p) > 0.01),
    seed=st.integers(0, 2**31),
)
def test_particles_without_weight_die(name: str, dtype: Any, parts: list[float], seed: int) -> None:
    weights = jnp.asarray(np.array(parts) / np.sum(parts), dtype)
    chosen = np.asarray(RESAMPLING[name](weights, draws(seed)))
    assert (np.diff(chosen) >= 0).all()
    assert chosen.min() >= 0
    assert chosen.max() < 9
    assert (np.asarray(weights)[chosen] > 0).all()


@pytest.mark.parametrize("name", RESAMPLING)
@pytest.mark.parametrize("dtype", [jnp.float64, jnp.float32])
def test_so_they_do_among_many(name: str, dtype: Any) -> None:
    """A parallel cumulative sum moves by rounding where a weight is zero; that must not be a share."""
    random = np.random.default_rng(0)
    parts = np.where(random.random(20_000) < 0.5, 0.0, random.random(20_000) ** 3)
    parts[-1] = 0
    weights = jnp.asarray(parts / parts.sum(), dtype)
    chosen = jax.jit(jax.vmap(lambda seed: RESAMPLING[name](weights, draws(seed))))(jnp.arange(100))
    assert (np.asarray(weights)[np.asarray(chosen)] > 0).all()
