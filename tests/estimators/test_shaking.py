"""How much a road shakes the body."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from numpy.typing import NDArray

from roadstate.estimators.shaking import Shaking


def measured(samples: NDArray[np.float64], rate: float) -> NDArray[np.float64]:
    """(T,) size after each sample."""
    one = jnp.ones(1, bool)

    def step(state: Shaking, at: tuple[Array, Array]) -> tuple[Shaking, Array]:
        value, i = at
        state = state.take(value[None], one, (i == 0)[None], jnp.full(1, 1 / rate))
        return state, state.size[0]

    count = jnp.arange(len(samples))
    return np.asarray(jax.lax.scan(step, Shaking.still(1), (jnp.asarray(samples), count))[1])


@pytest.mark.parametrize("rate", [50.0, 100.0, 200.0])
@pytest.mark.parametrize("noise", [0.05, 0.5])
def test_a_sensors_noise_is_no_shaking(rate: float, noise: float) -> None:
    samples = noise * np.random.default_rng(1).normal(size=round(20 * rate))
    size = measured(samples, rate)[round(3 * rate) :]
    assert np.sqrt(np.mean(size**2)) < 0.3 * noise


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_what_shakes_faster_than_a_car_moves_is_told_beside_noise(noise: float) -> None:
    """A sine of amplitude A at f, through 1 − 1/(1 + iωτ), has A ωτ/√(1 + (ωτ)²)/√2."""
    rate, frequency, amplitude = 100.0, 5.0, 0.5
    time = np.arange(2000) / rate
    samples = 3.0 + amplitude * np.sin(2 * np.pi * frequency * time)
    samples += noise * np.random.default_rng(2).normal(size=len(time))
    turn = 2 * np.pi * frequency * 0.05
    expected = amplitude / 2**0.5 * turn / np.hypot(1, turn)
    size = measured(samples, rate)[500:]
    assert np.sqrt(np.mean(size**2)) == pytest.approx(expected, rel=0.15)


def test_a_force_that_lasts_shakes_nothing() -> None:
    samples = np.interp(np.arange(1500) / 100, [0, 5, 7, 15], [0.0, 0.0, 4.0, 4.0])
    size = measured(samples, 100.0)
    assert size[:500].max() < 2e-6
    assert size[-1] < 0.01
    assert size.max() < 0.11  # 2 m/s² a second: what the low pass lags behind
