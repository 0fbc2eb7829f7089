"""How late and how noisy a low pass leaves signals, against the weights written out."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.estimators.blur import Blur

TIME = 0.05  # s: of the low pass
LONGEST = 1.0


def followed(times: list[float], samples: list[bool]) -> Blur:
    """After steps at ``times``, at some of which a sample came; the first is one."""
    blur, age, last = Blur.start(1), 0.0, times[0]
    for i, (time, comes) in enumerate(zip(times, samples, strict=True)):
        dt = time - last
        age, last = 0.0 if comes else age + dt, time
        share = 1.0 if i == 0 else -np.expm1(-dt / TIME)
        blur = blur.take(jnp.asarray([share]), jnp.asarray([age]), LONGEST, jnp.asarray(dt))
    return blur


def written_out(times: list[float], samples: list[bool]) -> tuple[float, float]:
    """Lag and variance by the weight that each sample has in the low-passed value."""
    weights, latest = np.zeros(len(times)), 0
    for i, (time, comes) in enumerate(zip(times, samples, strict=True)):
        latest = i if comes else latest
        share = 1.0 if i == 0 else -np.expm1(-(time - times[i - 1]) / TIME)
        weights *= 1 - share
        weights[latest] += share
    assert weights.sum() == pytest.approx(1.0)
    return float(weights @ (times[-1] - np.array(times))), float(np.sum(weights**2))


@pytest.mark.parametrize("every", [1, 2, 5, 10])
@pytest.mark.parametrize("step", [0.005, 0.01, 0.02, 0.1])
def test_held_samples_of_any_rhythm(every: int, step: float) -> None:
    count = 4 * every * max(round(0.4 / (every * step)), 4)
    for extra in range(every):
        times = [step * i for i in range(count + extra)]
        samples = [i % every == 0 for i in range(count + extra)]
        blur, (lag, noise) = followed(times, samples), written_out(times, samples)
        assert float(blur.lag[0]) == pytest.approx(lag, rel=1e-9)
        assert float(blur.noise[0]) == pytest.approx(noise, rel=1e-9)


def test_irregular_samples() -> None:
    rng = np.random.default_rng(3)
    times = [0.0, *np.cumsum(rng.uniform(0.002, 0.08, 60)).tolist()]
    samples = [True, *(rng.uniform(size=60) < 0.6).tolist()]
    blur, (lag, noise) = followed(times, samples), written_out(times, samples)
    assert float(blur.lag[0]) == pytest.approx(lag, rel=1e-9)
    assert float(blur.noise[0]) == pytest.approx(noise, rel=1e-9)


def test_rare_samples_are_noisier_and_less_late() -> None:
    fast, slow = (followed([step * i for i in range(200)], [True] * 200) for step in (0.01, 0.1))
    assert float(fast.noise[0]) == pytest.approx(0.0997, abs=1e-4)
    assert float(slow.noise[0]) > 7 * float(fast.noise[0])
    assert float(fast.lag[0]) == pytest.approx(0.0452, abs=1e-4)
    assert float(slow.lag[0]) < 0.4 * float(fast.lag[0])


def test_a_signal_that_has_gone_is_late_by_so_much_at_most() -> None:
    times = [0.0, *(2.0 + 0.01 * i for i in range(300))]
    assert float(followed(times, [True] + [False] * 300).lag[0]) == LONGEST
