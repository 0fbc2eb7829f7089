"""The options that commands share: one meaning, one wording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def written(given: str | Path) -> Path:
    """The path that a command is to write; an empty one, as of a variable never set, is not the folder here.

    Raises:
        BadParameter: it is empty.
    """
    if not str(given):
        raise typer.BadParameter("the path is empty")
    return Path(given)


Files = Annotated[
    list[Path],
    typer.Argument(metavar="FILE", help="Log files: CSV, Parquet or MF4.", show_default=False),
]
VehicleName = Annotated[
    str,
    typer.Option(
        "--vehicle",
        "-v",
        metavar="NAME|YAML",
        help="A preset (see 'roadstate vehicles') or a vehicle file.",
        show_default=False,
    ),
]
MappingFile = Annotated[
    Path | None,
    typer.Option(
        "--mapping",
        "-m",
        metavar="YAML",
        help="Which signal is which channel; not needed where names are canonical.",
    ),
]
DbcFiles = Annotated[
    list[Path] | None,
    typer.Option("--dbc", "-d", metavar="DBC", help="Decodes raw CAN frames; may be repeated."),
]
EstimatorNames = Annotated[
    list[str] | None,
    typer.Option(
        "--estimator",
        "-e",
        metavar="NAME",
        help="Estimator to run; may be repeated. Default: all that the channels allow.",
    ),
]
Rate = Annotated[
    float | None,
    typer.Option(
        "--rate",
        metavar="HZ",
        help="Samples per second. Default: the log's own, at most 100 where it is mixed.",
    ),
]
Settle = Annotated[
    float,
    typer.Option("--settle", metavar="SECONDS", help="Leave out the start of each log, as papers do."),
]
Separate = Annotated[
    bool,
    typer.Option("--separate", help="Each FILE is a log of its own. Default: the files are one drive."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
