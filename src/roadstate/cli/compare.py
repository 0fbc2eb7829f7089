"""``roadstate compare``: errors of estimators against the references in a log."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from roadstate.cli import options
from roadstate.cli.logs import Source
from roadstate.core import InputError

if TYPE_CHECKING:
    from rich.table import Table

    from roadstate.metrics import Metrics

LEGEND = (
    "grade in % (100 tan θ; 1 % is 0.57°). MAE-b: bias removed. NEES: near 1 where σ\n"
    "is honest. 95%: share inside the stated 95 % interval. settle: s until at rest."
)
"""What the columns of :func:`metrics_table` mean."""


def compare(
    files: options.Files,
    vehicle: options.VehicleName,
    mapping: options.MappingFile = None,
    dbc: options.DbcFiles = None,
    estimator: options.EstimatorNames = None,
    rate: options.Rate = None,
    settle: options.Settle = 0.0,
    separate: options.Separate = False,
    as_json: options.AsJson = False,
) -> None:
    """Compare estimators with the reference channels of a log.

    Needs a log with at least one reference (ref_grade, ref_bank, ref_velocity_x and _y, or ref_friction_* and
    ref_force_* of wheels), measured or made by the mapping.

    \b
    Example:
      roadstate compare drive.csv --vehicle family-car --settle 5
    """
    from roadstate.cli.console import console, print_json
    from roadstate.cli.progress import working
    from roadstate.cli.runs import run_all
    from roadstate.vehicles import load_vehicle

    if not (math.isfinite(settle) and settle >= 0):
        raise InputError(f"--settle {settle:g} is out of range", mend="give 0 seconds or more")
    car = load_vehicle(vehicle)
    source = Source(tuple(files), mapping, tuple(dbc or ()), rate, separate)
    found: dict[str, dict[str, dict[str, Metrics]]] = {}
    with working() as work:
        for run in run_all(source, car, list(estimator or ()), work, settle=settle, needs_reference=True):
            found[run.name] = run.metrics
    if as_json:
        print_json(
            {
                log: {e: {q: m.to_json() for q, m in of.items()} for e, of in by_estimator.items()}
                for log, by_estimator in found.items()
            }
        )
        return
    screen = console()
    for log, by_estimator in found.items():
        screen.print(metrics_table(log, by_estimator, settle))
    screen.print(LEGEND)


def metrics_table(log: str, metrics: Mapping[str, Mapping[str, Metrics]], settle: float) -> Table:
    """The errors of one log for people, 80 columns wide.

    Args:
        log: its name.
        metrics: estimator → quantity → its errors.
        settle: seconds left out at the start.
    """
    from roadstate.cli.console import table, with_unit

    counts = sorted({m.n for of in metrics.values() for m in of.values()}) or [0]
    samples = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    start = f"after {settle:g} s" if settle else "from the start"
    rows = table(
        "", "MAE", "RMSE", "max", "bias", "MAE-b", "r", "NEES", "95%", "settle",
        left=("",), wrap=("",), title=f"{log}: {samples} samples {start}", gap=1,
    )  # fmt: skip
    for estimator, of in metrics.items():
        rows.add_row(estimator)
        for quantity, m in of.items():
            errors = [_short(v) for v in (m.mae, m.rmse, m.max, m.bias, m.mae_bias_removed)]
            correlation = _shown(m.correlation, lambda v: f"{v:.3f}")
            nees = _short(m.nees)
            share = _shown(m.coverage95, lambda v: f"{100 * v:.0f}%")
            settled = _shown(m.settle_s, lambda v: f"{v:.1f}")
            rows.add_row(f"  {with_unit(quantity, m.unit)}", *errors, correlation, nees, share, settled)
    return rows


def _short(value: float | None) -> str:
    from roadstate.cli.console import figure

    # an error that takes an exponent is beyond all use: two digits leave the room to the names
    return figure(value, 3 if value is None or abs(value) < 1e7 else 2, most=3)


def _shown(value: float | None, form: Callable[[float], str]) -> str:
    return "-" if value is None or not math.isfinite(value) else form(value)
