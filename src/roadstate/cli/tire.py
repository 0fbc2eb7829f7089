"""``roadstate tire``: what a tire property file holds, and its curves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from roadstate.cli import options

_SHARES = (0.5, 1.0, 1.5)  # of the nominal load


def tire(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Tire property file (.tir).", show_default=False)
    ],
    plot: Annotated[
        Path | None,
        typer.Option(
            "--plot",
            "-p",
            metavar="HTML",
            parser=options.written,
            help="Draw its curves into one HTML file.",
        ),
    ] = None,
    load: Annotated[
        list[float] | None,
        typer.Option(
            "--load", metavar="N", help="Vertical load; may be repeated. Default: 0.5, 1, 1.5 × nominal."
        ),
    ] = None,
    fit: Annotated[
        str | None,
        typer.Option("--fit", metavar="NAME", help="Fit a simpler tire model to it; with --plot, draw both."),
    ] = None,
    friction: Annotated[
        float | None,
        typer.Option("--friction", metavar="MU", help="Peak friction. Default: as the file was measured."),
    ] = None,
    symmetric: Annotated[
        bool, typer.Option("--symmetric", help="Without ply steer, conicity and other shifts.")
    ] = False,
    as_json: options.AsJson = False,
) -> None:
    """Show what a tire property file holds, and draw its curves."""
    from roadstate.cli.console import console, print_json, table, text
    from roadstate.cli.errors import require
    from roadstate.cli.outputs import staged_file
    from roadstate.cli.progress import working
    from roadstate.core.numerics import use_compilation_cache

    if plot is not None:
        require("bokeh")
    use_compilation_cache()
    from roadstate.cli.tire_facts import file_facts, fit_facts, fit_named, load_facts, sentence, tables
    from roadstate.tires import load_tir, read_tir

    mu = 1.0 if friction is None else _in_range(friction, "--friction", 3.0)
    source = read_tir(file)
    made = load_tir(file, symmetric=symmetric, friction_as="factor" if friction is None else "peak")
    facts = {"file": str(file), "friction": friction, "symmetric": symmetric} | file_facts(source, made)
    loads = _loads(load, facts["nominal_load"])
    facts["loads"] = load_facts(made, loads, mu, str(file))
    result = None
    with working() as work:
        if fit is not None:
            work.begin(f"fitting {fit}")
            result = fit_named(fit, made, loads, mu, facts["nominal_load"])
            facts["fit"] = fit_facts(result, mu)
        found = tables(facts)
        if plot is not None:
            from roadstate.report.tire_page import write_tire_page

            work.begin("drawing")
            with staged_file(plot, "--plot") as temporary:
                write_tire_page(
                    temporary,
                    made,
                    loads=loads,
                    friction=mu,
                    title=file.name,
                    sentences=[sentence(facts)],
                    headline=found[0],
                    tables=found[1:],
                    fitted=None if result is None else result.model,
                    fitted_friction=mu if result is None else mu * result.friction_factor,
                )
            facts["plot"] = str(plot)
    if as_json:
        print_json(facts)
        return
    screen = console()
    screen.print(text(f"{file.name}: {sentence(facts)}\n"))
    for part in found:
        rows = table(*part.header, title=part.heading, left=part.header[: part.labels])
        for row in part.rows:
            rows.add_row(*row)
        screen.print(rows)
        screen.print(text(part.note + "\n" if part.note else ""))
    if plot is not None:
        screen.print(text(f"curves: {plot}"), soft_wrap=True)


def _in_range(value: float, option: str, most: float) -> float:
    from roadstate.core import InputError

    if not 0 < value <= most:
        raise InputError(
            f"{value:g} is out of range", where=option, mend=f"give more than 0, {most:g} at most"
        )
    return value


def _loads(given: list[float] | None, nominal: float) -> list[float]:
    from roadstate.core import InputError
    from roadstate.report.tire_page import MOST_LOADS

    if not given:
        return [_in_range(share * nominal, "--load (share of the nominal one)", 1e6) for share in _SHARES]
    if len(given) > MOST_LOADS:
        raise InputError(
            f"{len(given)} loads are too many", where="--load", mend=f"give {MOST_LOADS} at most"
        )
    return sorted(_in_range(value, "--load", 1e6) for value in given)
