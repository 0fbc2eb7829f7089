"""The grade made from height, and how well it is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadstate.core import InputError, Signal
from roadstate.io.reference import slope_reference
from roadstate.io.slope_noise import Lines, slope_std

T = np.arange(0.0, 600.0)


def steady(speed: float, time: np.ndarray = T) -> Signal:
    return Signal(time, np.full(len(time), speed), "m/s", "gps:v")


def heights(values: np.ndarray, time: np.ndarray = T) -> Signal:
    return Signal(time, values, "m", "gps:h")


def test_a_straight_slope_is_exact_wherever_the_car_goes() -> None:
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.5, 1.5, 600))
    pace = 15 + 8 * np.sin(time / 20)
    # the height is sampled at other instants than the speed
    instants = time[:-1] + 0.3 * np.diff(time)
    path = np.concatenate([[0.0], np.cumsum((pace[1:] + pace[:-1]) / 2 * np.diff(time))])
    here = np.interp(instants, time, pace)
    distance = path[:-1] + (pace[:-1] + here) / 2 * (instants - time[:-1])
    result = slope_reference(heights(500 - 0.08 * distance, instants), Signal(time, pace), over=150.0)
    inside = np.isfinite(result.grade.values)
    assert inside.mean() > 0.9
    np.testing.assert_allclose(result.grade.values[inside], np.arctan(-0.08), rtol=1e-9)
    assert result.grade.unit == "rad"
    assert result.median_std < 1e-6
    assert result.grade.source == "slope of gps:h over "


@pytest.mark.parametrize("windows", [1.0, 1.5, 2.0, 4.0, 10.0])
def test_a_wavy_road_is_flattened_as_the_closed_form_says(windows: float) -> None:
    over, speed, amplitude = 100.0, 20.0, 0.4
    time = np.arange(0.0, 200.0, 0.005)
    wave = 2 * np.pi / (windows * over)
    distance = speed * time
    height = amplitude * np.sin(wave * distance)
    result = slope_reference(heights(height, time), steady(speed, time), over=over)
    a = np.pi / windows
    factor = 3 * (np.sin(a) - a * np.cos(a)) / a**3
    expected = np.arctan(factor * amplitude * wave * np.cos(wave * distance))
    inside = (distance > over / 2) & (distance < distance[-1] - over / 2)
    np.testing.assert_allclose(
        result.grade.values[inside], expected[inside], atol=2e-3 * amplitude * wave, rtol=0
    )


@given(
    st.lists(st.tuples(st.floats(0.2, 2.9), st.floats(-5, 5), st.floats(5.5, 40)), min_size=6, max_size=60),
    st.floats(40, 400),
)
@settings(max_examples=50, deadline=None)
def test_each_value_is_that_of_a_fit_on_its_own(
    samples: list[tuple[float, float, float]], over: float
) -> None:
    """Against a least-squares fit per sample, window by window."""
    step, height, pace = np.array(samples).T
    time = np.cumsum(step)
    height = 1000 + np.cumsum(height)
    result = slope_reference(heights(height, time), Signal(time, pace), over=over)
    distance = np.concatenate([[0.0], np.cumsum((pace[1:] + pace[:-1]) / 2 * np.diff(time))])
    for i, value in enumerate(result.grade.values):
        near = np.abs(distance - distance[i]) <= over / 2
        s = distance[near]
        is_covered = (
            near.sum() >= 4
            and distance[i] - s[0] >= over / 4
            and s[-1] - distance[i] >= over / 4
            and np.diff(s).max() <= over / 3
        )
        assert np.isfinite(value) == is_covered
        assert np.isfinite(result.std[i]) == is_covered
        if is_covered:
            slope = np.polyfit(s - distance[i], height[near], 1)[0]
            assert np.tan(value) == pytest.approx(slope, rel=1e-6, abs=1e-9)


def test_there_is_none_below_the_least_speed_in_gaps_and_at_the_ends() -> None:
    pace = np.full(600, 20.0)
    pace[100:200] = 4.0
    height = 0.02 * np.cumsum(pace)
    height[300:304] = np.nan
    result = slope_reference(heights(height), Signal(T, pace), over=160.0, min_speed=5.0)
    known = np.isfinite(result.grade.values)
    assert not known[100:200].any()
    # no window may hold the gap of 100 m, nor end less than 40 m beyond its centre
    assert not known[298:306].any()
    assert known[205:298].all()
    assert known[306:590].all()
    assert not known[:2].any()
    assert not known[-2:].any()


def test_a_gap_in_the_speed_leaves_the_distance_unknown_across_it() -> None:
    speed = steady(20.0, np.concatenate([T[:200], T[204:]]))
    result = slope_reference(heights(0.03 * 20 * T), speed, over=160.0)
    known = np.isfinite(result.grade.values)
    assert not known[200:204].any()
    np.testing.assert_allclose(result.grade.values[known], np.arctan(0.03), rtol=1e-9)
    # the window ends at the gap, and must still reach a quarter of its length beyond its centre
    assert not known[198]
    assert known[197]
    short = steady(20.0, np.concatenate([T[:200], T[202:]]))
    assert np.isfinite(slope_reference(heights(0.03 * 20 * T), short, over=160.0).grade.values[195:207]).all()


def test_nothing_to_fit_gives_nothing() -> None:
    nothing = slope_reference(heights(np.full(600, np.nan)), steady(20.0), over=100.0)
    assert np.isnan(nothing.grade.values).all()
    assert np.isnan(nothing.median_std)
    no_speed = slope_reference(heights(T), Signal(T, np.full(600, np.nan)), over=100.0)
    assert np.isnan(no_speed.grade.values).all()
    empty = slope_reference(heights(np.zeros(0), np.zeros(0)), Signal(np.zeros(0), np.zeros(0)), over=100.0)
    assert len(empty.grade) == 0


def test_a_bad_time_base_is_refused() -> None:
    backward = heights(np.zeros(3), np.array([0.0, 2.0, 1.0]))
    with pytest.raises(InputError, match="runs backward"):
        slope_reference(backward, steady(20.0), over=100.0)


def test_far_from_the_origin_nothing_cancels() -> None:
    """After 3000 km at 100 Hz, sums over the whole log would have lost the slope."""
    time = np.arange(0.0, 100.0, 0.01)
    distance = 3e6 + 30 * time
    height = 4000 + 0.01 * np.sin(distance / 30)
    near = slope_reference(heights(height, time), steady(30.0, time), over=50.0)
    far_time = np.concatenate([[-1e5], time])
    far = slope_reference(
        Signal(far_time, np.concatenate([[np.nan], height])),
        Signal(far_time, np.full(len(far_time), 30.0)),
        over=50.0,
    )
    np.testing.assert_allclose(far.grade.values[1:], near.grade.values, atol=1e-9)


# --- the standard error ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("white", "walk"), [(0.3, 0.0), (0.0, 0.05), (0.3, 0.05)])
@pytest.mark.parametrize("period", [1.0, 0.05])
def test_the_standard_error_is_the_scatter_of_many_drives(white: float, walk: float, period: float) -> None:
    """Monte Carlo: white height noise of ``white`` m, a random walk of ``walk`` m per root metre, or both."""
    speed, over = 18.0, 155.0
    rng = np.random.default_rng(7)
    time = np.arange(0.0, 300.0, period)
    errors, stated = [], []
    for _ in range(40):
        steps = rng.normal(0, walk * np.sqrt(speed * period), len(time))
        height = 0.03 * speed * time + rng.normal(0, white, len(time)) + np.cumsum(steps)
        result = slope_reference(heights(height, time), steady(speed, time), over=over)
        known = np.isfinite(result.grade.values)
        errors.append(result.grade.values[known] - np.arctan(0.03))
        stated.append(result.median_std)
    actual = np.sqrt(np.mean(np.concatenate(errors) ** 2))
    assert np.median(stated) == pytest.approx(actual, rel=0.15)


def test_rounding_is_noise_too() -> None:
    """A flat road whose height never changes its digit says no more than the digit does."""
    height = np.round(0.002 * 20 * T, 1)
    result = slope_reference(heights(height), steady(20.0), over=155.0)
    known = np.isfinite(result.grade.values)
    error = np.tan(result.grade.values[known]) - 0.002
    assert result.median_std >= 0.1 / np.sqrt(12) / np.sqrt(8 * 50**2)
    assert np.sqrt(np.mean(error**2)) < 1.5 * result.median_std


def test_noise_factors_of_short_and_long_lines_meet() -> None:
    """White noise of 1 m and a walk of 1 m per root metre, on lines of 100 samples and of more."""
    rng = np.random.default_rng(3)
    for count in (100, 400):
        x = np.linspace(0.0, 50.0, count)
        slopes, sums = [], []
        for _ in range(400):
            y = rng.normal(0, 1, count) + np.cumsum(rng.normal(0, np.sqrt(x[1]), count))
            k, c = np.polyfit(x, y, 1)
            e = y - k * x - c
            slopes.append(k)
            sums.append(((e**2).sum(), (np.diff(e) ** 2).sum()))
        residual, roughness = np.array(sums).T
        scatter = np.full(400, ((x - x.mean()) ** 2).sum())
        same = np.full(400, 50.0)
        lines = Lines(np.array(slopes), scatter, residual, roughness, same, np.full(400, count))
        assert slope_std(lines, 0.0)[0] == pytest.approx(np.std(slopes), rel=0.12)


def test_no_lines_have_no_errors() -> None:
    nothing = np.zeros(0)
    lines = Lines(nothing, nothing, nothing, nothing, nothing, np.zeros(0, dtype=np.int64))
    assert slope_std(lines, 0.1).shape == (0,)
