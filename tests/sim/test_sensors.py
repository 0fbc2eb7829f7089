"""One sensor's errors: each has the size, colour and delay it says."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadstate.core import InputError
from roadstate.sim.sensors import Probe
from roadstate.sim.sensors.probe import gauss_markov, low_pass

TIME = np.arange(400_001) * 1e-3
STILL = np.zeros(len(TIME))


def read(probe: Probe, values: np.ndarray = STILL, seed: int = 0) -> np.ndarray:
    return probe.read(TIME[: len(values)], values, np.random.default_rng(seed))[1]


def allan_deviation(values: np.ndarray, rate: float, tau: float) -> float:
    """Overlapping Allan deviation of a rate signal (IEEE Std 952, annex C)."""
    m = round(tau * rate)
    angle = np.concatenate([[0.0], np.cumsum(values) / rate])
    second = angle[2 * m :] - 2 * angle[m:-m] + angle[: -2 * m]
    return float(np.sqrt(np.mean(second**2) / 2) / tau)


def test_ideal_sensor_reads_the_truth() -> None:
    values = np.sin(3 * TIME) + 0.2 * TIME
    assert read(Probe(rate=1000.0), values) == pytest.approx(values, abs=1e-9)
    assert read(Probe(rate=50.0), values) == pytest.approx(values[::20], abs=1e-12)


@pytest.mark.parametrize("rate", [20.0, 100.0])
def test_noise_density_is_the_allan_deviation_at_one_second(rate: float) -> None:
    noise = read(Probe(rate=rate, noise_density=0.03))
    assert np.std(noise) == pytest.approx(0.03 * np.sqrt(rate), rel=0.03)
    assert allan_deviation(noise, rate, 1.0) == pytest.approx(0.03, rel=0.12)
    assert allan_deviation(noise, rate, 4.0) == pytest.approx(0.015, rel=0.25)


def test_bias_walk_grows_with_the_root_of_time() -> None:
    ends = np.array(
        [read(Probe(rate=10.0, walk=0.02), STILL[:100_001], seed)[[250, 1000]] for seed in range(400)]
    )
    assert np.std(ends, axis=0) == pytest.approx(0.02 * np.sqrt([25.0, 100.0]), rel=0.12)


def test_bias_and_gain_are_drawn_once() -> None:
    probe = Probe(bias=0.1, gain_std=0.02)
    values = np.full(2001, 5.0)
    errors = np.array([read(probe, values, seed) - 5.0 for seed in range(500)])
    assert np.ptp(errors, axis=1).max() < 1e-12
    assert np.std(errors[:, 0]) == pytest.approx(np.hypot(0.1, 0.1), rel=0.12)
    assert read(Probe(offset=-0.3, gain=0.1), values) == pytest.approx(5.2)


def test_wander_is_stationary_and_forgets_in_its_time() -> None:
    probe = Probe(rate=10.0, wander=2.0, wander_time=5.0)
    ends = np.array([read(probe, STILL[:20_001], seed)[[0, 50, 200]] for seed in range(1500)])
    assert np.std(ends, axis=0) == pytest.approx(2.0, rel=0.08)
    correlation = np.corrcoef(ends.T)
    assert correlation[0, 1] == pytest.approx(np.exp(-1), abs=0.08)
    assert abs(correlation[0, 2]) < 0.1


def test_process_of_unit_variance_from_its_shocks() -> None:
    shocks = np.random.default_rng(1).standard_normal(7)
    expected = [shocks[0]]
    for shock in shocks[1:]:
        expected.append(np.exp(-0.3) * expected[-1] + np.sqrt(1 - np.exp(-0.6)) * shock)
    assert gauss_markov(shocks, 0.3) == pytest.approx(expected)


def test_least_reading_cuts_off_and_leaves_the_rest_alone() -> None:
    """An offset upwards is read where there is nothing; one downwards is not seen."""
    values = np.maximum(np.sin(3 * TIME[:4001]), 0.0)
    for offset in (0.05, -0.05):
        whole = read(Probe(offset=offset, noise=0.05, resolution=0.001), values)
        cut = read(Probe(offset=offset, noise=0.05, resolution=0.001, least=0.0), values)
        assert whole.min() < -0.001
        assert np.array_equal(cut, np.maximum(whole, 0.0))


def test_readings_are_multiples_of_the_resolution_and_its_error_is_uniform() -> None:
    values = np.linspace(-1, 1, len(TIME))
    reading = read(Probe(rate=1000.0, resolution=0.01), values)
    assert reading / 0.01 == pytest.approx(np.round(reading / 0.01), abs=1e-9)
    assert np.std(reading - values) == pytest.approx(0.01 / np.sqrt(12), rel=0.01)


def test_limit_cuts_both_ways() -> None:
    reading = read(Probe(limit=0.4), np.sin(TIME[:10_001]))
    assert reading.max() == pytest.approx(0.4)
    assert reading.min() == pytest.approx(-0.4)


@pytest.mark.parametrize(("delay", "bandwidth"), [(0.02, None), (0.0, 15.0), (0.013, 30.0)])
def test_delay_is_where_the_cross_correlation_peaks(delay: float, bandwidth: float | None) -> None:
    rng = np.random.default_rng(3)
    values = low_pass(rng.standard_normal(60_001), 1e-3, 2.0)
    reading = read(Probe(rate=1000.0, delay=delay, bandwidth=bandwidth), values)
    lags = np.arange(0, 80)
    power = [
        np.dot(values[1000 : -100 - k], reading[1000 + k : -100 or None][: len(values) - 1100 - k])
        for k in lags
    ]
    best = int(np.argmax(power))
    a, b, c = power[best - 1], power[best], power[best + 1]
    found = (best + 0.5 * (a - c) / (a - 2 * b + c)) * 1e-3
    group = 0.0 if bandwidth is None else np.sqrt(2) / (2 * np.pi * bandwidth)
    assert found == pytest.approx(delay + group, abs=1.2e-3)


@pytest.mark.parametrize("frequency", [2.0, 10.0, 25.0])
def test_low_pass_is_a_butterworth_of_second_order(frequency: float) -> None:
    values = np.sin(2 * np.pi * frequency * TIME[:20_001])
    out = low_pass(values, 1e-3, 10.0)[10_000:]
    expected = 1 / np.sqrt(1 + (frequency / 10.0) ** 4)
    assert np.sqrt(2) * np.std(out) == pytest.approx(expected, rel=0.01)


def test_low_pass_starts_at_rest_and_keeps_a_level() -> None:
    assert low_pass(np.full(500, 9.81), 1e-2, 5.0) == pytest.approx(9.81, abs=1e-12)


def test_jitter_makes_an_error_in_proportion_to_the_slope() -> None:
    error = read(Probe(jitter=0.002), 5.0 * TIME) - 5.0 * TIME[::10]
    assert np.std(error[10:-10]) == pytest.approx(0.01, rel=0.03)


def test_what_counts_reads_nothing_at_rest_and_never_below_zero() -> None:
    values = np.concatenate([np.zeros(500), np.linspace(0, -3, 1500)])
    reading = read(Probe(rate=1000.0, noise=0.2, is_magnitude=True), values)
    assert (reading[:500] == 0).all()
    assert (reading >= 0).all()
    assert reading[-100:].mean() == pytest.approx(2.9, abs=0.1)


def test_one_figure_leaves_the_draws_of_the_others_alone() -> None:
    plain, more = read(Probe(noise=0.1)), read(Probe(noise=0.1, offset=1.0, delay=0.5, resolution=0.0))
    assert more - 1.0 == pytest.approx(plain, abs=1e-12)


@given(st.sampled_from(["noise", "delay", "walk", "rate", "bandwidth", "wander_time", "gain"]), st.booleans())
def test_impossible_figures_are_refused(name: str, is_nan: bool) -> None:
    value = np.nan if is_nan or name == "gain" else -1.0
    with pytest.raises(InputError):
        Probe(**{name: value})


@pytest.mark.parametrize("name", ["rate", "bandwidth", "wander_time"])
def test_zero_is_refused_where_it_would_divide(name: str) -> None:
    with pytest.raises(InputError, match="above 0"):
        Probe(**{name: 0.0})
