"""Files of one drive as one recording."""

from __future__ import annotations

import numpy as np
import pytest

from roadstate.core import InputError, Recording, Signal, join


def part(start: float, names: str = "v", file: str = "a", n: int = 5, **metadata: object) -> Recording:
    time = start + np.arange(n) * 0.1
    signals = {name: Signal(time, time + k, "m/s", f"{file}:{name}") for k, name in enumerate(names)}
    return Recording(signals, {"files": [file], **metadata})


def test_one_file_stays_as_it_is() -> None:
    recording = part(0)
    assert join([recording]) is recording


def test_files_that_follow_are_put_end_to_end_in_time_order() -> None:
    joined = join([part(20, "vw", "c"), part(0, "vw", "a"), part(10, "vw", "b")])
    np.testing.assert_allclose(
        joined["v"].time, np.concatenate([s + np.arange(5) * 0.1 for s in (0, 10, 20)])
    )
    np.testing.assert_array_equal(joined["w"].values, joined["w"].time + 1)
    assert joined["v"].time is joined["w"].time  # the columns of a table stay columns of one table
    assert joined.is_common_base
    assert joined.metadata["files"] == ["a", "b", "c"]


def test_files_that_run_together_lie_side_by_side() -> None:
    joined = join([part(0, "v", "can"), part(0.05, "w", "gnss")])
    assert set(joined) == {"v", "w"}
    assert joined["w"].time[0] == 0.05


def test_signals_that_do_not_overlap_join_whichever_file_starts_first() -> None:
    def of(file: str, **spans: tuple[float, float]) -> Recording:
        times = {name: np.arange(a, b, 0.1) for name, (a, b) in spans.items()}
        return Recording({n: Signal(t, t, "m", f"{file}:{n}") for n, t in times.items()}, {"files": [file]})

    joined = join([of("a", altitude=(0.0, 3.0), v=(2.0, 3.0)), of("b", v=(0.5, 1.0))])
    np.testing.assert_allclose(joined["v"].time, np.r_[np.arange(0.5, 1.0, 0.1), np.arange(2.0, 3.0, 0.1)])
    assert joined.metadata["files"] == ["a", "b"]
    with pytest.raises(InputError, match=r"^b:v: v begins at 2.5 s, before a:v ends"):
        join([of("a", altitude=(0.0, 3.0), v=(2.0, 3.0)), of("b", v=(2.5, 4.0))])


def test_a_stamp_that_is_no_number_does_not_decide_the_order() -> None:
    late, early = part(10, file="late"), part(0, file="early")
    late["v"].time[0] = np.nan
    np.testing.assert_allclose(join([late, early])["v"].time[[0, 6]], [0.0, 10.1])


def test_what_any_of_the_files_left_out_is_told() -> None:
    first = part(0, skipped=["note"], undecoded=["0x001"])
    joined = join([first, part(10, file="b"), part(20, file="c", skipped=["w", "note"], undecoded=["0x002"])])
    assert joined.metadata["skipped"] == ["note", "w"]
    assert joined.metadata["undecoded"] == ["0x001", "0x002"]
    assert "skipped" not in join([part(0), part(10, file="b")]).metadata


def test_a_signal_that_one_file_lacks_has_a_gap() -> None:
    joined = join([part(0, "vw", "a"), part(10, "v", "b"), part(20, "vw", "c")])
    assert len(joined["v"]) == 15
    assert len(joined["w"]) == 10


def test_absolute_clocks_put_files_on_the_earliest_ones() -> None:
    late = part(0, "v", "late", start_time="2021-07-26T10:00:30.5")
    early = part(1, "v", "early", start_time="2021-07-26T10:00:00")
    joined = join([late, early])
    np.testing.assert_allclose(joined["v"].time[[0, 5]], [1.0, 30.5])
    assert joined["v"].values[5] == 0.0  # values are not shifted with their clock
    assert joined.metadata["start_time"] == "2021-07-26T10:00:00"


@pytest.mark.parametrize(
    ("text", "offset"),
    [
        ("2021-07-26T10:00:10Z", 10),
        ("2021-07-26T10:00:10.250000000", 10.25),
        ("2021-07-26T12:00:10+02:00", 10),
        ("2021-07-26T08:30:10-0130", 10),
        ("2021-07-26 10:00:10", 10),
        ("2021-07-27", 14 * 3600),
    ],
)
def test_start_times_may_name_a_zone(text: str, offset: float) -> None:
    joined = join([part(0, start_time="2021-07-26T10:00:00"), part(0, file="b", start_time=text)])
    assert joined["v"].time[5] == pytest.approx(offset, abs=1e-9)


def test_without_all_clocks_the_times_are_taken_as_they_are() -> None:
    joined = join([part(0, start_time="2021-07-26T10:00:00"), part(10, file="b")])
    assert joined["v"].time[5] == 10


@pytest.mark.parametrize("text", ["yesterday", "", "12:00", "2021-13-01", "0001-01-01T00:00+23:59"])
def test_a_start_time_that_is_no_date_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=rf"^b: start time '{text[:4]}.*is no date; write it in ISO 8601"):
        join([part(0, start_time="2021-07-26T10:00:00"), part(0, file="b", start_time=text)])


def test_the_same_signal_twice_at_a_time_is_refused() -> None:
    message = r"^b:v: v begins at 0.2 s, before a:v ends \(0.4 s\); give files of one drive"
    with pytest.raises(InputError, match=message):
        join([part(0), part(0.2, file="b")])
    with pytest.raises(InputError, match=r"begins at 0.4 s"):  # the same instant twice
        join([part(0), part(0.4, file="b")])


def test_another_unit_is_refused() -> None:
    other = Recording({"v": Signal(np.array([9.0]), np.array([1.0]), "km/h", "b:v")})
    with pytest.raises(InputError, match=r"^b:v: v is in 'km/h' here and in 'm/s' in a:v; convert one"):
        join([part(0), other])


def test_empty_signals_do_not_count() -> None:
    empty = Recording({"v": Signal(np.zeros(0), np.zeros(0))}, {"files": ["e"]})
    assert len(join([empty, part(0)])["v"]) == 5
    assert len(join([empty, empty])) == 0


def test_nothing_is_refused() -> None:
    with pytest.raises(InputError, match="no recording to join"):
        join([])
