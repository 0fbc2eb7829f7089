"""A tire's characteristic curves as one HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np
from numpy.typing import NDArray

from roadstate.core import InputError
from roadstate.report import style
from roadstate.report.document import Section, write_document
from roadstate.report.figures import Panel
from roadstate.report.plots import Curve, xy_figure
from roadstate.report.tables import Table
from roadstate.tires import MagicFormula, TireModel, curves

Array = NDArray[np.float64]

SPEED = 20.0
"""m/s at which the curves hold; of a Magic Formula only its sign and the shifts' fading depend on it."""

MOST_LOADS = 8
_LARGEST_SLIP, _LARGEST_ANGLE = 0.3, 0.25
_CAMBERS = (-4.0, -2.0, 0.0, 2.0, 4.0)  # deg
_POINTS_OVER_LOAD = 61
_LOAD = "load F_z [kN]"
_HINTS = (
    "Drag a box to zoom, Ctrl + wheel to zoom about the pointer; the reset tool at the figure's right brings "
    "everything back. A click on a legend entry hides its lines."
)


def write_tire_page(
    path: str | Path,
    tire: MagicFormula,
    *,
    loads: Sequence[float],
    friction: float,
    title: str,
    sentences: Sequence[str] = (),
    headline: Table | None = None,
    tables: Sequence[Table] = (),
    fitted: TireModel | None = None,
    fitted_friction: float = 1.0,
) -> Path:
    """Draw forces and aligning moment in pure slip, combined slip, camber, and what the load does.

    Args:
        path: HTML file to write; it appears whole or not at all.
        tire: the tire.
        loads: (L,) vertical loads to draw, N; eight at most.
        friction: as the tire takes it.
        title: heading.
        sentences: below it.
        headline: a table above the figures.
        tables: below them.
        fitted: a simpler tire to draw beside it, dashed.
        fitted_friction: the friction to ask that one at.

    Raises:
        InputError: no load, too many, one that is not above zero, forces that are not finite, Bokeh is not
            installed, or the path cannot be written.
    """
    if not 0 < len(loads) <= MOST_LOADS or not all(np.isfinite(v) and v > 0 for v in loads):
        raise InputError(f"a figure needs 1 to {MOST_LOADS} loads above zero")
    own = _curves(tire, loads, friction)
    if not all(np.all(np.isfinite(values)) for values in own.values()):
        raise InputError("its coefficients give no finite force at these loads", where=title)
    other = None if fitted is None else _curves(fitted, loads, fitted_friction)
    dashed = "" if fitted is None else f"Dashed: {fitted.name}, fitted. "
    middle = int(np.argsort(loads)[len(loads) // 2])
    over_load = _over_load(tire, loads, friction)
    highest = _peak_friction(tire, np.float64(loads[middle]), np.float64(friction))
    peaks = [loads[middle] * float(v) for v in highest]
    sections = [
        Section("pure", "Pure slip", _pure(own, other, over_load), intro=dashed, columns=2),
        Section("combined", "Combined slip", _combined(own, other, middle, peaks), intro=dashed, columns=2),
        Section("camber", "Camber", _camber(tire, float(loads[middle]), friction), columns=2),
        Section("load", "Load", _load_panels(over_load), columns=2),
        Section("numbers", "Numbers", tables=list(tables)),
    ]
    return write_document(
        path, title=title, sentences=sentences, headline=headline, sections=sections, hints=_HINTS
    )


def _curves(tire: TireModel, loads: Sequence[float], friction: float) -> dict[str, Array]:
    return curves(
        tire,
        loads,
        friction=friction,
        speed=SPEED,
        largest_slip=_LARGEST_SLIP,
        largest_slip_angle=_LARGEST_ANGLE,
    )


def _pure(own: dict[str, Array], other: dict[str, Array] | None, over_load: dict[str, Array]) -> list[Panel]:
    percent, degrees = 100 * own["slip"], np.degrees(own["slip_angle"])
    names = [_kilonewton(F_z) for F_z in own["load"]]

    def lines(x: Array, key: str, scale: float) -> list[Curve]:
        solid = [Curve(n, x, row * scale, c) for n, row, c in zip(names, own[key], style.LINES, strict=False)]
        if other is None or key not in other:
            return solid
        return solid + [
            Curve(n, x, row * scale, c, "dashed", 1.4)
            for n, row, c in zip(names, other[key], style.LINES, strict=False)
        ]

    slip, angle = "slip κ [%]", "slip angle α [°]"
    load, peaks = 1e-3 * over_load["load"], (("along", "peak_x"), ("across", "peak_y"))
    found = [Curve(n, load, over_load[k], c) for (n, k), c in zip(peaks, style.LINES, strict=False)]
    return [
        Panel("Longitudinal force over slip", xy_figure(lines(percent, "F_x", 1e-3), slip, "F_x [kN]")),
        Panel("Lateral force over slip angle", xy_figure(lines(degrees, "F_y", 1e-3), angle, "F_y [kN]")),
        Panel(
            "Self-aligning moment over slip angle", xy_figure(lines(degrees, "M_z", 1.0), angle, "M_z [N·m]")
        ),
        Panel("Peak friction over load", xy_figure(found, _LOAD, "peak |F|/F_z [-]")),
    ]


def _combined(
    own: dict[str, Array], other: dict[str, Array] | None, row: int, peaks: Sequence[float]
) -> list[Panel]:
    angles, F_z = np.degrees(own["combined_slip_angle"]), own["load"][row]
    names = [f"α = {a:.2g}°" for a in angles]
    plane, across = [], []
    for source, dash, width in ((own, "solid", 2.0), (other, "dashed", 1.4)):
        if source is None:
            continue
        F_x, F_y = 1e-3 * source["combined_F_x"][row], 1e-3 * source["combined_F_y"][row]
        for name, x, y, color in zip(names, F_x, F_y, style.LINES, strict=False):
            plane.append(Curve(name, x, y, color, dash, width))
            across.append(Curve(name, 100 * own["slip"], y, color, dash, width))
    turn = np.linspace(0, 2 * np.pi, 181)
    peak_x, peak_y = (1e-3 * F_z * own[key][row] for key in ("peak_x", "peak_y"))
    limit = Curve("pure peaks", peak_x * np.cos(turn), peak_y * np.sin(turn), "#7A7A7A", "dotted", 1.4)
    at = _kilonewton(F_z)
    return [
        Panel(
            f"Force at constant slip angle, slip from −30 % to 30 %, at {at}",
            xy_figure([limit, *plane], "F_x [kN]", "F_y [kN]", height=460),
            "Dotted: the ellipse through the peaks of pure slip, to which a tire need not keep.",
        ),
        Panel(f"Lateral force over slip at {at}", xy_figure(across, "slip κ [%]", "F_y [kN]", height=460)),
    ]


@eqx.filter_jit
def _leaning(tire: MagicFormula, angle: Any, load: Any, friction: Any, camber: Any) -> tuple[Any, Any]:
    """Lateral force and aligning moment."""
    where = (0.0, angle, load, friction, SPEED)
    return tire.forces(*where, camber=camber).F_y, tire.moments(*where, camber=camber).M_z


@eqx.filter_jit
def _peak_friction(tire: MagicFormula, load: Any, friction: Any) -> tuple[Any, Any]:
    return tire.peak_friction(load, friction)


def _camber(tire: MagicFormula, load: float, friction: float) -> list[Panel]:
    angle = np.linspace(-_LARGEST_ANGLE, _LARGEST_ANGLE, 201)
    camber = np.radians(_CAMBERS)[:, None]
    F_y, M_z = (np.asarray(a) for a in _leaning(tire, angle, np.float64(load), np.float64(friction), camber))
    panels = []
    for key, unit, values in (("F_y", "kN", 1e-3 * F_y), ("M_z", "N·m", M_z)):
        drawn = [
            Curve(f"γ = {g:g}°".replace("-", "−"), np.degrees(angle), row, c)
            for g, row, c in zip(_CAMBERS, values, style.LINES, strict=False)
        ]
        heading = f"{'Lateral force' if key == 'F_y' else 'Self-aligning moment'} at {_kilonewton(load)}"
        panels.append(Panel(heading, xy_figure(drawn, "slip angle α [°]", f"{key} [{unit}]")))
    return panels


def _over_load(tire: MagicFormula, loads: Sequence[float], friction: float) -> dict[str, Array]:
    F_z = np.linspace(0.5 * min(loads), 1.25 * max(loads), _POINTS_OVER_LOAD)
    found = curves(tire, F_z.tolist(), friction=friction, speed=SPEED, points=3)
    # not the highest of three points, but the formula's
    peak_x, peak_y = (np.asarray(v) for v in _peak_friction(tire, F_z, np.float64(friction)))
    return found | {"peak_x": peak_x, "peak_y": peak_y}


def _load_panels(over_load: dict[str, Array]) -> list[Panel]:
    F_z = over_load["load"]
    x, blue, orange = 1e-3 * F_z, *style.LINES[:2]
    per_load = [
        Curve("C_κ/F_z [-]", x, over_load["stiffness_x"] / F_z, blue),
        Curve("C_α/F_z [1/rad]", x, over_load["stiffness_y"] / F_z, orange),
    ]
    panels = [Panel("Slip stiffness per load", xy_figure(per_load, _LOAD, "stiffness per load"))]
    if np.any(over_load["relaxation_x"]) or np.any(over_load["relaxation_y"]):
        lengths = [
            Curve("σ_κ along", x, over_load["relaxation_x"], blue),
            Curve("σ_α across", x, over_load["relaxation_y"], orange),
        ]
        panels.append(Panel("Relaxation length", xy_figure(lengths, _LOAD, "σ [m]")))
    return panels


def _kilonewton(load: float) -> str:
    return f"{1e-3 * load:.3g} kN"
