"""White noise comes out as strong as it is, vibration as what is left of it, too much as the file says."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.estimators.noise_learning import NoiseLearner, Unrest

DT = 0.01


def after(values: np.ndarray, usual: bool = True, stated: float = 1.0) -> float:
    learner = NoiseLearner()

    def body(state: Unrest, value: jax.Array) -> tuple[Unrest, None]:
        told = jnp.asarray([stated]), jnp.asarray([usual]), jnp.asarray(DT)
        return learner.learn(state, value[None], *told), None

    state, _ = jax.lax.scan(body, learner.init(1), jnp.asarray(values))
    return float(learner.scale(state)[0])


@pytest.mark.parametrize("share", [0.3, 0.6])
def test_white_noise_is_found(share: float) -> None:
    """With the margin of 1.5 in the variance and what two minutes leave of the file's word."""
    noise = np.random.default_rng(0).normal(size=(20, 12000))
    found = [after(share * row) for row in noise]
    assert np.mean(np.square(found)) == pytest.approx(1.5 * (share**2 + 0.023), rel=0.2)
    assert min(found) > 0.7 * share


def test_vibration_averages_out_and_what_lasts_does_not() -> None:
    time = DT * np.arange(12000)
    assert after(np.sin(2 * np.pi * 8 * time)) < 0.4  # of samples with a root mean square of 0.7
    assert after(0.3 * np.sign(np.sin(2 * np.pi * 0.05 * time))) == 1.0


def test_the_file_is_the_most_and_there_is_a_least() -> None:
    noise = np.random.default_rng(1).normal(size=12000)
    assert after(5 * noise) == 1.0
    assert after(1e-9 * noise) == pytest.approx(np.sqrt(0.05), rel=0.2)


def test_units_do_not_matter_and_unusual_or_missing_samples_say_nothing() -> None:
    noise = np.random.default_rng(2).normal(size=3000)
    assert after(0.3 * noise) == pytest.approx(after(30 * noise, stated=100.0), rel=1e-9)
    assert after(0.01 * noise, usual=False) == 1.0
    assert after(np.full(3000, np.nan)) == 1.0
