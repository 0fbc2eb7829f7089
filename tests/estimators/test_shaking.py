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
    assert np.sqrt(np.mean(size**2)) < 0.35 * noise


@pytest.mark.parametrize(("rate", "within"), [(25.0, 0.2), (50.0, 0.1)])
def test_few_samples_tell_as_much_of_a_rough_road(rate: float, within: float) -> None:
    """Of which 4 to 12 Hz are aliased; they differ from sample to sample as noise does, but not where the
    road is smooth. The fewer, the more of what they hold passes the filter: by a sixth at 25 Hz."""
    rng, time = np.random.default_rng(4), np.arange(4000) / 100
    is_rough = (time % 20 > 5).astype(float)
    frequencies, phases = rng.uniform(4, 12, 40), rng.uniform(0, 2 * np.pi, 40)
    shakes = np.sin(2 * np.pi * frequencies[:, None] * time + phases[:, None]).sum(axis=0)
    samples = is_rough * shakes / 20**0.5 * 0.4 + rng.normal(0, 0.08, len(time))
    usual = measured(samples, 100.0)[800:]
    every = round(100 / rate)
    few = measured(samples[::every], rate)[800 // every :]
    rough = (time % 20 > 8)[800:]  # for a while
    size = np.sqrt(np.mean(usual[rough] ** 2))
    keep = np.exp(-0.01 / 0.05)
    passes = 1 - (1 - keep) / (1 - keep * np.exp(-2j * np.pi * frequencies / 100))
    assert size == pytest.approx(0.4 * np.sqrt(np.mean(np.abs(passes) ** 4)), rel=0.05)
    assert np.sqrt(np.mean(few[rough[::every]] ** 2)) == pytest.approx(size, rel=within)


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_what_shakes_faster_than_a_car_moves_is_told_beside_noise(noise: float) -> None:
    """A sine of amplitude A at f, twice through b (1 − z)/(1 − b z), b = e^(−Δ/τ) and z = e^(−iωΔ)."""
    rate, frequency, amplitude = 100.0, 5.0, 0.5
    time = np.arange(2000) / rate
    samples = 3.0 + amplitude * np.sin(2 * np.pi * frequency * time)
    samples += noise * np.random.default_rng(2).normal(size=len(time))
    keeps, z = np.exp(-1 / rate / 0.05), np.exp(-2j * np.pi * frequency / rate)
    expected = amplitude / 2**0.5 * np.abs(keeps * (1 - z) / (1 - keeps * z)) ** 2
    size = measured(samples, rate)[500:]
    assert np.sqrt(np.mean(size**2)) == pytest.approx(expected, rel=0.15)


def test_a_force_that_lasts_shakes_nothing() -> None:
    samples = np.interp(np.arange(1500) / 100, [0, 5, 7, 15], [0.0, 0.0, 4.0, 4.0])
    size = measured(samples, 100.0)
    assert size[:500].max() < 2e-6
    assert size[-1] < 0.01
    assert size.max() < 0.11  # 2 m/s² a second: what the low pass lags behind


def test_a_swift_lane_change_shakes_nothing() -> None:
    """7 m/s² to either side within two seconds: a low pass lags behind that by ten times as much."""
    time = np.arange(600) / 100
    swerve = 7.0 * np.sin(2 * np.pi * 0.5 * (time - 2.0)) * ((time > 2.0) & (time < 4.0))
    assert measured(swerve, 100.0).max() < 0.15
