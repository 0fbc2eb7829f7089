"""CSV as people write it, and every way it can be wrong."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from roadstate.core import InputError, Log, Recording
from roadstate.io import read, write

BASIC = "time [s],speed [km/h],note\n0,36,a\n0.1,,b\n0.2,NaN,c\n0.3,37.5,d\n"


@pytest.fixture
def csv(tmp_path: Path):  # type: ignore[no-untyped-def]
    """Reads a text or bytes as a CSV file."""

    def reader(content: str | bytes, name: str = "drive.csv", **options: str) -> Recording:
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return read(path, **options)  # type: ignore[arg-type]

    return reader


def values(recording: Recording, name: str) -> list[float]:
    return recording[name].values.tolist()


def test_names_units_missing_cells_and_text_columns(csv) -> None:  # type: ignore[no-untyped-def]
    recording = csv(BASIC)
    assert list(recording) == ["speed"]
    speed = recording["speed"]
    assert (speed.unit, speed.source) == ("km/h", "drive.csv:speed")
    np.testing.assert_array_equal(speed.values, [36, np.nan, np.nan, 37.5])
    np.testing.assert_array_equal(speed.time, [0, 0.1, 0.2, 0.3])
    assert recording.metadata["skipped"] == ["note"]


@pytest.mark.parametrize(
    "content",
    [
        BASIC.replace(",", ";"),
        BASIC.replace(",", ";").replace(".", ","),
        BASIC.replace(",", "\t").replace(".", ","),
        BASIC.replace(",", "\t"),
        BASIC.replace("\n", "\r\n"),
        BASIC.replace("\n", "\r"),
        "\ufeff" + BASIC,
        "# made by a logger\n#,;\n\n" + BASIC,
        BASIC.replace("time [s],speed [km/h],note", '"time [s]","speed [km/h]","note"'),
        BASIC.replace("\n0.2", "\n\n\n0.2"),
        BASIC.replace("NaN", " NA "),
        BASIC.replace("NaN", "-"),
        BASIC.replace(",36", ", 36 ").replace("37.5", "+3.75e1"),
        "time [s],speed,note\ns,km/h,\n" + BASIC.split("\n", 1)[1],
        "time,speed,note\n[s],(km/h),text\n" + BASIC.split("\n", 1)[1],
        "time [ms],speed [km/h],note\n0,36,a\n100,,b\n200,NaN,c\n300,37.5,d\n",
        "t_ms,speed [km/h],note\n0,36,a\n100,,b\n200,NaN,c\n300,37.5,d\n",
    ],
)
def test_the_same_table_in_another_dress(csv, content: str) -> None:  # type: ignore[no-untyped-def]
    recording = csv(content)
    assert list(recording) == ["speed"]
    assert recording["speed"].unit == "km/h"
    np.testing.assert_array_equal(recording["speed"].values, [36, np.nan, np.nan, 37.5])
    np.testing.assert_allclose(recording["speed"].time, [0, 0.1, 0.2, 0.3], rtol=1e-15)


def test_gzip_is_read_whatever_the_name(csv) -> None:  # type: ignore[no-untyped-def]
    assert len(csv(gzip.compress(BASIC.encode()), "drive.csv")["speed"]) == 4
    assert len(csv(gzip.compress(BASIC.encode()), "drive.csv.gz")["speed"]) == 4


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
def test_units_beyond_ascii_in_either_encoding(csv, encoding: str) -> None:  # type: ignore[no-untyped-def]
    text = "time;Gierrate [°/s];a [m/s²];Straße\n0;1;2;grün\n1;2;3;blau\n"
    recording = csv(text.encode(encoding))
    assert {n: s.unit for n, s in recording.signals.items()} == {"Gierrate": "°/s", "a": "m/s²"}
    assert recording.metadata["skipped"] == ["Straße"]


@pytest.mark.parametrize("header", ["t", "T [s]", "time", "Time [s]", "TIME", "timestamp", "t_s", "Zeit [s]"])
def test_the_usual_names_of_the_time_column(csv, header: str) -> None:  # type: ignore[no-untyped-def]
    recording = csv(f"speed,{header}\n1,0.5\n2,1.5\n")
    np.testing.assert_array_equal(recording["speed"].time, [0.5, 1.5])
    assert "start_time" not in recording.metadata


@pytest.mark.parametrize(
    ("header", "cells", "start"),
    [
        ("t_unix_s", ["1627274454.5", "1627274455.0"], "2021-07-26T04:40:54.500000"),
        ("timestamp [ms]", ["1627274454500", "1627274455000"], "2021-07-26T04:40:54.500000000"),
        ("timestamp_ns", ["1627274454500000001", "1627274455000000001"], "2021-07-26T04:40:54.500000001"),
        ("timestamp", ["2021-07-26T04:40:54.5Z", "2021-07-26T04:40:55.0Z"], "2021-07-26T04:40:54.500000000"),
        (
            "time",
            ["2021-07-26 06:40:54.5+02:00", "2021-07-26 06:40:55.0+02:00"],
            "2021-07-26T04:40:54.500000000",
        ),
        ("time", ["2021-07-26 04:40:54.5", "2021-07-26 04:40:55"], "2021-07-26T04:40:54.500000000"),
    ],
)
def test_absolute_time_becomes_a_start_and_seconds(
    csv,  # type: ignore[no-untyped-def]
    header: str,
    cells: list[str],
    start: str,
) -> None:
    recording = csv(f"{header},speed\n{cells[0]},1\n{cells[1]},2\n")
    assert recording.metadata["start_time"] == start
    np.testing.assert_array_equal(recording["speed"].time, [0, 0.5])


def test_rows_keep_their_order_and_missing_times_stay(csv) -> None:  # type: ignore[no-untyped-def]
    recording = csv("time,speed\n2,1\n,2\n1,3\n")
    np.testing.assert_array_equal(recording["speed"].time, [2, np.nan, 1])
    assert values(recording, "speed") == [1, 2, 3]
    dated = csv("time,speed\n2021-07-26T00:00:02,1\n,2\n2021-07-26T00:00:01,3\n")
    np.testing.assert_array_equal(dated["speed"].time, [0, np.nan, -1])


def test_the_time_column_can_be_named(csv) -> None:  # type: ignore[no-untyped-def]
    text = "clock [ms],time,speed\n0,7,1\n500,8,2\n"
    assert csv(text, time_column="clock")["speed"].time.tolist() == [0, 0.5]
    assert csv(text, time_column="clock [ms]")["time"].values.tolist() == [7, 8]
    unitless = "clock,speed\n0,1\n500,2\n"
    assert csv(unitless, time_column="clock", time_unit="ms")["speed"].time.tolist() == [0, 0.5]
    assert csv(text, time_column="clock", time_unit="h")["speed"].time.tolist() == [0, 0.5], (
        "the file says ms"
    )
    with pytest.raises(InputError, match=r"no column 'watch'; there are 'clock \[ms\]', 'time', 'speed'"):
        csv(text, time_column="watch")


def test_steps_of_no_drive_are_asked_about(csv) -> None:  # type: ignore[no-untyped-def]
    """Milliseconds in a column that is called time made five hours of twenty seconds."""
    rows = "".join(f"{10 * k},{k}\n" for k in range(50))
    with pytest.raises(
        InputError, match=r"steps of 10 s, if its numbers are seconds; is the unit ms\? Give it"
    ):
        csv(f"time,speed\n{rows}")
    assert csv(f"time [s],speed\n{rows}")["speed"].time[1] == 10
    assert csv(f"time,speed\n{rows}", time_unit="ms")["speed"].time[1] == 0.01
    assert csv(f"time,speed\n{rows}", time_unit="s")["speed"].time[1] == 10
    assert csv(f"time,speed\n{rows[:12]}")["speed"].time[1] == 10  # too few to say


def test_whole_numbers_are_asked_about_where_there_are_many(csv) -> None:  # type: ignore[no-untyped-def]
    """Milliseconds at 250 to 1000 Hz in a column that is called time passed for a slow log in seconds."""

    def rows(count: int, step: float, start: float = 0) -> str:
        return "".join(f"{start + step * k:.10g},{k}\n" for k in range(count))

    for step in (1, 2, 4):
        with pytest.raises(InputError, match=rf"steps of {step} s, .* unit ms\?.*, also if it is s"):
            csv(f"time,speed\n{rows(200, step)}")
    assert csv(f"time [s],speed\n{rows(200, 1)}")["speed"].rate == 1
    assert csv(f"time_s,speed\n{rows(200, 1)}")["speed"].rate == 1
    assert csv(f"time,speed\n{rows(200, 1)}", time_unit="ms")["speed"].rate == pytest.approx(1000)
    assert csv(f"time,speed\n{rows(200, 1.01)}")["speed"].rate == pytest.approx(1 / 1.01)
    assert csv(f"time,speed\n{rows(60, 1)}")["speed"].rate == 1
    unix = csv(f"time,speed\n{rows(200, 1, 1627274454)}")  # no clock of ms has run so long
    assert unix["speed"].rate == 1
    assert unix.metadata["start_time"].startswith("2021-07-26T04:40:54")
    with pytest.raises(InputError, match="steps of 4 s"):
        csv(f"time,speed\n{rows(200, 4, 200_000_000)}")  # ms of two days


def test_booleans_count_and_unnamed_columns_are_left_out(csv) -> None:  # type: ignore[no-untyped-def]
    recording = csv(",time,brake\n0,0,true\n1,1,false\n")
    assert values(recording, "brake") == [1, 0]
    assert recording.metadata["skipped"] == ["column 1: no name"]
    trailing = csv("time;speed;\n0;1;\n1;2;\n")
    assert list(trailing) == ["speed"]


def test_a_column_of_words_with_a_few_digits_is_text(csv) -> None:  # type: ignore[no-untyped-def]
    recording = csv("time,speed,gear\n0,1,P\n1,2,R\n2,3,1\n")
    assert recording.metadata["skipped"] == ["gear"]


def test_columns_of_empty_cells_are_missing_values(csv) -> None:  # type: ignore[no-untyped-def]
    recording = csv("time,speed,torque\n0,1,\n1,2,\n")
    assert np.isnan(recording["torque"].values).all()


def test_a_line_of_data_is_not_taken_for_units(csv) -> None:  # type: ignore[no-untyped-def]
    assert len(csv("time,a,b\n,NaN,\n1,2,3\n")["a"]) == 2
    assert len(csv("time,a,b\n2021-07-26T00:00:01,x,1\n2021-07-26T00:00:02,y,3\n")["b"]) == 2


GARBAGE = np.random.default_rng(2).bytes(500)
REFUSED = {
    "empty header": ("\n\n# only comments\n", "there is no header line; name the columns in the first line"),
    "header only": ("time,speed\n", "there are no data below the header; is the file complete?"),
    "header and units only": ("time,speed\ns,m/s\n", "there are no data below the header"),
    "no header": ("0,1\n1,2\n", "line 1 holds numbers where the header should be; name the columns"),
    "no time": (
        "speed [km/h],yaw\n1,2\n",
        "no time column; there are 'speed [km/h]', 'yaw'; call it 'time [s]', "
        "or name it in the mapping ('time: {column: NAME}')",
    ),
    "two times": (
        "time [s],timestamp,a\n0,0,1\n",
        "more than one time column: 'time [s]' and 'timestamp'; name it in the mapping",
    ),
    "doubled": (
        "time,speed [m/s],speed [km/h]\n0,1,2\n",
        "two columns are named 'speed'; rename one of them",
    ),
    "long row": ("time,speed\n0,1\n\n1,2,3\n", "line 4 has 3 cells, the header has 2; repair the line"),
    "short row": ("# x\ntime,speed\ns,m/s\n0,1\n1\n", "line 5 has 1 cells, the header has 2"),
    "text": ("time,speed\n0,1\n\n1,2\n2,fast\n", "speed: 'fast' is no number (line 5); leave the cell empty"),
    "mixed decimals": ("time;speed\n0;1,5\n1;2,5\n2;1.234\n", "speed: '1.234' is no number (line 4)"),
    "text as time": (
        "time,speed\n12:00:01.5,1\n",
        "time: the time column holds text ('12:00:01.5'); write seconds",
    ),
    "text in time": ("time,speed\n0,1\n1,2\nlater,3\n", "time: 'later' is no number (line 4)"),
    "time unit": (
        "time [km],speed\n0,1\n",
        "time [km]: unit 'km' cannot be converted to 's'; give the time's unit",
    ),
    "unknown unit": ("time [foo],speed\n0,1\n", "time [foo]: unknown unit 'foo'; give the time's unit"),
    "ms as s": (
        "timestamp,speed\n1627274454500,1\n",
        "timestamp: the time starts at 1.62727e+12 s; give the time's unit in the header ('time [ms]') "
        "or the mapping ('time: {unit: ms}')",
    ),
    "seconds of another era": (
        "time [s],speed\n63800000000,1\n63800000001,2\n",
        "time [s]: the time starts at 6.38e+10 s; give the time's unit in the header ('time [ms]') or the "
        "mapping ('time: {unit: ms}'), or count from 1970 or the start",
    ),
    "seconds before dates in ns": (
        "time [s],speed\n-9300000000,1\n-9299999999,2\n",
        "time [s]: the time starts at -9.3e+09 s; give",
    ),
    "a clock that was not set": (
        "time,speed\n2021-07-26T00:00:01,1\n0001-01-01T00:00:02,2\n",
        "time: the date 0001-01-01T00:00:02 lies outside 1678 to 2261 (row 1); leave it empty where",
    ),
    "ms in time": (
        "time,speed\n0,1\n10,2\n20,2\n30,2\n40,3\n",
        "time: steps of 10 s, if its numbers are seconds; is the unit ms? Give it in the header",
    ),
    "no time values": (
        "time,speed\n,1\n,2\n",
        "time: the time column is empty; fill it, or name another one",
    ),
    "only text": ("time,name\n0,a\n1,b\n", "no column of numbers beside 'time'; is the separator right?"),
    "wrong separator": ("time|speed\n0|1\n", "no time column; there are 'time|speed'"),
    "zero bytes": (b"time,speed\n0,1\n\0\0\0\0", "holds zero bytes (line 3); save it as UTF-8 text"),
    "UTF-16": ("time,speed\n0,1\n".encode("utf-16"), "holds zero bytes (line 1); save it as UTF-8 text"),
    "binary": (b"\0" + GARBAGE, "holds zero bytes (line 1)"),
    "cut gzip": (
        gzip.compress(BASIC.encode() * 50)[:-30],
        "the gzip file is cut short or damaged; copy it again",
    ),
    "bad gzip": (gzip.compress(BASIC.encode())[:12] + GARBAGE, "the gzip file is cut short or damaged"),
    "gzip of nothing": (gzip.compress(b""), "there is no header line"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_what_cannot_be_read_is_named_with_its_place(csv, tmp_path: Path, kind: str) -> None:  # type: ignore[no-untyped-def]
    content, message = REFUSED[kind]
    with pytest.raises(InputError) as refusal:
        csv(content)
    text = str(refusal.value)
    assert text.startswith(str(tmp_path / "drive.csv"))
    assert message in text
    assert "\n" not in text


@pytest.mark.parametrize("length", range(1, 91, 6))
def test_a_gzip_cut_anywhere_is_refused(csv, length: int) -> None:  # type: ignore[no-untyped-def]
    whole = gzip.compress(BASIC.encode() * 20)
    assert len(whole) > 90
    with pytest.raises(InputError):
        csv(whole[:length], "drive.csv.gz")


def test_text_that_expands_without_end_is_refused(csv, monkeypatch: pytest.MonkeyPatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setattr("roadstate.io.formats.csv._MAX_TEXT", 1000)
    with pytest.raises(InputError, match="of text; split it, or use Parquet or MF4"):
        csv(gzip.compress(b"time,speed\n" + b"0,1\n" * 1000))
    with pytest.raises(InputError, match="of text; split it"):
        csv(b"time,speed\n" + b"0,1\n" * 1000)


names = st.text(
    st.characters(categories=["L", "N"], include_characters="_.-/ ()"), min_size=1, max_size=12
).map(str.strip)
numbers = st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.integers(-(10**6), 10**6).map(float))


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    data=st.data(),
    delimiter=st.sampled_from([",", ";", "\t"]),
    unit=st.sampled_from(["", " [km/h]", " [°/s]"]),
)
def test_any_table_of_numbers_reads_back(csv, data: st.DataObject, delimiter: str, unit: str) -> None:  # type: ignore[no-untyped-def]
    columns = data.draw(
        st.lists(names.filter(lambda n: n and not n[0].isdigit()), min_size=1, max_size=4, unique=True)
    )
    columns = [f"x {c}" for c in columns]
    rows = data.draw(
        st.lists(st.lists(numbers, min_size=len(columns), max_size=len(columns)), min_size=1, max_size=8)
    )
    comma = delimiter != "," and data.draw(st.booleans())
    lines = [delimiter.join(["time [s]", *(c + unit for c in columns)])]
    lines += [delimiter.join([repr(float(i)), *map(repr, row)]) for i, row in enumerate(rows)]
    text = lines[0] + "\n" + "\n".join(line.replace(".", ",") if comma else line for line in lines[1:]) + "\n"
    recording = csv(text)
    assert list(recording) == columns
    for name, column in zip(columns, zip(*rows, strict=True), strict=True):
        np.testing.assert_array_equal(recording[name].values, column)
        assert recording[name].unit == (unit.strip(" []") or None)


ODD_CELLS = (
    'time|time [s]|t|1|2.5|1,5|NaN||-|x|"|"a|s|[s]|1.6e9|#|true|2021-07-26T10:00:00|2021-07-26 10:00:00.5'
    "|inf|+3| |a [km/h]|1e400|9999999999999999999999999|°"
)
cells = st.one_of(
    st.sampled_from(ODD_CELLS.split("|")),
    st.text(max_size=4),
    st.floats().map(repr),
)
tables = st.builds(
    lambda delimiter, rows, end, start, encoding: (
        start + end.join(map(delimiter.join, rows)).encode(encoding, "replace")
    ),
    st.sampled_from([",", ";", "\t"]),
    st.lists(st.lists(cells, min_size=1, max_size=4), max_size=8),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.sampled_from([b"", b"\xef\xbb\xbf", b"time,a,b\n", b"time;a;b;c\n0;1,5;2;x\n"]),
    st.sampled_from(["utf-8", "latin-1"]),
)


@settings(max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.one_of(tables, tables.map(gzip.compress), st.binary(max_size=200), st.text(max_size=100)))
def test_anything_reads_or_is_refused(csv, content: str | bytes) -> None:  # type: ignore[no-untyped-def]
    if isinstance(content, str):
        content = content.encode("utf-8", "surrogatepass")
    try:
        recording = csv(content)
    except InputError:
        return
    assert len(recording)
    for signal in recording.signals.values():
        assert signal.values.dtype == signal.time.dtype == np.float64


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    values=st.lists(st.floats(allow_nan=False), min_size=1, max_size=20),
    step=st.floats(1e-6, 1e3),
    suffix=st.sampled_from([".csv", ".csv.gz"]),
)
def test_every_float_survives_writing(tmp_path: Path, values: list[float], step: float, suffix: str) -> None:
    time = np.arange(len(values)) * step
    log = Log(time, {"speed": np.array(values)})
    signal = read(write(log, tmp_path / f"drive{suffix}"))["speed"]
    np.testing.assert_array_equal(signal.values, log["speed"])
    np.testing.assert_array_equal(signal.time, time)


def test_real_logs_read(shared_data: Path) -> None:
    drive = read(shared_data / "comma2k19" / "segment40_decoded_50Hz.csv.gz")
    assert drive["engine_rpm"].values[0] == 2216.143
    assert drive["engine_rpm"].rate == pytest.approx(50, rel=1e-3)
    track = read(shared_data / "revs_250lm" / "run_20140222_01_01_03.csv.gz")
    assert track["vx"].time[0] == 149.99
    merged = read(shared_data / "css_mf4" / "drive_00000164_10Hz.csv.gz")
    assert merged.metadata["start_time"].startswith("2021-07-26T")
