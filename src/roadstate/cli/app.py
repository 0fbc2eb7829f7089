"""The tree of commands. A command is a module of this package; its work is imported when it runs."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from roadstate.cli.calibrate import calibrate
from roadstate.cli.channels import channels
from roadstate.cli.compare import compare
from roadstate.cli.demo import demo
from roadstate.cli.estimate import estimate
from roadstate.cli.listings import estimators, manoeuvres, vehicles
from roadstate.cli.papers import papers
from roadstate.cli.simulate import simulate
from roadstate.cli.tire import tire

app = typer.Typer(
    name="roadstate",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 80},
)
COMMANDS = (
    *(demo, channels, estimate, compare, calibrate, simulate, tire, papers),
    *(estimators, manoeuvres, vehicles),
)
for function in COMMANDS:
    app.command()(function)


def _version(wanted: bool) -> None:
    if wanted:
        from roadstate import __version__

        typer.echo(f"roadstate {__version__}")
        raise typer.Exit


@app.callback()
def roadstate(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """What the road does to a car, from the signals the car already has.

    Begin with 'roadstate demo', or with 'roadstate channels FILE' on a log of your own.
    """


def command() -> Any:
    """The whole command line as one object that parses words."""
    return typer.main.get_command(app)
