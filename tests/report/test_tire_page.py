"""The page of a tire's curves: its lines are the tire's, and nothing in it acts."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from test_page import Tables, columns, models

from roadstate.core import InputError
from roadstate.report.tables import Table
from roadstate.report.tire_page import write_tire_page
from roadstate.tires import Brush, MagicFormula, TireModel

pytest.importorskip("bokeh")

LOADS = [2000.0, 4000.0, 6000.0]
EVIL = "<script>alert(1)</script>"


@pytest.fixture(scope="module")
def tire() -> MagicFormula:
    return MagicFormula.default()


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory, tire: MagicFormula) -> str:
    path = tmp_path_factory.mktemp("tire") / "tire.html"
    write_tire_page(
        path,
        tire,
        loads=LOADS,
        friction=0.9,
        title=EVIL,
        sentences=[EVIL],
        headline=Table("t", ("a", "b"), [(EVIL, "1")]),
        fitted=Brush(),
        fitted_friction=0.8,
    )
    return path.read_text("utf-8")


def drawn(page: str, x: np.ndarray, y: np.ndarray) -> bool:
    """Whether some line of the page is this one."""
    return any(
        len(c["x"]) == len(x)
        and np.allclose(c["x"], x, rtol=1e-5)
        and np.allclose(c["y"], y, rtol=1e-4, atol=1e-5)
        for c in columns(page)
    )


@eqx.filter_jit
def forces(model: TireModel, slip: Any, angle: Any, load: Any, friction: Any) -> Any:
    return model.forces(slip, angle, load, friction, jnp.asarray(20.0))


def test_pure_slip_is_drawn_at_every_load_and_the_fit_beside_it(page: str, tire: MagicFormula) -> None:
    slip, angle, zero = np.linspace(-0.3, 0.3, 201), np.linspace(-0.25, 0.25, 201), np.zeros(201)
    moments = eqx.filter_jit(MagicFormula.moments)
    for load in np.array(LOADS):
        for model, mu in ((tire, np.float64(0.9)), (Brush(), np.float64(0.8))):
            F_x = np.asarray(forces(model, slip, zero, load, mu).F_x)
            F_y = np.asarray(forces(model, zero, angle, load, mu).F_y)
            assert drawn(page, 100 * slip, F_x / 1e3)
            assert drawn(page, np.degrees(angle), F_y / 1e3)
        M_z = np.asarray(moments(tire, zero, angle, load, np.float64(0.9), 20.0).M_z)
        assert drawn(page, np.degrees(angle), M_z)


def test_combined_slip_and_camber_are_drawn_at_the_middle_load(page: str, tire: MagicFormula) -> None:
    slip, angle = np.linspace(-0.3, 0.3, 201), np.linspace(-0.25, 0.25, 201)
    force = forces(tire, slip, np.full(201, 0.125), np.float64(4000.0), np.float64(0.9))
    assert drawn(page, np.asarray(force.F_x) / 1e3, np.asarray(force.F_y) / 1e3)
    leaning = eqx.filter_jit(partial(tire.forces, 0.0, camber=np.radians(4.0)))(angle, 4000.0, 0.9, 20.0).F_y
    assert drawn(page, np.degrees(angle), np.asarray(leaning) / 1e3)
    turn = np.linspace(0, 2 * np.pi, 181)
    peak_x, peak_y = (4.0 * float(p) for p in eqx.filter_jit(tire.peak_friction)(4000.0, 0.9))
    assert drawn(page, peak_x * np.cos(turn), peak_y * np.sin(turn))


def test_what_the_load_does_is_drawn(page: str, tire: MagicFormula) -> None:
    F_z = np.linspace(1000.0, 7500.0, 61)
    peaks, lengths = (eqx.filter_jit(f) for f in (tire.peak_friction, tire.relaxation_lengths))
    for values in (*peaks(F_z, 0.9), *lengths(F_z)):
        assert drawn(page, F_z / 1e3, np.asarray(values))


def test_names_are_shown_and_do_not_act(page: str) -> None:
    assert EVIL not in page
    assert Tables(page).tables[0][1][0] == EVIL
    assert page.count("&lt;script&gt;alert(1)") == 4
    assert all("src" not in attributes for _, attributes in Tables(page).loads)
    assert "default-src 'none'" in page


def test_a_tire_without_relaxation_has_no_figure_of_it(tmp_path: Path, tire: MagicFormula) -> None:
    from dataclasses import replace

    def labels(path: Path) -> list[str]:
        found = models(path.read_text("utf-8"))
        return [m["attributes"].get("axis_label", "") for m in found if m["name"] == "LinearAxis"]

    with_one = write_tire_page(tmp_path / "a.html", tire, loads=[4e3], friction=1.0, title="a")
    rigid = replace(tire, relaxation="none")
    without = write_tire_page(tmp_path / "b.html", rigid, loads=[4e3], friction=1.0, title="b")
    assert "σ [m]" in labels(with_one)
    assert "σ [m]" not in labels(without)


@pytest.mark.parametrize("loads", [[], [0.0], [-1.0], [float("nan")], [1e3] * 9])
def test_loads_that_cannot_be_drawn_are_refused(
    tmp_path: Path, tire: MagicFormula, loads: list[float]
) -> None:
    with pytest.raises(InputError, match="1 to 8 loads above zero"):
        write_tire_page(tmp_path / "a.html", tire, loads=loads, friction=1.0, title="a")
    assert list(tmp_path.iterdir()) == []
