"""The numbers of ``roadstate tire``, and the tables that both the terminal and the page show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import equinox as eqx
import numpy as np

from roadstate.core import InputError
from roadstate.core.channels import did_you_mean
from roadstate.report.tables import Table, number
from roadstate.tires import FitResult, MagicFormula, TirFile, all_tires, fit_tire, linear_stiffness
from roadstate.tires.base import ElasticTire, as_leaf

_RANGES = {"load": ("FZMIN", "FZMAX"), "slip": ("KPUMIN", "KPUMAX"), "slip_angle": ("ALPMIN", "ALPMAX")}
_COMBINATIONS = {"weighting": "weighting functions", "ellipse": "friction ellipse"}
# key → heading, factor from SI
_COLUMNS = {
    "load": ("load kN", 1e-3),
    "peak_friction_x": ("peak μ_x", 1.0),
    "peak_friction_y": ("peak μ_y", 1.0),
    "slip_stiffness": ("C_κ kN", 1e-3),
    "cornering_stiffness": ("C_α kN/rad", 1e-3),
    "relaxation_x": ("σ_κ m", 1.0),
    "relaxation_y": ("σ_α m", 1.0),
}


def file_facts(source: TirFile, tire: MagicFormula) -> dict[str, Any]:
    """What the file says of itself, SI; ``None`` where it says nothing."""
    numbers = source.numbers()
    nominal, scale, radius = (float(tire.coefficients[k]) for k in ("FNOMIN", "LFZO", "UNLOADED_RADIUS"))
    return {
        "format": tire.form,
        "combined_slip": tire.combination,
        "relaxation": tire.relaxation,
        "side": source.text("MODEL", "TYRESIDE"),
        "unloaded_radius": radius,
        "width": numbers.get("WIDTH"),
        "rim_radius": numbers.get("RIM_RADIUS"),
        "nominal_load": nominal * scale,
        "pressure": numbers.get("INFLPRES", numbers.get("IP")),
        "ranges": {
            name: [numbers[low], numbers[high]]
            for name, (low, high) in _RANGES.items()
            if low in numbers and high in numbers
        },
    }


def load_facts(
    tire: MagicFormula, loads: Sequence[float], friction: float, where: str
) -> list[dict[str, float]]:
    """Peak friction, slip stiffnesses and relaxation lengths at each load, SI.

    Raises:
        InputError: one of them is not finite.
    """
    F_z = np.asarray(loads)
    columns = (F_z, *_over_load(tire, F_z, np.float64(friction)))
    rows = np.stack([np.asarray(column, float) for column in columns], axis=1)
    if not np.all(np.isfinite(rows)):
        raise InputError("its coefficients give no finite numbers at these loads", where=where)
    return [dict(zip(_COLUMNS, row.tolist(), strict=True)) for row in rows]


@eqx.filter_jit
def _over_load(tire: MagicFormula, load: Any, friction: Any) -> tuple[Any, ...]:
    """Peak friction, slip stiffnesses and relaxation lengths, along and across each."""
    return (
        *tire.peak_friction(load, friction),
        *linear_stiffness(tire, load, friction),
        *tire.relaxation_lengths(load),
    )


def fit_named(
    name: str, tire: MagicFormula, loads: Sequence[float], friction: float, nominal_load: float
) -> FitResult:
    """The tire model called ``name`` fitted to a tire, its friction too where that is not a parameter of it.

    Its stiffnesses, where they follow the load, are those at the nominal load (N).

    Raises:
        InputError: there is no such model, or no fit.
    """
    models = {n: kind for n, kind in all_tires().items() if kind.fitted}
    if name not in models:
        raise InputError(f"no tire model '{name}' to fit", where="--fit", mend=did_you_mean(name, models))
    kind = models[name]
    template = kind(nominal_load=as_leaf(nominal_load)) if issubclass(kind, ElasticTire) else kind
    match = kind.within_friction_circle
    return fit_tire(template, tire, loads=loads, friction=(friction,), match_friction=match)


def fit_facts(result: FitResult, friction: float) -> dict[str, Any]:
    """What came of a fit; parameters in the model's units (SI), misfits in N and % of the peak."""
    model = result.model
    return {
        "model": model.name,
        "converged": result.converged,
        "friction": friction * result.friction_factor,
        "parameters": {name: float(getattr(model, name)) for name in model.fitted},
        "misfit": {name: asdict(misfit) for name, misfit in result.misfit.items()},
    }


def sentence(facts: dict[str, Any]) -> str:
    """What the file is, for people."""
    parts = [f"{facts['format']}, combined slip by {_COMBINATIONS[facts['combined_slip']]}"]
    parts.append(f"unloaded radius {facts['unloaded_radius']:.4g} m")
    parts.append(f"nominal load {facts['nominal_load']:.0f} N")
    if facts["pressure"] is not None:
        parts.append(f"pressure {1e-3 * facts['pressure']:.3g} kPa")
    if facts["side"] in ("LEFT", "RIGHT"):
        parts.append(f"measured on the {facts['side'].lower()}")
    if "load" in facts["ranges"]:
        low, high = facts["ranges"]["load"]
        parts.append(f"valid for {low:.0f} to {high:.0f} N")
    how = "as measured" if facts["friction"] is None else f"peak friction {facts['friction']:g}"
    return "; ".join([*parts, how + (", without shifts" if facts["symmetric"] else "")]) + "."


def _note(facts: dict[str, Any], rolls: bool) -> str:
    note = "Peak friction of pure slip, stiffness at zero slip; "
    note += "63 % of a step in slip act after rolling σ." if rolls else "relaxation is not in the file."
    low, high = facts["ranges"].get("load", (0.0, np.inf))
    if any(not low <= row["load"] <= high for row in facts["loads"]):
        note += " Loads outside of the file's range are extrapolated."
    return note


def tables(facts: dict[str, Any]) -> list[Table]:
    """By load; then, of a fit, its misfit and its parameters."""
    rolls = facts["relaxation"] != "none"
    shown = {key: column for key, column in _COLUMNS.items() if rolls or not key.startswith("relaxation")}
    rows = [tuple(number(scale * row[key]) for key, (_, scale) in shown.items()) for row in facts["loads"]]
    found = [
        Table(
            "By load",
            tuple(heading for heading, _ in shown.values()),
            rows,
            labels=0,
            note=_note(facts, rolls),
        )
    ]
    if "fit" not in facts:
        return found
    fit = facts["fit"]
    misfits = [
        (
            name.replace("_F", " F"),
            *(number(m[key]) for key in ("rms", "largest", "rms_percent", "largest_percent")),
        )
        for name, m in fit["misfit"].items()
    ]
    header = ("misfit of", "rms N", "largest N", "rms %", "largest %")
    note = "% of the peak of pure slip at the same load; |κ| up to 0.15, |α| up to 0.2 rad."
    found.append(Table(f"Fit of {fit['model']}", header, misfits, note=note))
    parameters = [(name, f"{value:.5g}") for name, value in fit["parameters"].items()]
    note = "" if fit["converged"] else "The solver did not converge: take the fit for a sketch."
    rows = [*parameters, ("friction", f"{fit['friction']:.4g}")]
    found.append(Table("Its parameters (SI)", ("name", "value"), rows, note=note))
    return found
