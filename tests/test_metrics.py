"""Each metric against a calculation by hand."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from roadstate.core import Estimates, InputError, Log
from roadstate.metrics import Metrics, evaluate, settle_time


def case(
    estimate: ArrayLike,
    truth: ArrayLike,
    std: ArrayLike = 1.0,
    time: ArrayLike | None = None,
    quantity: str = "speed",
) -> tuple[Estimates, Log]:
    values = np.asarray(estimate, float)
    t = np.arange(len(values), dtype=float) if time is None else np.asarray(time, float)
    sigma = np.broadcast_to(np.asarray(std, float), values.shape)
    reference = {"speed": "ref_velocity_x", "grade": "ref_grade"}[quantity]
    log = Log(t, {reference: np.asarray(truth, float)})
    return Estimates(t, {quantity: values}, {quantity: sigma}, np.zeros(len(t), np.int8)), log


def speed_metrics(*args: ArrayLike, settle: float = 0.0) -> Metrics:
    return evaluate(*case(*args), settle=settle)["speed"]


ESTIMATE = [11.0, 9.0, 14.0, 20.0]
TRUTH = [10.0, 10.0, 12.0, 16.0]  # e = 1, -1, 2, 4
STD = [0.5, 1.0, 1.0, 2.0]  # e/σ = 2, -1, 2, 2


def test_mae_is_the_mean_of_the_magnitudes() -> None:
    assert speed_metrics(ESTIMATE, TRUTH).mae == pytest.approx((1 + 1 + 2 + 4) / 4)


def test_rmse_is_the_root_of_the_mean_square() -> None:
    assert speed_metrics(ESTIMATE, TRUTH).rmse == pytest.approx(math.sqrt((1 + 1 + 4 + 16) / 4))


def test_max_is_the_largest_magnitude_whatever_its_sign() -> None:
    assert speed_metrics(ESTIMATE, TRUTH).max == 4.0
    assert speed_metrics([1.0, -7.0, 2.0], [0.0, 0.0, 0.0]).max == 7.0


def test_bias_is_the_mean_error() -> None:
    assert speed_metrics(ESTIMATE, TRUTH).bias == pytest.approx(1.5)


def test_mae_bias_removed_is_taken_about_the_bias() -> None:
    # e - 1.5 = -0.5, -2.5, 0.5, 2.5
    assert speed_metrics(ESTIMATE, TRUTH).mae_bias_removed == pytest.approx(1.5)


def test_correlation_is_pearsons() -> None:
    # deviations (-2.5, -4.5, 0.5, 6.5) and (-2, -2, 0, 4): 40 / √(69 · 24)
    assert speed_metrics(ESTIMATE, TRUTH).correlation == pytest.approx(40 / math.sqrt(69 * 24))


def test_correlation_with_a_constant_does_not_exist() -> None:
    assert speed_metrics([0.1, 0.3, 0.2], [0.1, 0.1, 0.1]).correlation is None
    assert speed_metrics([1.0], [2.0]).correlation is None


def test_nees_is_the_mean_squared_ratio() -> None:
    assert speed_metrics(ESTIMATE, TRUTH, STD).nees == pytest.approx((4 + 1 + 4 + 4) / 4)


def test_coverage_counts_what_the_interval_holds() -> None:
    assert speed_metrics(ESTIMATE, TRUTH, STD).coverage95 == pytest.approx(1 / 4)
    just_inside, just_outside = 1.959963, 1.959965
    assert speed_metrics([just_inside, just_outside], [0.0, 0.0]).coverage95 == pytest.approx(0.5)


def test_a_reference_that_errs_itself_is_counted() -> None:
    estimates, log = case([0.02, -0.01], [0.0, 0.0], 0.006, quantity="grade")
    log = replace(log, metadata={"reference_std": {"ref_grade": 0.008}})
    found = evaluate(estimates, log)["grade"]
    assert found.nees == pytest.approx((0.02**2 + 0.01**2) / 2 / 0.01**2)
    assert found.coverage95 == 0.5
    assert found.rmse == pytest.approx(
        evaluate(*case([0.02, -0.01], [0.0, 0.0], quantity="grade"))["grade"].rmse
    )


@pytest.mark.parametrize("told", [-0.1, math.nan, math.inf, "much", True, None])
def test_what_is_no_standard_deviation_of_a_reference_is_refused(told: object) -> None:
    estimates, log = case([0.02], [0.0], quantity="grade")
    log = replace(log, metadata={"reference_std": {"ref_grade": told}})
    with pytest.raises(InputError, match="reference_std"):
        evaluate(estimates, log)


@pytest.mark.parametrize("told", [{}, {"ref_altitude": 1.0}, None, 3])
def test_a_reference_of_which_nothing_is_told_is_exact(told: object) -> None:
    estimates, log = case([0.02], [0.0], 0.02, quantity="grade")
    log = replace(log, metadata={"reference_std": told})
    assert evaluate(estimates, log)["grade"].nees == pytest.approx(1.0)


def test_without_a_standard_deviation_there_is_no_nees() -> None:
    found = speed_metrics(ESTIMATE, TRUTH, [np.nan, 0.0, np.nan, np.nan])
    assert found.nees is None
    assert found.coverage95 is None


def test_only_samples_where_both_are_there_count() -> None:
    found = speed_metrics([1.0, np.nan, 3.0, 9.0], [0.0, 0.0, 0.0, np.nan])
    assert found.n == 2
    assert found.mae == pytest.approx(2.0)


def test_grade_errors_are_slopes_in_per_cent_and_its_nees_is_of_the_angle() -> None:
    truth, estimate, sigma = math.atan(0.05), math.atan(0.08), 0.02
    found = evaluate(*case([estimate] * 3, [truth] * 3, sigma, quantity="grade"))["grade"]
    assert found.unit == "%"
    assert found.mae == pytest.approx(3.0)
    assert found.nees == pytest.approx(((estimate - truth) / sigma) ** 2)


def test_settle_leaves_out_the_start_of_all_but_the_settle_time() -> None:
    time = np.array([100.0, 101.0, 102.0, 103.0, 104.0, 105.0])
    estimates, log = case([8.0, 8.0, 1.0, 1.0, 1.0, 1.0], np.zeros(6), time=time)
    everything, later = evaluate(estimates, log)["speed"], evaluate(estimates, log, settle=2.0)["speed"]
    assert everything.n == 6
    assert everything.max == 8.0
    assert later.n == 4
    assert later.max == 1.0
    assert everything.settle_s == later.settle_s == 2.0


def test_settle_that_leaves_nothing_is_refused() -> None:
    estimates, log = case([1.0, 1.0, 1.0], [0.0, 0.0, np.nan])
    with pytest.raises(InputError, match=r"ref_velocity_x: no sample of speed is left .* lies at 1 s"):
        evaluate(estimates, log, settle=2.0)


@pytest.mark.parametrize("settle", [-1.0, math.nan, math.inf])
def test_settle_must_be_a_time(settle: float) -> None:
    with pytest.raises(InputError, match="settle must be 0 s or more"):
        evaluate(*case(ESTIMATE, TRUTH), settle=settle)


def test_another_time_base_is_refused() -> None:
    estimates, log = case(ESTIMATE, TRUTH)
    with pytest.raises(InputError, match="differ in time"):
        evaluate(estimates, log.between(0.0, 3.0))


def test_no_reference_no_metrics() -> None:
    estimates, log = case(ESTIMATE, TRUTH)
    assert evaluate(estimates, Log(log.time, {})) == {}
    assert evaluate(estimates, log.with_channels({"ref_velocity_x": np.full(4, np.nan)})) == {}


def test_json_has_no_nan() -> None:
    metrics = Metrics("m/s", 1.0, math.inf, 1.0, math.nan, 1.0, None, None, 2.0, 0.5, 3)
    found = metrics.to_json()
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert found["rmse"] is None
    assert found["bias"] is None
    assert found["n"] == 3
    assert set(found) >= {"unit", "mae", "rmse", "max", "nees", "coverage95", "settle_s", "correlation"}


def decay(noise: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Half-second samples; an alternating error of ``noise`` under a start that is off until 3 s."""
    time = np.arange(0.0, 20.0, 0.5)
    error = noise * (-1.0) ** np.arange(len(time))
    error[time < 3.0] += 50.0
    return time, error


def test_settle_time_is_where_the_error_enters_its_own_noise() -> None:
    time, error = decay(0.2)
    # second half: median 0 (20 samples, half ±0.2 each), |e - m| = 0.2, bound 3 · 1.4826 · 0.2
    assert settle_time(time, error) == 3.0


def test_an_error_just_outside_the_bound_has_not_settled() -> None:
    time, error = decay(0.2)
    bound = 3 * 1.4826 * 0.2
    error[time == 3.0] = bound + 1e-6
    assert settle_time(time, error) == 3.5
    error[time == 3.0] = bound - 1e-6
    assert settle_time(time, error) == 3.0


def test_it_must_stay_inside_for_a_whole_second() -> None:
    time, error = decay(0.2)
    error[time == 1.0] = 0.0  # dips in, alone
    error[time == 1.5] = 0.0
    error[time == 2.0] = 50.0
    assert settle_time(time, error) == 3.0


def test_a_constant_offset_has_settled() -> None:
    assert settle_time(np.arange(5.0), np.full(5, -4.0)) == 0.0


def test_an_error_that_grows_never_settles_into_nothing() -> None:
    time = np.arange(0.0, 8.0, 0.25)
    error = np.where(np.arange(len(time)) % 4 == 0, 30.0, 0.0)  # a quarter outside, in every second
    assert settle_time(time, error) is None


def test_a_log_shorter_than_a_second_cannot_settle() -> None:
    assert settle_time(np.array([0.0, 0.4]), np.zeros(2)) is None


@given(st.integers(0, 2**31), st.integers(2, 300))
def test_settle_time_is_what_its_definition_says(seed: int, n: int) -> None:
    random = np.random.default_rng(seed)
    elapsed = np.cumsum(random.exponential(random.choice([0.05, 0.5, 2.0]), n))
    error = random.standard_t(2, n) + np.exp(-elapsed / 5.0)
    late = error[elapsed >= (elapsed[0] + elapsed[-1]) / 2]
    center = np.median(late)
    bound = abs(center) + 3 * 1.4826 * np.median(np.abs(late - center))
    expected = None
    for i in range(n):
        ends = [j for j in range(i, n) if elapsed[j] >= elapsed[i] + 1.0]
        if ends and (np.abs(error[i : ends[0] + 1]) <= bound).all():
            expected = elapsed[i]
            break
    assert settle_time(elapsed, error) == expected
