"""The HTML report: its numbers, what is in it, and what must never be."""

from __future__ import annotations

import base64
import gzip
import html
import json
import re
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from roadstate.core import Estimates, InputError, Log
from roadstate.metrics import evaluate
from roadstate.report import write_report
from roadstate.report.consistency import LAGS, nis_consistency, sensor_consistency
from roadstate.report.figures import TimeAxes
from roadstate.report.page import points_per_line
from roadstate.report.panels import band, quantity_panels, spread

GOLDEN = Path(__file__).parent / "golden" / "errors.json"
EVIL = "<script>alert(1)</script>"


class Tables(HTMLParser):
    """Cells of every table of a page, and the attributes of its scripts and links."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tables: list[list[list[str]]] = []
        self.loads: list[tuple[str, dict[str, str | None]]] = []
        self._cell: list[str] | None = None
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self._cell = []
        if tag in ("script", "link", "img", "iframe", "object", "embed", "source", "base", "form"):
            self.loads.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        if tag in ("td", "th") and self._cell is not None:
            self.tables[-1][-1].append("".join(self._cell))
            self._cell = None

    def handle_data(self, data: str) -> None:
        if self._cell is not None:
            self._cell.append(data)


def models(page: str) -> list[dict[str, Any]]:
    """Every Bokeh model of a page."""
    text = re.search(r"const docs_json = '(.*)';", page)
    assert text is not None
    document = json.loads(html.unescape(text[1].encode().decode("unicode_escape")))
    found: list[dict[str, Any]] = []

    def walk(node: Any) -> None:
        if isinstance(node, dict):
            if node.get("type") == "object" and "id" in node:
                found.append(node)
            for value in node.values():
                walk(value)
        elif isinstance(node, list):
            for value in node:
                walk(value)

    walk(document)
    return found


def columns(page: str) -> list[dict[str, np.ndarray]]:
    """The columns of every data source of a page."""
    sources = []
    for model in models(page):
        if model["name"] != "ColumnDataSource":
            continue
        entries = {}
        for key, value in model["attributes"]["data"]["entries"]:
            if isinstance(value, dict) and value["type"] == "ndarray":
                raw = base64.b64decode(value["array"]["data"])
                raw = gzip.decompress(raw) if raw[:2] == b"\x1f\x8b" else raw
                entries[key] = np.frombuffer(raw, value["dtype"])
        sources.append(entries)
    return sources


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory, log: Log, results: dict[str, Estimates]) -> str:
    path = tmp_path_factory.mktemp("report") / "report.html"
    vehicle = {"name": "compact", "mass": 1350.0, "wheel": {"radius": 0.32}}
    assert write_report(path, log, results, vehicle=vehicle, settings={"settle": 5.0}) == path
    return path.read_text("utf-8")


def test_the_table_of_errors_has_the_golden_numbers(page: str) -> None:
    assert Tables(page).tables[0] == json.loads(GOLDEN.read_text("utf-8"))


def test_the_table_shows_what_evaluate_gives(page: str, log: Log, results: dict[str, Estimates]) -> None:
    header, *rows = Tables(page).tables[0]
    shown = {(row[0].split()[0], row[1]): dict(zip(header, row, strict=True)) for row in rows}
    for name, estimates in results.items():
        for quantity, m in evaluate(estimates, log).items():
            row = shown[quantity, name]
            assert float(row["MAE"]) == pytest.approx(m.mae, rel=6e-3)
            assert float(row["max"]) == pytest.approx(m.max, rel=6e-3)
            assert int(row["samples"]) == m.n


def test_given_metrics_are_shown_instead(tmp_path: Path, log: Log, results: dict[str, Estimates]) -> None:
    later = {name: evaluate(e, log, settle=60.0) for name, e in results.items()}
    path = write_report(tmp_path / "r.html", log, results, metrics=later)
    rows = Tables(path.read_text("utf-8")).tables[0][1:]
    assert [int(r[-1]) for r in rows] == [later[r[1]][r[0].split()[0]].n for r in rows]


def test_the_sections_come_in_order(page: str) -> None:
    headings = re.findall(r"<h2>(.*?)</h2>", page)
    assert headings == [
        "Estimates",
        "Innovations",
        "Validity",
        "Inputs",
        "Track",
        "Consistency",
        "Vehicle, settings, versions",
    ]
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", page)
    assert captions[0] == "Road grade angle"
    assert captions[1].startswith("Error of grade")


def test_consistency_is_told_with_bands_and_drawn(page: str, log: Log, results: dict[str, Estimates]) -> None:
    by_first = {table[0][:2][1]: table for table in Tables(page).tables if table}
    sensors, bands = by_first["sensor"], by_first["of (expected)"]
    assert [row[:2] for row in sensors[1:]] == [[n, s] for n in results for s in ("speed", "accel_x")]
    assert {row[7] for row in sensors[1:]} <= {"yes", "no"}
    kinds = [row[1] for row in bands[1:] if row[0] == "kmbe"]
    assert kinds[0] == "NIS per sensor (1)"
    assert {"NEES of grade (1)", "coverage of grade (95.0 %)"} <= set(kinds)
    nis = nis_consistency(results["kmbe"])
    assert nis is not None
    row = bands[1]
    assert float(row[2]) == pytest.approx(float(nis.mean.value), rel=6e-3)
    low, high = map(float, row[3].split(" to "))
    assert (low, high) == pytest.approx((float(nis.mean.low), float(nis.mean.high)), rel=6e-3)
    assert row[4] == ("inside" if nis.mean.inside else "above" if nis.mean.value > high else "below")
    lines = [c["y"] for c in columns(page) if len(c.get("y", ())) == LAGS]
    expected = [s.autocorrelation for e in results.values() for s in sensor_consistency(e)]
    for w in expected:
        assert w is not None
        for values in (w.correlation[:, 0], w.bound[:, 0], -w.bound[:, 0]):
            assert any(np.allclose(line, values, atol=1e-6) for line in lines)


def test_a_quantity_with_bounds_of_its_own_is_drawn_with_them(results: dict[str, Estimates]) -> None:
    """A friction that is hardly known lies anywhere above what is used, not below zero."""
    some = next(iter(results.values()))
    peak, count = np.full(len(some.time), 0.9), len(some.time)
    told = {"friction_peak": peak, "friction_peak_lower": 0.2 * peak, "friction_peak_upper": 1.3 * peak}
    known = replace(some, values=some.values | told, std=some.std | {"friction_peak": np.full(count, 0.6)})
    lower, upper = band("friction_peak", known)
    np.testing.assert_array_equal([lower, upper], [0.2 * peak, 1.3 * peak])
    assert spread("friction_peak", known) == ", 5 to 95 %"
    bare = replace(known, values={q: v for q, v in known.values.items() if q != "friction_peak_upper"})
    lower, upper = band("friction_peak", bare)
    np.testing.assert_allclose([lower[0], upper[0]], [-0.3, 2.1])
    assert spread("friction_peak", bare) == " ± 2σ"


def test_an_error_is_in_its_band_where_the_truth_is_within_the_bounds(
    log: Log, results: dict[str, Estimates]
) -> None:
    """A likeliest friction of 0.9, known to be 0.2 to 1.1, errs by 0.65 on a road of 0.25, as it may."""
    some, count = next(iter(results.values())), len(log.time)
    told = {"friction_peak": 0.9, "friction_peak_lower": 0.2, "friction_peak_upper": 1.1}
    known = {"some": replace(some, values=some.values | {q: np.full(count, v) for q, v in told.items()})}
    true = {f"ref_friction_{w}": np.full(count, 0.25) for w in ("fl", "fr", "rl", "rr")}
    there = Log(log.time, dict(log.channels) | true, log.metadata)
    _, panel = quantity_panels(TimeAxes(log.time, 500), "friction_peak", known, there)
    shapes = [r for r in panel.figure.renderers if type(r.glyph).__name__ == "Patch"]
    heights = np.concatenate([np.asarray(r.data_source.data["y"]) for r in shapes])
    assert np.nanmin(heights) == pytest.approx(-0.2, abs=1e-3)
    assert np.nanmax(heights) == pytest.approx(0.7, abs=1e-3)


def test_bounds_are_in_view(log: Log, results: dict[str, Estimates]) -> None:
    some = next(iter(results.values()))
    peak = np.full(len(some.time), 0.9)
    told = {"friction_peak": peak, "friction_peak_lower": 0.2 * peak, "friction_peak_upper": 1.3 * peak}
    known = {"some": replace(some, values=some.values | told)}
    [panel, *_] = quantity_panels(TimeAxes(log.time, 500), "friction_peak", known, log)
    assert panel.figure.y_range.start < 0.18
    assert panel.figure.y_range.end > 1.17


def test_innovations_are_labelled_with_their_unit(
    tmp_path: Path, log: Log, results: dict[str, Estimates]
) -> None:
    one = replace(results["kmbe"], sensor_units={"speed": "m/s^2"})
    found = models(write_report(tmp_path / "r.html", log, {"kmbe": one}).read_text("utf-8"))
    labels = {str(m["attributes"].get("axis_label")) for m in found if m["name"] == "LinearAxis"}
    assert {"ν [m/s²]", "ν [SI unit]"} <= labels


def test_every_channel_is_among_the_inputs(page: str, log: Log) -> None:
    labels = {m["attributes"]["label"]["value"] for m in models(page) if m["name"] == "LegendItem"}
    assert set(log.channels) <= labels


def test_the_tables_tell_vehicle_settings_and_versions(page: str) -> None:
    cells = {tuple(row) for table in Tables(page).tables for row in table}
    assert {("mass", "1350"), ("wheel.radius", "0.32"), ("settle", "5")} <= cells
    assert {"python", "numpy", "jax", "roadstate"} <= {row[0] for row in cells}


def test_all_time_axes_are_one(page: str) -> None:
    figures = [m for m in models(page) if m["name"] == "Figure"]
    ranges = [m["attributes"]["x_range"] for m in figures]
    shared = [r for r in ranges if r.get("id") == ranges[0]["id"]]
    assert len(figures) > 10
    assert len(shared) == len(figures) - 3  # all but the map and two of lags


def test_the_map_has_equal_scales(page: str) -> None:
    equal = [m for m in models(page) if m["name"] == "Figure" and m["attributes"].get("match_aspect")]
    assert len(equal) == 1


def test_numbers_travel_in_single_precision_unless_that_shows(page: str, log: Log) -> None:
    sources = columns(page)
    doubles = [data for data in sources if any(a.dtype == np.float64 for a in data.values())]
    assert len(doubles) == 1  # latitude 48°: single precision has steps of 0.4 m, too coarse for this drive
    for name in ("latitude",):
        seen = log[name][np.isfinite(log[name])]
        assert any(np.array_equal(d["y"][np.isfinite(d["y"])], seen) for d in doubles)


def test_an_epoch_as_time_base_keeps_its_resolution(tmp_path: Path, log: Log) -> None:
    time = log.time[:200] + 1.7e9
    late = Log(time, {"speed": log["speed"][:200]})
    estimates = Estimates(time, {"speed": late["speed"]}, {}, np.zeros(200, np.int8))
    path = write_report(tmp_path / "r.html", late, {"x": estimates})
    x = next(d["x"] for d in columns(path.read_text("utf-8")) if "x" in d and len(d["x"]) == 200)
    np.testing.assert_array_equal(x, time)


def test_a_spike_in_a_long_log_is_in_the_file(tmp_path: Path) -> None:
    n = 300_000
    time = np.arange(n) * 0.01
    speed = np.sin(time)
    speed[123_456] = 77.0
    estimates = Estimates(time, {"speed": speed.copy()}, {"speed": np.ones(n)}, np.zeros(n, np.int8))
    estimates.values["speed"][222_222] = -55.0
    log = Log(time, {"speed": speed})
    path = write_report(tmp_path / "r.html", log, {"x": estimates})
    heights = np.concatenate([d["y"] for d in columns(path.read_text("utf-8")) if "y" in d])
    assert {77.0, -55.0} <= set(heights.tolist())
    assert path.stat().st_size < 5e6


def test_nothing_is_loaded_from_anywhere(page: str) -> None:
    for tag, attributes in Tables(page).loads:
        assert tag == "script", f"<{tag}> loads something"
        assert "src" not in attributes
    assert not re.search(r"<(script|link)[^>]+https?:", page)
    assert "@import" not in page
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None
    assert "default-src 'none'" in policy[1]
    assert "http" not in policy[1]


def test_what_comes_from_outside_is_escaped(tmp_path: Path, log: Log, results: dict[str, Estimates]) -> None:
    hostile = replace(log, metadata={"files": [f"{EVIL}.csv"], EVIL: EVIL, "nested": {"k": [EVIL]}})
    named = {EVIL: results["kmbe"], "'\"><img src=x onerror=alert(1)>": results["debe"]}
    vehicle, settings = {EVIL: {"deep": EVIL}}, {"note": "</style></script><svg onload=alert(1)>"}
    path = write_report(tmp_path / "r.html", hostile, named, vehicle=vehicle, settings=settings, title=EVIL)
    text = path.read_text("utf-8")
    assert "<script>alert" not in text
    assert "onerror=alert(1)>" not in text.replace("&gt;", "")
    assert "<svg onload" not in text
    assert {tag for tag, _ in Tables(text).loads} == {"script"}
    assert EVIL in {cell for table in Tables(text).tables for row in table for cell in row}


def test_names_are_never_formulas(tmp_path: Path, log: Log, results: dict[str, Estimates]) -> None:
    # Bokeh fetches MathJax from the net where a text holds TeX
    path = write_report(tmp_path / "r.html", log, {"$$x$$": results["kmbe"], r"\[y\]": results["debe"]})
    texts = json.dumps(models(path.read_text("utf-8")))
    assert "$$" not in texts
    assert r"\\[" not in texts


def test_without_a_reference_there_is_no_table_of_errors(
    tmp_path: Path, log: Log, results: dict[str, Estimates]
) -> None:
    bare = log.select([n for n in log.channels if not n.startswith("ref_")])
    text = write_report(tmp_path / "r.html", bare, results).read_text("utf-8")
    assert 'id="errors"' not in text
    assert "has no reference" in text
    assert "Error of" not in text


def test_a_log_of_one_sample_and_one_of_nothing_but_gaps(tmp_path: Path) -> None:
    one = Estimates(np.zeros(1), {"grade": np.zeros(1)}, {"grade": np.ones(1)}, np.zeros(1, np.int8))
    assert write_report(tmp_path / "a.html", Log(np.zeros(1), {"speed": np.ones(1)}), {"x": one}).is_file()
    time, gaps = np.arange(50.0), np.full(50, np.nan)
    log = Log(time, {"speed": gaps, "latitude": time, "longitude": time, "ref_grade": gaps})
    empty = Estimates(time, {"grade": gaps}, {"grade": gaps}, np.full(50, 3, np.int8))
    assert write_report(tmp_path / "b.html", log, {"x": empty}).is_file()


def test_more_lines_mean_fewer_points(log: Log, results: dict[str, Estimates]) -> None:
    many = {f"{name}{i}": e for name, e in results.items() for i in range(6)}
    assert points_per_line(log, many) < points_per_line(log, results)


def test_bokeh_missing_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, log: Log, results: Any
) -> None:
    for module in [m for m in sys.modules if m.split(".")[0] == "bokeh"]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "bokeh", None)
    with pytest.raises(InputError, match=r"bokeh is not installed.*install roadstate\[report\]"):
        write_report(tmp_path / "r.html", log, results)
    assert list(tmp_path.iterdir()) == []


def test_bad_calls_leave_no_file(tmp_path: Path, log: Log, results: dict[str, Estimates]) -> None:
    path = tmp_path / "r.html"
    with pytest.raises(InputError, match="nothing to report"):
        write_report(path, log, {})
    with pytest.raises(InputError, match="differ in time"):
        write_report(path, log.between(0.0, 10.0), results)
    with pytest.raises(InputError, match="26 estimators are too many"):
        write_report(path, log, {str(i): results["kmbe"] for i in range(26)})
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="cannot write"):
        write_report(tmp_path / "missing" / "r.html", log, results)
