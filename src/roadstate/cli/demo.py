"""``roadstate demo``: a simulated drive, three estimators and a report, from no input at all."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from roadstate.cli import options

_VEHICLE = "family-car"
_ESTIMATORS = ("joint", "kmbe", "debe")
_SETTLE = 5.0  # s: the estimators begin without knowing the grade
_WHAT = (
    "A drive over the ramp of Luo et al. (J. Vibroengineering, 2024): grades of -1.8°, 3.4° and -3.9°, "
    "braking, gear shifts and a stop on the slope. Simulated by a longitudinal point-mass model, not the "
    "full vehicle simulator; with sensor noise, accelerometer bias and wheel slip.\n"
)


def demo(
    out: Annotated[
        Path,
        typer.Option("--out", "-o", metavar="DIR", parser=options.written, help="Folder for the results."),
    ] = Path("roadstate-demo"),
    seed: Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Of the sensors' noise.")] = 0,
    show: Annotated[bool, typer.Option("--open", help="Open the report in the web browser.")] = False,
) -> None:
    """Simulate a drive, estimate the road's grade, write a report.

    Writes DIR/drive.csv, DIR/report.html, a Parquet file for each estimator and summary.json. The
    drive comes from a longitudinal point-mass model, not from a full vehicle simulator.
    """
    from roadstate.cli.compare import LEGEND, metrics_table
    from roadstate.cli.console import console, text
    from roadstate.cli.errors import require
    from roadstate.cli.estimate import Summary, write_html, write_run
    from roadstate.cli.logs import Source
    from roadstate.cli.outputs import staged
    from roadstate.cli.progress import working
    from roadstate.cli.runs import run_log
    from roadstate.core.numerics import use_compilation_cache
    from roadstate.io import write
    from roadstate.sim import simulate
    from roadstate.vehicles import load_vehicle

    require("bokeh")
    use_compilation_cache()
    car = load_vehicle(_VEHICLE)
    summary = Summary(Source((Path("drive.csv"),)), car, _VEHICLE, _ESTIMATORS)
    settings = summary.content["settings"]
    settings |= {"settle": _SETTLE, "seed": seed}
    with staged(out) as folder, working() as work:
        work.begin("simulating")
        log = simulate(car, seed=seed)
        log = type(log)(log.time, log.channels, {**log.metadata, "files": ["drive.csv"]})
        write(log, folder / "drive.csv")
        run = run_log("drive", log, car, _ESTIMATORS, work, settle=_SETTLE)
        write_run(folder, run)
        summary.add(run)
        summary.write(folder)
        work.begin("report")
        write_html(folder / "report.html", run, car, settings, title="roadstate demo: a simulated drive")
    screen = console()
    screen.print(text(_WHAT))
    screen.print(metrics_table("drive", run.metrics, _SETTLE))
    screen.print(LEGEND)
    screen.print(text(f"\nreport: {out / 'report.html'}"), soft_wrap=True)
    again = f"roadstate compare {out / 'drive.csv'} --vehicle {_VEHICLE} --settle {_SETTLE:g}"
    screen.print(text(f"the same table again: {again}"), soft_wrap=True)
    if show:
        import webbrowser

        webbrowser.open((out / "report.html").resolve().as_uri())
