"""A stream whose samples come late, in parts or twice, against one to which all came in order."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contracts.plausible import plausible_log
from roadstate.core import InputError
from roadstate.estimators import Estimate, build
from roadstate.run import Arrival, Stream
from roadstate.vehicles import load_vehicle
from run.odometer import Odometer

NAN = np.nan
CHANNELS = ("speed", "accel_x", "yaw_rate", "vertical_speed")
Event = tuple[float, dict[str, float]]


@pytest.fixture(scope="module")
def events() -> list[Event]:
    """60 samples at uneven times, some values missing."""
    random = np.random.default_rng(0)
    log = plausible_log(load_vehicle("family-car"), 60)
    time = 1.7e9 + np.cumsum(random.uniform(0.002, 0.03, 60))  # as a recorder stamps them
    gaps = random.random((60, len(CHANNELS))) < 0.3
    return [
        (float(t), {c: NAN if gaps[k, i] else float(log[c][k]) for i, c in enumerate(CHANNELS)})
        for k, t in enumerate(time)
    ]


def kmbe() -> Any:
    return build("kmbe", load_vehicle("family-car"), CHANNELS)


def fed(events: list[Event], **settings: Any) -> tuple[Stream, list[Estimate]]:
    stream = Stream(kmbe(), **settings)
    return stream, [stream.push(time, sample) for time, sample in events]


def assert_same(a: tuple[Stream, list[Estimate]], b: tuple[Stream, list[Estimate]]) -> None:
    """Bit for bit: time, state and newest estimate."""
    assert a[0].time == b[0].time
    for kind, vector in a[0].state.items():
        np.testing.assert_array_equal(vector, b[0].state[kind])
    for part in ("values", "std"):
        one, other = getattr(a[1][-1], part), getattr(b[1][-1], part)
        assert {k: float(v) for k, v in one.items()} == {k: float(v) for k, v in other.items()}


def shuffled(events: list[Event], lag: float, seed: int, parts: bool) -> list[Event]:
    """In an order of arrival that delays each event (or each of its channels) by up to ``lag``."""
    random = np.random.default_rng(seed)
    if parts:
        events = [(t, {c: v}) for t, sample in events for c, v in sample.items()]
    delays = random.uniform(0, lag, len(events))
    return [events[i] for i in np.argsort([t + d for (t, _), d in zip(events, delays, strict=True)])]


@pytest.mark.parametrize("parts", [False, True])
@settings(max_examples=12)
@given(seed=st.integers(0, 2**31), lag=st.sampled_from([0.001, 0.05, 0.3]))
def test_the_order_of_arrival_does_not_matter(
    events: list[Event], seed: int, lag: float, parts: bool
) -> None:
    arriving = shuffled(events, lag, seed, parts)
    late = fed(arriving, window=lag)
    assert_same(late, fed(events))
    stream = late[0]
    assert stream.counts.total() == len(arriving)
    assert stream.counts[Arrival.DROPPED] == stream.replaced == 0


def test_each_estimate_is_that_of_the_samples_there_so_far(events: list[Event]) -> None:
    arriving = shuffled(events[:25], 0.1, 3, parts=True)
    stream = Stream(kmbe(), window=1.0)
    for count in range(1, len(arriving) + 1):
        now = stream.push(*arriving[count - 1])
        whole: dict[float, dict[str, float]] = {}
        for time, part in arriving[:count]:
            whole.setdefault(time, {}).update(part)
        if count % 7 == 0:
            assert_same((stream, [now]), fed(sorted(whole.items(), key=lambda event: event[0])))


def test_before_the_first_sample(events: list[Event]) -> None:
    first = fed([events[1], events[2], events[0]], window=1.0)
    assert first[0].arrival == Arrival.LATE
    assert_same(first, fed(events[:3]))


def test_a_late_sample_without_any_value_is_still_a_step(events: list[Event]) -> None:
    """As it is in order: to predict in two steps is not bit for bit to predict in one."""
    middle = (0.5 * (events[0][0] + events[1][0]), {})
    late = fed([events[0], events[1], middle], window=1.0)
    assert_same(late, fed([events[0], middle, events[1]]))


def test_nothing_late_is_the_plain_stream(events: list[Event]) -> None:
    with_window, plain = fed(events, window=0.2), fed(events)
    assert_same(with_window, plain)
    assert with_window[0].counts == plain[0].counts == {Arrival.NEW: len(events)}


class TestTooLate:
    def test_it_is_dropped_and_told(self) -> None:
        stream = Stream(Odometer(), window=1.0)
        assert stream.arrival is None
        for time in (0.0, 1.0, 2.0, 3.0):
            newest = stream.push(time, {"speed": 2.0})
            assert stream.arrival == Arrival.NEW
        before = {k: np.array(v) for k, v in stream.state.items()}
        dropped = stream.push(1.999, {"speed": 100.0})
        assert stream.arrival == Arrival.DROPPED
        assert stream.counts == {Arrival.NEW: 4, Arrival.DROPPED: 1}
        assert dropped is newest
        assert stream.time == 3.0
        for kind, vector in before.items():
            np.testing.assert_array_equal(stream.state[kind], vector)

    def test_the_window_reaches_its_whole_length(self) -> None:
        """To the last instant, though the sample before it is long out of the window."""
        stream = Stream(Odometer(), window=1.0)
        for time in (0.0, 3.0):
            stream.push(time, {"speed": 2.0})
        estimate = stream.push(2.0, {"speed": 5.0})
        assert stream.arrival == Arrival.LATE
        assert float(estimate.values["altitude"]) == 2 * 5.0 + 1 * 2.0

    def test_a_window_of_nothing_joins_equal_times_only(self) -> None:
        stream = Stream(Odometer(), window=0.0)
        stream.push(0.0, {})
        stream.push(2.0, {})
        assert float(stream.push(2.0, {"speed": 3.0}).values["altitude"]) == 6.0
        assert stream.arrival == Arrival.MERGED
        stream.push(1.999, {"speed": 1.0})
        assert stream.arrival == Arrival.DROPPED

    def test_memory_is_bounded_by_the_capacity(self) -> None:
        stream = Stream(Odometer(), window=1e6, capacity=5)
        for time in range(50):
            stream.push(float(time), {"speed": 1.0})
            assert len(stream._steps) <= 5
        stream.push(44.5, {"speed": 7.0})  # just within: the state at 44 s is kept
        assert stream.arrival == Arrival.LATE
        assert len(stream._steps) == 5
        stream.push(44.25, {"speed": 7.0})
        assert stream.arrival == Arrival.DROPPED
        assert stream.counts == {Arrival.NEW: 50, Arrival.LATE: 1, Arrival.DROPPED: 1}

    def test_memory_is_bounded_by_the_window(self) -> None:
        stream = Stream(Odometer(), window=2.0)
        for k in range(400):
            stream.push(0.125 * k, {"speed": 1.0})
            assert len(stream._steps) <= 17

    def test_none_keeps_nothing(self) -> None:
        stream = Stream(Odometer())
        for time in range(5):
            stream.push(float(time), {})
            assert not stream._steps


class TestSameTime:
    def test_channels_are_joined(self) -> None:
        stream, whole = Stream(Odometer(), window=1.0), Stream(Odometer())
        for s in (stream, whole):
            s.push(0.0, {})
        stream.push(1.0, {"yaw_rate": 0.5})
        joined = stream.push(1.0, {"speed": 3.0})
        expected = whole.push(1.0, {"speed": 3.0, "yaw_rate": 0.5})
        assert float(joined.values["altitude"]) == float(expected.values["altitude"]) == 3.0
        assert float(joined.std["altitude"]) == float(expected.std["altitude"])  # steps counted: one
        assert stream.counts == {Arrival.NEW: 2, Arrival.MERGED: 1}

    @pytest.mark.parametrize("nothing", [NAN, np.inf, -np.inf])
    def test_what_is_missing_does_not_overwrite(self, nothing: float) -> None:
        stream = Stream(Odometer(), window=1.0)
        stream.push(0.0, {})
        stream.push(1.0, {"speed": 3.0})
        assert float(stream.push(1.0, {"speed": nothing}).values["altitude"]) == 3.0
        assert stream.arrival == Arrival.MERGED
        assert stream.replaced == 0

    def test_the_last_of_two_values_counts_and_is_told(self) -> None:
        stream = Stream(Odometer(), window=9.0)
        stream.push(0.0, {})
        stream.push(1.0, {"speed": 3.0})
        stream.push(2.0, {"speed": 1.0})
        assert float(stream.push(1.0, {"speed": 3.0}).values["altitude"]) == 4.0
        assert stream.replaced == 0  # the same again is no contradiction
        assert float(stream.push(1.0, {"speed": 5.0}).values["altitude"]) == 6.0
        assert stream.replaced == 1
        assert stream.counts == {Arrival.NEW: 3, Arrival.MERGED: 2}


class TestRefusals:
    @pytest.mark.parametrize("time", [NAN, np.inf, -np.inf, "now", None])
    def test_a_time_that_is_none(self, time: Any) -> None:
        stream = Stream(Odometer(), window=1.0)
        stream.push(0.0, {})
        with pytest.raises(InputError) as caught:
            stream.push(time, {"speed": 1.0})
        assert "\n" not in str(caught.value)
        assert stream.time == 0.0
        assert stream.counts == {Arrival.NEW: 1}

    @pytest.mark.parametrize("value", [None, "fast", [1.0]])
    def test_a_value_that_is_no_number_is_named(self, value: Any) -> None:
        with pytest.raises(InputError, match=r"^speed: .* is no number; leave it out$"):
            Stream(Odometer()).push(0.0, {"yaw_rate": 0.0, "speed": value})

    @pytest.mark.parametrize("sample", [None, [1.0], 3.0])
    def test_a_sample_that_is_none(self, sample: Any) -> None:
        with pytest.raises(InputError, match=r"a sample that is .*; give channels with their values"):
            Stream(Odometer()).push(0.0, sample)

    def test_the_state_of_another(self) -> None:
        stream = Stream(Odometer())
        with pytest.raises(InputError, match="the state of another estimator"):
            stream.state = {kind: np.zeros(99) for kind in stream.state}

    @pytest.mark.parametrize("window", [-1.0, NAN, np.inf, "a", [1.0]])
    def test_a_window_that_is_none(self, window: Any) -> None:
        with pytest.raises(InputError, match=r"a window of .* s; give a finite time"):
            Stream(Odometer(), window=window)

    def test_a_capacity_that_is_none(self) -> None:
        with pytest.raises(InputError, match=r"a capacity of 0 samples; give 1 or more"):
            Stream(Odometer(), window=1.0, capacity=0)


def test_setting_the_state_empties_the_window() -> None:
    stream = Stream(Odometer(), window=10.0)
    stream.push(0.0, {})
    stream.push(1.0, {"speed": 2.0})
    state = {k: np.array(v) for k, v in stream.state.items()}
    stream.state, stream.time = state, 5.0
    again = stream.push(4.0, {"speed": 2.0})
    assert stream.arrival == Arrival.DROPPED
    assert float(again.values["altitude"]) == 2.0  # what the state says, though no step was taken since
    assert float(stream.push(6.0, {"speed": 2.0}).values["altitude"]) == 4.0
