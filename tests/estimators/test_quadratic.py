"""The quadratic that forgets, against the weighted least squares it stands for."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.estimators.quadratic import Quadratic

STEP = 0.01


def followed(samples: np.ndarray, memory: float, steps: np.ndarray | None = None) -> Quadratic:
    """After samples of one signal, the first of which begins it."""
    fit = Quadratic.start(1)
    for i, sample in enumerate(samples):
        dt = STEP if steps is None else steps[i]
        fit = fit.take(jnp.asarray([sample]), jnp.asarray([i == 0]), jnp.asarray([memory]), jnp.asarray(dt))
    return fit


@pytest.mark.parametrize("memory", [0.02, 0.05, 0.2])
def test_it_is_the_parabola_of_least_squares(memory: float) -> None:
    """Of white noise, samples weighed by exp(-t/memory); long after the first, which is no sample of it."""
    samples = np.random.default_rng(1).normal(size=600)
    age = np.arange(600)[::-1] * STEP
    weight = np.exp(-0.5 * age / memory)
    powers = np.stack([np.ones_like(age), -age, 0.5 * age**2], axis=1)
    expected = np.linalg.lstsq(weight[:, None] * powers, weight * samples, rcond=None)[0]
    np.testing.assert_allclose(np.ravel(followed(samples, memory)), expected, rtol=1e-6)


def test_a_parabola_has_no_lag_however_the_steps_vary() -> None:
    steps = np.random.default_rng(2).uniform(0.002, 0.03, 300)
    time = np.cumsum(steps)
    fit = followed(3 - 2 * time + 4 * time**2, 0.05, steps)
    now = time[-1]
    np.testing.assert_allclose(np.ravel(fit), [3 - 2 * now + 4 * now**2, -2 + 8 * now, 8], rtol=1e-5)
    value, rate = fit.ahead(jnp.asarray(0.1))
    later = now + 0.1
    np.testing.assert_allclose([value[0], rate[0]], [3 - 2 * later + 4 * later**2, -2 + 8 * later], rtol=1e-5)


def test_it_begins_at_its_first_sample() -> None:
    np.testing.assert_array_equal(np.ravel(followed(np.array([7.0]), 0.05)), [7, 0, 0])


def test_after_a_gap_it_begins_anew() -> None:
    time = np.arange(100) * STEP
    fit = followed(np.append(50 * time**2, -3.0), 0.05, np.append(np.full(100, STEP), 1.0))
    np.testing.assert_array_equal(np.ravel(fit), [-3, 0, 0])


def test_a_step_of_no_time_changes_nothing_by_much() -> None:
    fit = followed(np.full(100, 2.0), 0.05)
    again = fit.take(jnp.asarray([2.0]), jnp.asarray([False]), jnp.asarray([0.05]), jnp.asarray(0.0))
    np.testing.assert_allclose(np.ravel(again), [2, 0, 0], atol=1e-9)
