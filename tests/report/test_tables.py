"""Texts of the tables and of the opening paragraph."""

from __future__ import annotations

import numpy as np
import pytest

from roadstate.core import CHANNELS, Estimates, Log, Validity
from roadstate.report import style
from roadstate.report.inputs import grouped
from roadstate.report.summary import duration_text, source_of
from roadstate.report.tables import number, settings_table, share, validity_table, versions
from roadstate.report.view import out_of_view, unit_label, view_limits


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.71234, "0.712"),
        (13.957, "14.0"),
        (1234.6, "1235"),
        (0.0, "0"),
        (-0.00012345, "-0.000123"),
        (1.2e-7, "1.2e-07"),
        (3.4e9, "3.4e+09"),
        (None, "–"),
        (float("nan"), "–"),
    ],
)
def test_numbers(value: float | None, text: str) -> None:
    assert number(value) == text


def test_shares() -> None:
    assert share(0.9499) == "95.0 %"
    assert share(None) == "–"


def test_nested_settings_become_paths() -> None:
    table = settings_table("Vehicle", {"mass": 1350.0, "tire": {"mu": 0.9, "gaps": [1.5, 2.0]}, "note": None})
    assert table.rows == [("mass", "1350"), ("tire.mu", "0.9"), ("tire.gaps", "1.5, 2"), ("note", "–")]


def test_long_settings_are_cut_short() -> None:
    table = settings_table("Log", {"text": "x" * 5000, **{str(i): i for i in range(500)}})
    assert len(table.rows) == 200
    assert table.note == "301 further entries are left out."
    assert len(table.rows[0][1]) == 240


def test_validity_shares() -> None:
    codes = np.array([Validity.EXCITED] * 3 + [Validity.GEAR_SHIFT], np.int8)
    table = validity_table({"debe": Estimates(np.arange(4.0), {}, {}, codes)})
    assert table.header == ("estimator", "excited", "gear shift")
    assert table.rows == [("debe", "75.0 %", "25.0 %")]


def test_versions_name_what_computed() -> None:
    assert set(versions()) >= {"python", "roadstate", "jax", "numpy"}


def test_sources_are_file_names() -> None:
    log = Log(np.arange(2.0), {}, {"files": ["/data/a/drive.csv", "C:\\logs\\b.mf4"]})
    assert source_of(log) == ["drive.csv", "b.mf4"]
    assert source_of(Log(np.arange(2.0), {})) == []


@pytest.mark.parametrize(("seconds", "text"), [(59.93, "59.9 s"), (2400.0, "40 min"), (9000.0, "2 h 30 min")])
def test_durations(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text


def test_channels_are_grouped_by_kind_and_unit() -> None:
    groups = grouped(CHANNELS)
    assert [n for names in groups.values() for n in names] != []
    assert sorted(n for names in groups.values() for n in names) == sorted(CHANNELS)
    for (_, unit), names in groups.items():
        assert {CHANNELS[n].unit for n in names} == {unit}
        assert len(names) <= 8
    assert groups["rotation rates", "rad/s"] == ["roll_rate", "pitch_rate", "yaw_rate"]
    assert len(groups["wheel speed", "rad/s"]) == 4


def test_every_validity_has_a_colour() -> None:
    assert set(style.VALIDITY) == set(Validity)
    assert len(set(style.VALIDITY.values())) == len(Validity)


def test_units_as_people_write_them() -> None:
    assert [unit_label(u) for u in ("m/s^2", "N*m", "%")] == ["m/s²", "N·m", "%"]


def test_one_wild_sample_does_not_set_the_view() -> None:
    lines = np.append(np.linspace(-5.0, 5.0, 1001), 900.0)
    low, high = view_limits(lines, np.array([-6.0, 6.0]))
    assert -8.0 < low <= -6.0
    assert 6.0 <= high < 20.0
    assert "900" in out_of_view(lines, low, high)


def test_ordinary_lines_are_all_in_view() -> None:
    lines = np.linspace(-5.0, 5.0, 1001)
    low, high = view_limits(lines, np.zeros(0))
    assert low < -5.0
    assert high > 5.0
    assert out_of_view(lines, low, high) == ""


def test_a_flat_line_has_a_view() -> None:
    low, high = view_limits(np.full(10, 3.0), np.zeros(0))
    assert low < 3.0 < high


def test_bounds_that_say_as_much_as_lines_are_in_view() -> None:
    lines, bounds = np.full(100, 0.8), np.concatenate([np.full(100, 0.1), np.full(100, 1.1)])
    low, high = view_limits(lines, bounds)
    assert low > 0.5
    low, high = view_limits(lines, bounds, with_bands=True)
    assert low < 0.1
    assert high > 1.1
