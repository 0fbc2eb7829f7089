"""The page of a simulated drive: what is drawn is the truth of the drive, and nothing in it acts."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_page import Tables, columns, models
from tests.sim.simple_car import SimpleCar

from roadstate.report.drive_page import write_drive_page
from roadstate.sim.facts import drive_facts, off_path
from roadstate.sim.manoeuvres import manoeuvre
from roadstate.sim.roads import split
from roadstate.sim.run import Drive, drive
from roadstate.vehicles import load_vehicle

pytest.importorskip("bokeh")

CAR = load_vehicle("family-car")
EVIL = "<script>alert(1)</script>"


def with_forces(driven: Drive) -> Drive:
    """The drive with forces, loads and slips that the simple car has none of."""
    t = driven.time[:, None] + np.arange(4)
    load = 3500.0 + 900.0 * np.sin(t)
    parts = {
        "load": load,
        "force_x": 0.4 * load * np.sin(0.7 * t),
        "force_y": 0.5 * load * np.cos(1.3 * t),
        "slip": 0.05 * np.sin(0.7 * t),
        "slip_angle": 0.08 * np.cos(1.3 * t),
    }
    return replace(driven, truth=driven.truth._replace(**parts))


@pytest.fixture(scope="module")
def driven() -> Drive:
    kind = manoeuvre("double-lane-change")
    return with_forces(
        drive(SimpleCar.of(CAR), kind.prepare(CAR).with_friction(split(0.3, 0.9, at=1.0)), CAR)
    )


@pytest.fixture(scope="module")
def page(driven: Drive, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("drive") / "drive.html"
    assert write_drive_page(path, driven, settings={"plant": "simple", "seed": 3}) == path
    return path.read_text("utf-8")


def headings(page: str) -> list[str]:
    return re.findall(r"<h2>(.*?)</h2>", page)


def is_drawn(page: str, y: np.ndarray) -> bool:
    """Whether some line has these heights: a drive of fewer samples than a line has points is not thinned."""
    return any(
        len(c.get("y", ())) == len(y) and np.allclose(c["y"], y, rtol=1e-5, atol=1e-5) for c in columns(page)
    )


def cells(page: str) -> list[dict[str, np.ndarray]]:
    return [c for c in columns(page) if set(c) == {"x", "y", "t"} and c["t"].min() > 0]


def test_lines_are_the_truth_in_the_units_told(page: str, driven: Drive) -> None:
    truth = driven.truth
    for k in range(4):
        for values, scale in (
            (truth.force_x, 1e-3),
            (truth.force_y, 1e-3),
            (truth.load, 1e-3),
            (truth.slip, 100.0),
            (truth.slip_angle, 180 / np.pi),
        ):
            assert is_drawn(page, scale * values[:, k])
        assert is_drawn(page, np.hypot(truth.force_x, truth.force_y)[:, k] / truth.load[:, k])
        assert is_drawn(page, truth.friction[:, k])
    assert is_drawn(page, 3.6 * truth.planar_velocity[:, 0])
    assert is_drawn(page, np.degrees(driven.controls.steering_wheel))
    assert is_drawn(page, 100 * driven.controls.throttle)
    assert is_drawn(page, truth.specific_force[:, 1])


def test_path_and_what_is_off_it(page: str, driven: Drive) -> None:
    path, s = driven.manoeuvre.path, driven.truth.road[:, 0]
    wanted = np.asarray(path.at(s).d)
    assert is_drawn(page, wanted)
    assert is_drawn(page, np.round(driven.truth.road[:, 1] - wanted, 5))
    # on this straight road along the x axis the path lies as it is
    assert any(
        len(c.get("x", ())) == len(s)
        and np.allclose(c["x"], s, atol=1e-3)
        and np.allclose(c["y"], wanted, atol=1e-3)
        for c in columns(page)
    )
    header, row = Tables(page).tables[0]
    told = dict(zip(header, row, strict=True))
    assert told["off path by"] == f"{np.abs(off_path(driven)).max():.2f} m"
    assert told["friction there"] == "0.30 to 0.90"
    assert told["distance"] == f"{drive_facts(driven)['distance']:.0f} m"


def test_friction_circles_hold_every_sample(page: str, driven: Drive) -> None:
    truth, found = driven.truth, cells(page)
    assert len(found) == 4
    for k, cell in enumerate(found):
        assert cell["t"].sum() == pytest.approx(0.01 * len(driven.time), rel=1e-5)
        x, y = truth.force_y[:, k] / truth.load[:, k], truth.force_x[:, k] / truth.load[:, k]
        for i in range(0, len(x), 97):
            assert np.min(np.maximum(abs(cell["x"] - x[i]), abs(cell["y"] - y[i]))) < 0.0101
    radii = {
        round(float(np.hypot(c["x"], c["y"]).mean()), 2) for c in columns(page) if len(c.get("x", ())) == 181
    }
    assert radii == {0.3, 0.9}
    labels = [m["attributes"]["label"]["value"] for m in models(page) if m["name"] == "LegendItem"]
    assert {"μ = 0.30", "μ = 0.90"} <= set(labels)


def test_friction_circles_have_left_on_the_left_and_are_round(page: str) -> None:
    squares = [
        m["attributes"] for m in models(page) if m["name"] == "Figure" and "frame_width" in m["attributes"]
    ]
    assert len(squares) == 4
    for square in squares:
        assert square["frame_width"] == square["frame_height"]
        across, along = (square[n]["attributes"] for n in ("x_range", "y_range"))
        assert across["start"] == -across["end"] == along["end"] == -along["start"] > 0


def test_ground_is_shaded_where_its_friction_changes(page: str, driven: Drive, tmp_path: Path) -> None:
    assert "Shaded: the friction of the road." in page
    plain = replace(driven, manoeuvre=manoeuvre("double-lane-change").prepare(CAR))
    assert "Shaded" not in write_drive_page(tmp_path / "a.html", plain).read_text("utf-8")


def test_slopes_are_shown_where_there_are_any(page: str, tmp_path: Path) -> None:
    assert "Road" not in headings(page)
    hill = with_forces(drive(SimpleCar.of(CAR), manoeuvre("hill-start").prepare(CAR), CAR))
    there = write_drive_page(tmp_path / "a.html", hill).read_text("utf-8")
    assert "Road" in headings(there)
    assert is_drawn(there, 100 * np.tan(hill.truth.grade))


def test_without_a_driver_at_the_wheel_there_is_no_path(tmp_path: Path) -> None:
    driven = with_forces(drive(SimpleCar.of(CAR), manoeuvre("step-steer").prepare(CAR), CAR))
    assert not np.isfinite(off_path(driven)).all()
    open_loop = replace(driven, manoeuvre=driven.manoeuvre.replayed(driven.controls, 0.01))
    text = write_drive_page(tmp_path / "a.html", open_loop).read_text("utf-8")
    assert "path to follow" not in text
    assert "off path by" not in Tables(text).tables[0][0]
    assert "off_path_most" not in drive_facts(open_loop)


def test_a_minute_of_restless_driving_stays_small(driven: Drive, tmp_path: Path) -> None:
    rows = 12_000  # at 200 Hz
    rng = np.random.default_rng(1)

    def longer(values: np.ndarray) -> np.ndarray:
        found = values[np.arange(rows) % len(values)]
        return found + 0.02 * (1e-3 + np.abs(found).max()) * rng.standard_normal(found.shape)

    truth = driven.truth._replace(**{n: longer(np.asarray(v)) for n, v in driven.truth._asdict().items()})
    controls = driven.controls._replace(
        **{n: longer(np.asarray(v)) for n, v in driven.controls._asdict().items()}
    )
    truth = truth._replace(force_x=truth.load * rng.uniform(-1, 1, (rows, 4)))
    whole = replace(driven, time=np.arange(rows) / 200.0, truth=truth, controls=controls)
    assert write_drive_page(tmp_path / "a.html", whole).stat().st_size < 3e6


def test_names_are_shown_and_do_not_act(driven: Drive, tmp_path: Path) -> None:
    named = replace(
        driven,
        manoeuvre=replace(driven.manoeuvre, name=EVIL, description=EVIL),
        vehicle=CAR.model_copy(update={"name": EVIL}),
    )
    text = write_drive_page(tmp_path / "a.html", named, title=EVIL, settings={EVIL: [EVIL]}).read_text(
        "utf-8"
    )
    assert EVIL not in text
    assert "&lt;script&gt;alert(1)" in text
    assert all(tag == "script" and "src" not in attributes for tag, attributes in Tables(text).loads)
    assert "default-src 'none'" in text


def test_a_browser_draws_it_without_a_word(driven: Drive, tmp_path: Path) -> None:
    from test_rendered import console_of, find_browser

    page = write_drive_page(tmp_path / "a.html", driven)
    console = console_of(find_browser(), page, tmp_path, "--window-size=1400,3000")
    assert any("document idle" in line for line in console)
    assert [c for c in console if re.search(r"error|warn|refused|violat", c, re.IGNORECASE)] == []
