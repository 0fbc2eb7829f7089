"""``roadstate calibrate``: learn a car's figures from its logs."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from roadstate.cli import options
from roadstate.cli.logs import Source

if TYPE_CHECKING:
    from roadstate.calibration import Calibration


def calibrate(
    files: options.Files,
    vehicle: options.VehicleName,
    learn: Annotated[
        str,
        typer.Option(
            "--learn",
            "-l",
            metavar="GROUP,…",
            help="What to learn: mass, tire, slip, friction, aero, rolling, body, radius, geometry, inertia, "
            "driveline, brakes, steering.",
        ),
    ] = "",
    tune: Annotated[bool, typer.Option("--tune", help="Learn the noise levels in the file, too.")] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="YAML",
            parser=options.written,
            help="New vehicle file to write. Default: none.",
        ),
    ] = None,
    mapping: options.MappingFile = None,
    dbc: options.DbcFiles = None,
    estimator: Annotated[
        str, typer.Option("--estimator", "-e", metavar="NAME", help="Whose filter judges.")
    ] = "joint",
    rate: options.Rate = None,
    separate: options.Separate = False,
    prior: Annotated[
        bool,
        typer.Option("--prior/--no-prior", help="Take the file's own uncertainties into account."),
    ] = True,
    road_friction: Annotated[
        float | None,
        typer.Option(
            "--road-friction",
            metavar="MU",
            help="Peak friction of the road in the logs, where it has been measured: then the tires' shape "
            "can be learned.",
        ),
    ] = None,
    as_json: options.AsJson = False,
) -> None:
    """Learn a car's figures from logs of its drives.

    Writes a new vehicle file, in which learned figures have the values that make the logs likeliest and the
    uncertainty that is left. What the logs do not tell stays as it is; the table says why.

    \b
    Example:
      roadstate calibrate drive.csv -v car.yaml -l mass,tire -o learned.yaml
    """
    from roadstate.calibration import calibrate as fit
    from roadstate.calibration import learned_yaml, select
    from roadstate.cli.console import print_json
    from roadstate.cli.left_out import notes
    from roadstate.cli.outputs import staged_file
    from roadstate.cli.progress import working
    from roadstate.core.numerics import use_compilation_cache
    from roadstate.lateness import lateness
    from roadstate.vehicles import load_vehicle, vehicle_text

    car = load_vehicle(vehicle)
    groups = [word.strip() for word in learn.split(",") if word.strip()]
    select(car, groups, tune=tune)  # what is misspelt is better refused at once
    source = Source(tuple(files), mapping, tuple(dbc or ()), rate, separate)
    use_compilation_cache()
    with nullcontext() if out is None else staged_file(out) as temporary, working() as work:
        work.begin(f"reading {', '.join(source.groups())}")
        logs = dict(source.logs(car))
        work.begin("compiling")
        found = fit(
            car,
            logs,
            groups,
            tune=tune,
            estimator=estimator,
            use_prior=prior,
            road_friction=road_friction,
            progress=lambda count, far: work.begin(f"evaluation {count}: {far:.2g} σ from the optimum"),
        )
        text = learned_yaml(vehicle_text(vehicle), vehicle, found)
        if temporary is not None:
            temporary.write_text(text, encoding="utf-8")
    mapping_of, first = source.load_mapping(), source.groups()
    for name, log in logs.items():
        for note in notes(first[name][0], log, mapping_of, lateness(log, car)):
            print(note, file=sys.stderr)
    if as_json:
        print_json(facts(found, out))
    else:
        _print(found, out)


def facts(found: Calibration, out: Path | None) -> dict[str, Any]:
    """What ``--json`` prints."""
    return {
        "estimator": found.estimator,
        "prior": found.uses_prior,
        "road_friction": found.road_friction,
        "converged": found.converged,
        "evaluations": found.evaluations,
        "logs": {name: {"samples": samples} for name, samples in found.logs.items()},
        "learned": {
            one.parameter.name: {
                "unit": one.parameter.unit,
                "before": one.parameter.start,
                "value": one.value,
                "std": one.std,
            }
            for one in found.learned
        },
        "refused": dict(found.refused),
        "file": None if out is None else str(out),
    }


def _print(found: Calibration, out: Path | None) -> None:
    from roadstate.cli.console import console, figure, table, text

    rows = table("figure", "before", "learned", "±1σ", "unit", left=("figure", "unit"))
    for one in found.learned:
        digits = 2 if one.std <= 0 else min(max(2 + int(abs(one.value) / one.std > 10), 3), 5)
        numbers = figure(one.parameter.start, digits + 1), figure(one.value, digits + 1), figure(one.std, 2)
        unit = "" if one.parameter.unit == "-" else one.parameter.unit
        rows.add_row(one.parameter.name, *numbers, unit)
    screen = console()
    screen.print(rows)
    if not found.converged:
        screen.print("\nnot at the optimum yet: calibrate once more, from the new file")
    if found.refused:
        screen.print("\nleft as in the file:")
    for name, why in found.refused.items():
        screen.print(text(f"  {name}: {why}"), soft_wrap=True)
    if out is not None:
        screen.print(text(f"\n{out}"), soft_wrap=True)
    else:
        screen.print("\nno file written; say '--out NEW.yaml' for one")
