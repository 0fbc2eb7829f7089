"""Signals on their own time bases: checks, repair, and the way onto one time base."""

from __future__ import annotations

import tracemalloc
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from roadstate.core import InputError, Recording, Signal
from roadstate.core.signals import in_order, interpolate

NAN = np.nan


def signal(time: object, values: object = 1.0, **rest: object) -> Signal:
    base = np.asarray(time, dtype=float)
    return Signal(base, np.broadcast_to(np.asarray(values, dtype=float), base.shape), **rest)  # type: ignore[arg-type]


class TestTimeBase:
    @pytest.mark.parametrize(
        ("time", "message"),
        [
            (
                [0, 1, 1, 2, 2],
                r"a.csv:v: time repeats at row 2 \(1 s, then 1 s; 2 such rows\); sort the log, or set "
                r"'time: \{repair: drop\}'",
            ),
            ([0, 1, 2, 1.5, 3], r"time runs backward at row 3 \(2 s, then 1.5 s; 1 such rows\)"),
            ([0, NAN, 2], "time is not a number at row 1; sort"),
            ([0, 1, np.inf], "time is not a number at row 2"),
        ],
    )
    def test_a_bad_one_is_refused_with_its_row(self, time: list[float], message: str) -> None:
        with pytest.raises(InputError, match=message):
            signal(time, source="a.csv:v").check_time()

    @pytest.mark.parametrize("time", [[], [3.0], [-1, 0, 1e-9]])
    def test_a_good_one_passes(self, time: list[float]) -> None:
        signal(time).check_time()

    def test_repair_keeps_what_goes_forward(self) -> None:
        repaired = signal([0, 1, NAN, 1, 0.5, 2, np.inf, 3, 3], np.arange(9)).repaired()
        np.testing.assert_array_equal(repaired.time, [0, 1, 2, 3])
        np.testing.assert_array_equal(repaired.values, [0, 1, 5, 7])

    @pytest.mark.parametrize("row", [0, 1, 100, 5997])
    def test_one_stamp_far_ahead_costs_one_sample(self, row: int) -> None:
        time = np.arange(6000) * 0.01
        time[row] = 1e4
        repaired = signal(time, np.arange(6000)).repaired()
        np.testing.assert_array_equal(repaired.values, np.delete(np.arange(6000.0), row))

    def test_a_clock_that_is_ahead_for_a_while_costs_that_while(self) -> None:
        time = np.arange(1000) * 0.01
        time[200:260] += 3.0
        repaired = signal(time, np.arange(1000)).repaired()
        np.testing.assert_array_equal(repaired.values, np.r_[0:200, 260:1000])

    @given(st.lists(st.integers(-5, 5), max_size=9))
    def test_repair_keeps_as_many_as_can_be(self, stamps: list[int]) -> None:
        keep = in_order(np.array(stamps, dtype=float))
        most = max(
            (
                len(rows)
                for n in range(len(stamps) + 1)
                for rows in combinations(stamps, n)
                if all(a < b for a, b in pairwise(rows))
            ),
            default=0,
        )
        assert keep.sum() == most

    @given(arrays(float, st.integers(0, 30), elements=st.floats(allow_nan=True, allow_infinity=True)))
    def test_whatever_is_repaired_passes(self, time: np.ndarray) -> None:
        repaired = signal(time, np.arange(len(time))).repaired()
        repaired.check_time()
        assert np.isin(repaired.values, np.arange(len(time))).all()

    def test_shapes_must_agree(self) -> None:
        with pytest.raises(ValueError, match=r"time \(2,\) and values \(3,\)"):
            Signal(np.zeros(2), np.zeros(3))
        with pytest.raises(ValueError, match="must be equal"):
            Signal(np.zeros((2, 2)), np.zeros((2, 2)))

    def test_rate_is_the_median_one(self) -> None:
        assert signal([0, 0.1, 0.2, 5.0, 5.1]).rate == pytest.approx(10)
        assert signal([1.0]).rate == 0


class TestResample:
    def test_a_common_base_is_kept_as_it_is(self) -> None:
        time = np.array([0.0, 0.013, 0.5, 7.0])
        recording = Recording(
            {"speed": Signal(time, np.arange(4.0)), "accel_x": Signal(time.copy(), np.ones(4))},
            {"start_time": "2020-01-01"},
        )
        log = recording.resample()
        assert log.time is time
        np.testing.assert_array_equal(log["speed"], np.arange(4))
        assert log.metadata == {"start_time": "2020-01-01"}

    def test_each_sample_goes_to_its_nearest_tick(self) -> None:
        fast = np.array([0.0, 0.101, 0.196, 0.305])
        slow = np.array([0.004, 0.296])
        log = Recording({"speed": signal(fast, [1, 2, 3, 4]), "accel_x": signal(slow, [5, 6])}).resample(10)
        np.testing.assert_allclose(log.time, [0, 0.1, 0.2, 0.3])
        np.testing.assert_array_equal(log["speed"], [1, 2, 3, 4])
        np.testing.assert_array_equal(log["accel_x"], [5, NAN, NAN, 6])
        assert log.metadata["rate"] == 10

    def test_several_in_one_tick_are_averaged_over_valid_ones(self) -> None:
        time = np.arange(12) * 0.01
        values = np.arange(12.0)
        values[7] = NAN
        log = Recording({"speed": Signal(time, values)}).resample(20)
        # ticks at 0, 0.05, 0.1 take the samples nearest to them
        np.testing.assert_allclose(log["speed"], [np.mean([0, 1, 2]), np.mean([3, 4, 5, 6]), 9.5])

    def test_averaging_attenuates_what_would_alias(self) -> None:
        time = np.arange(0, 10, 0.001)
        noise = np.sin(2 * np.pi * 95 * time)  # would appear at 5 Hz when every tenth were picked
        log = Recording({"accel_x": Signal(time, noise)}).resample(100)
        np.testing.assert_allclose(log.time[:-1], time[::10], atol=1e-12)
        assert np.std(log["accel_x"]) < 0.15 * np.std(noise[::10])

    def test_ticks_in_a_gap_are_left_out(self) -> None:
        log = Recording({"speed": signal([0, 0.1, 0.2, 60.0, 60.1])}).resample(10)
        np.testing.assert_allclose(log.time, [0, 0.1, 0.2, 60, 60.1])

    def test_the_rate_is_the_fastest_measured_signals(self) -> None:
        slow, fast = np.arange(0, 2, 0.1), np.arange(0, 2, 0.02)
        truth = np.arange(0, 2, 0.001)
        log = Recording(
            {"speed": signal(slow), "accel_x": signal(fast), "ref_grade": signal(truth)}
        ).resample()
        assert log.metadata["rate"] == 50
        assert np.isfinite(log["speed"]).sum() == len(slow)
        assert np.isfinite(log["accel_x"]).all()

    def test_the_rate_has_a_ceiling(self) -> None:
        base = np.arange(0, 1, 0.001)
        log = Recording({"speed": signal(base), "accel_x": signal(base[::2])}).resample()
        assert log.metadata["rate"] == 100

    def test_references_are_interpolated_and_never_extrapolated(self) -> None:
        measured = signal(np.arange(0, 10.01, 0.5))
        reference = signal([2.25, 3.25, 4.25, 8.25, 9.25], [0, 1, 2, 3, 4])
        grade = Recording({"speed": measured, "ref_grade": reference}).resample(2)["ref_grade"]
        inside = (measured.time >= 2.25) & (measured.time <= 4.25) | (measured.time >= 8.25) & (
            measured.time <= 9.25
        )
        np.testing.assert_array_equal(np.isfinite(grade), inside)  # neither outside nor across the 4 s gap
        np.testing.assert_allclose(grade[measured.time == 3.0], 0.75)

    def test_measured_channels_are_not_interpolated(self) -> None:
        log = Recording({"speed": signal(np.arange(0, 1, 0.01)), "altitude": signal([0, 0.5], [0, 1])})
        altitude = log.resample()["altitude"]
        assert np.isfinite(altitude).sum() == 2

    def test_only_references_are_resampled_too(self) -> None:
        recording = Recording({"ref_grade": signal([0, 1, 2]), "ref_bank": signal([0, 0.5, 2])})
        assert len(recording.resample()) == 3

    def test_an_empty_signal_becomes_a_missing_channel(self) -> None:
        log = Recording({"speed": signal([0, 1, 2]), "altitude": signal([])}).resample()
        assert np.isnan(log["altitude"]).all()
        assert "altitude" not in log.available

    @given(st.integers(0, 2**32 - 1), st.sampled_from([10.0, 50.0, 83.0]))
    def test_jitter_under_half_a_tick_loses_nothing(self, seed: int, rate: float) -> None:
        random = np.random.default_rng(seed)
        ticks = np.flatnonzero(random.random(300) < 0.7)
        ticks = np.union1d(ticks, [0, 1, 2])
        time = (ticks + random.uniform(-0.49, 0.49, len(ticks)) * (ticks > 0)) / rate
        values = random.normal(size=len(ticks))
        log = Recording({"speed": Signal(time, values)}).resample(rate)
        np.testing.assert_allclose(log.time, ticks / rate, atol=1e-9)
        np.testing.assert_array_equal(log["speed"], values)

    @pytest.mark.parametrize("late", [0.0, 0.0049, 0.005, 0.0051, 0.0099])
    def test_jitter_half_way_between_ticks_loses_nothing(self, late: float) -> None:
        random = np.random.default_rng(1)
        base = np.arange(1000) * 0.01
        other = base + late + random.normal(0, 1e-4, 1000)
        values = random.normal(size=1000)
        log = Recording({"speed": signal(base), "accel_x": Signal(other, values)}).resample()
        assert log.metadata["rate"] == 100
        found = log["accel_x"]
        np.testing.assert_array_equal(found[np.isfinite(found)], values)
        assert np.abs(log.time[np.isfinite(found)] - other).max() < 0.0055

    @given(st.integers(0, 2**32 - 1))
    def test_means_are_preserved(self, seed: int) -> None:
        """Bins partition the samples: the count-weighted mean of the ticks is the mean of the samples."""
        random = np.random.default_rng(seed)
        time = np.cumsum(random.exponential(0.01, 200))
        values = random.normal(size=200)
        log = Recording({"speed": Signal(time, values), "accel_x": Signal(time[::3], values[::3])}).resample(
            25
        )
        index = np.rint((time - time[0]) * 25).astype(int)
        counts = np.bincount(index)[np.rint((log.time - time[0]) * 25).astype(int)]
        assert np.sum(log["speed"] * counts) / 200 == pytest.approx(values.mean(), abs=1e-12)

    def test_a_huge_gap_costs_no_memory(self) -> None:
        near = np.arange(1000) * 0.01
        time = np.concatenate([near, near + 3e8])  # ten years later
        tracemalloc.start()
        log = Recording({"speed": signal(time), "accel_x": signal(time[::2])}).resample(100)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert len(log) == 2000
        assert peak < 5e6

    @pytest.mark.parametrize("last", [1e18, 1e300])
    def test_a_span_beyond_reason_is_refused(self, last: float) -> None:
        recording = Recording({"speed": signal([0, 1, last], source="a.csv:v"), "accel_x": signal([0, 1])})
        with pytest.raises(InputError, match=r"a.csv:v: time runs from 0 s to 1e\+.*check the unit"):
            recording.resample(10)

    @pytest.mark.parametrize("rate", [0.0, -1.0, 0.09, 10_001.0, NAN, np.inf])
    def test_a_rate_out_of_range_is_refused(self, rate: float) -> None:
        with pytest.raises(InputError, match=r"a rate of .* Hz is out of range; choose 0.1 to 10000 Hz"):
            Recording({"speed": signal([0, 1])}).resample(rate)

    @pytest.mark.parametrize(
        ("signals", "message"),
        [
            ({}, "no canonical channel found; give a mapping"),
            ({"Geschw": signal([0, 1])}, "'Geschw' is not a canonical channel; apply a mapping first"),
            ({"time": signal([0, 1])}, "'time' is not a canonical channel"),
            ({"speed": signal([0, 1]), "accel_x": signal([1, 0], source="x")}, "x: time runs backward"),
            ({"speed": signal([]), "ref_grade": signal([])}, "b.csv: every mapped channel is empty"),
        ],
    )
    def test_what_cannot_be_resampled_is_refused(self, signals: dict[str, Signal], message: str) -> None:
        for rate in (None, 10):
            with pytest.raises(InputError, match=message):
                Recording(signals, {"files": ["b.csv"]}).resample(rate)


class TestInterpolate:
    def test_passes_over_missing_samples(self) -> None:
        out = interpolate(signal([0, 0.2, 0.4], [0, NAN, 4]), np.array([0.0, 0.1, 0.2, 0.4]))
        np.testing.assert_allclose(out, [0, 1, 2, 4])

    def test_reaches_over_two_of_its_own_steps(self) -> None:
        slow = signal(np.arange(0, 50, 5.0), np.arange(10))
        assert np.isfinite(interpolate(slow, np.array([2.5, 44.0]))).all()
        gap = signal([0, 5, 10, 15, 26], np.arange(5))
        np.testing.assert_array_equal(
            np.isnan(interpolate(gap, np.array([15.0, 15.1, 20.0, 25.9, 26.0]))),
            [False, True, True, True, False],
        )

    @pytest.mark.parametrize("values", [[], [1.0], [NAN, 1.0]])
    def test_one_sample_is_no_line(self, values: list[float]) -> None:
        out = interpolate(signal(np.arange(len(values)), values), np.array([0.0, 1.0]))
        assert np.isnan(out).all()


def test_a_recording_is_a_mapping_of_signals() -> None:
    recording = Recording({"speed": signal([0, 1]), "accel_x": signal([0, 2])})
    assert list(recording) == ["speed", "accel_x"]
    assert len(recording) == 2
    assert recording["speed"].rate == 1
    assert not recording.is_common_base
