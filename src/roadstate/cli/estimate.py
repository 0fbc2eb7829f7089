"""``roadstate estimate``: run estimators on logs and write what they say."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from roadstate.cli import options
from roadstate.cli.logs import Source

if TYPE_CHECKING:
    from rich.table import Table

    from roadstate.cli.runs import Run
    from roadstate.vehicles import Vehicle


def estimate(
    files: options.Files,
    vehicle: options.VehicleName,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            metavar="DIR",
            parser=options.written,
            help="Folder for the results.",
            show_default=False,
        ),
    ],
    mapping: options.MappingFile = None,
    dbc: options.DbcFiles = None,
    estimator: options.EstimatorNames = None,
    rate: options.Rate = None,
    separate: options.Separate = False,
    smooth: Annotated[
        bool,
        typer.Option(
            "--smooth",
            help="Let each sample know of those after it, too: for mapping the road. "
            "Validity and friction stay as known at the time.",
        ),
    ] = False,
    report: Annotated[bool, typer.Option("--report", help="Write an HTML report of each log, too.")] = False,
    as_json: options.AsJson = False,
) -> None:
    """Estimate what the road does, for every sample of a log.

    Writes DIR/LOG.ESTIMATOR.parquet with a column per quantity and its standard deviation, and
    DIR/summary.json. LOG is the name of the first FILE without its suffix. Nothing is written unless
    everything succeeds.

    With --smooth grade, speed, altitude, mass and biases are those of a Rauch-Tung-Striebel smoother, as far
    as an estimator tells of them; validity, friction, forces and bank stay as they were known at the time.
    Not every estimator can be smoothed; without --estimator all run that can.

    \b
    Example:
      roadstate estimate drive.mf4 -d car.dbc -m mapping.yaml -v suv -o results
    """
    from roadstate.cli.console import print_json
    from roadstate.cli.errors import require
    from roadstate.cli.outputs import staged
    from roadstate.cli.progress import working
    from roadstate.cli.runs import run_all
    from roadstate.vehicles import load_vehicle

    if report:
        require("bokeh")
    car = load_vehicle(vehicle)
    source = Source(tuple(files), mapping, tuple(dbc or ()), rate, separate)
    asked = list(estimator or ())
    written: list[str] = []
    summary = Summary(source, car, vehicle, asked, smooth)
    with staged(out) as folder, working() as work:
        for run in run_all(source, car, asked, work, smooth=smooth):
            written += write_run(folder, run)
            if report:
                work.begin(f"{run.name}: report")
                written.append(write_html(folder / f"{run.name}.html", run, car, summary.content["settings"]))
            summary.add(run)
        written.append(summary.write(folder))
    if as_json:
        print_json(summary.content)
    else:
        _print(summary.content["logs"], [str(out / name) for name in written])


class Summary:
    """The content of ``summary.json``, log by log."""

    def __init__(
        self, source: Source, car: Vehicle, given: str, estimators: Sequence[str], smooth: bool = False
    ) -> None:
        from roadstate.cli.summary import settings, vehicle_summary, versions

        self._car = car
        self.content: dict[str, Any] = {
            "versions": versions(),
            "settings": settings(source, given, estimators, smooth),
            "vehicle": vehicle_summary(car, given),
            "logs": {},
        }

    def add(self, run: Run) -> None:
        """Take in what came of one log."""
        from roadstate.cli.summary import log_summary

        self.content["logs"][run.name] = log_summary(run, self._car)

    def write(self, folder: Path) -> str:
        """Write the file; gives its name."""
        from roadstate.cli.console import to_json

        (folder / "summary.json").write_text(to_json(self.content), encoding="utf-8")
        return "summary.json"


def write_run(folder: Path, run: Run) -> list[str]:
    """Write a log's estimates; gives the files' names."""
    names = []
    for estimator, estimates in run.results.items():
        names.append(f"{run.name}.{estimator}.parquet")
        estimates.to_parquet(folder / names[-1])
    return names


def write_html(path: Path, run: Run, car: Vehicle, settings: dict[str, Any], title: str | None = None) -> str:
    """Write a log's report; gives the file's name."""
    from roadstate.report import write_report

    write_report(
        path,
        run.log,
        run.results,
        metrics=run.metrics,
        vehicle=car.model_dump(mode="json"),
        settings=settings,
        title=title,
    )
    return path.name


def _print(logs: dict[str, Any], written: list[str]) -> None:
    from roadstate.cli.console import console, text

    screen = console()
    for name, log in logs.items():
        for estimator, found in log["estimators"].items():
            validity = ", ".join(f"{label} {100 * share:.0f} %" for label, share in found["validity"].items())
            screen.print(_table(f"{name}, {estimator}: {validity}", found["quantities"]))
            for one in found["faults"]:
                when = f"{one['first_s']:.1f} to {one['last_s']:.1f} s, {100 * one['share']:.0f} %"
                screen.print(text(f"{one['fault']} ({when})"), soft_wrap=True)
            for remark in found["remarks"]:
                screen.print(text(remark), soft_wrap=True)
            screen.print()
    screen.print("Over time; ±1σ, 5% and 95%: means. Grade in % (100 tan θ) and degrees.\n")
    smoothed = {q for log in logs.values() for found in log["estimators"].values() for q in found["smoothed"]}
    if smoothed:
        screen.print(f"smoothed: {', '.join(sorted(smoothed))}; the rest as known at the time\n")
    for path in written:
        screen.print(text(path), soft_wrap=True)


def _table(title: str, quantities: dict[str, Any]) -> Table:
    """Of one estimator's quantities over time; bounds stand beside what they bound."""
    from roadstate.cli.console import figure, table, with_unit
    from roadstate.core.quantities import BOUNDS, is_bound

    ends = ("5%", "95%") if any(map(is_bound, quantities)) else ()
    rows = table(
        "quantity", "mean", "min", "max", "±1σ", *ends,
        left=("quantity",), wrap=("quantity",), title=title, gap=1,
    )  # fmt: skip
    for quantity, q in quantities.items():
        if is_bound(quantity):
            continue
        bounds = [quantities[quantity + b]["mean"] for b in BOUNDS if quantity + b in quantities]
        values = [*(q[k] for k in ("mean", "min", "max", "mean_std")), *bounds]
        scales: list[tuple[str, Any]] = [(q["unit"], float)]
        if quantity == "grade":
            scales = [("%", lambda v: 100 * math.tan(v)), ("deg", math.degrees)]
        finite = [v if v is not None and math.isfinite(v) else None for v in values]
        for unit, scale in scales:
            rows.add_row(
                with_unit(quantity, unit), *(figure(None if v is None else scale(v)) for v in finite)
            )
    return rows
