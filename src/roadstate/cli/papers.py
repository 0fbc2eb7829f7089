"""``roadstate papers``: the source papers' figures, ours beside them."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from roadstate.cli import options

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from roadstate.papers.base import Paper
    from roadstate.papers.run import PaperResult
    from roadstate.papers.tables import Line

_SEEDS, _QUICK = 20, 3


def papers(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME",
            help="Papers: two-stage, tfobe, ukf-pf, lm-aekf. Default: all.",
            show_default=False,
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help=f"{_QUICK} noise seeds: a first look, not a result.")
    ] = False,
    seeds: Annotated[
        int | None,
        typer.Option(
            "--seeds", metavar="N", min=1, max=1000, help=f"Noise seeds of each drive. Default: {_SEEDS}."
        ),
    ] = None,
    plant: Annotated[
        list[str] | None,
        typer.Option(
            "--plant",
            metavar="NAME",
            help="matched, full or full-mismatched; may be repeated. Default: all three.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="DIR",
            parser=options.written,
            help="Folder for papers.json, pages and figures.",
        ),
    ] = None,
    markdown: Annotated[
        Path | None,
        typer.Option(
            "--markdown", metavar="FILE", parser=options.written, help="Write the tables as Markdown, too."
        ),
    ] = None,
    as_json: options.AsJson = False,
) -> None:
    """Run the source papers' methods on the papers' drives.

    For each table: the paper's figure, ours with the paper's own settings, and ours with the best
    settings of the same method, as means over noise seeds. On three plants: the estimators' own model
    (matched), the full vehicle simulator (full), and that with production sensors and a vehicle file
    whose figures are off (full-mismatched).

    \b
    Example:
      roadstate papers tfobe --quick --plant matched --out papers
    """
    from roadstate.cli.console import console, print_json, text, to_json
    from roadstate.cli.errors import require
    from roadstate.cli.outputs import staged, staged_file
    from roadstate.cli.progress import working
    from roadstate.core.numerics import use_compilation_cache

    if quick and seeds is not None:
        raise typer.BadParameter("give one of '--quick' and '--seeds'")
    if out is not None:
        require("bokeh")
        require("matplotlib")
    use_compilation_cache()
    from roadstate.papers.base import PLANTS
    from roadstate.papers.page import write_paper_page, write_pictures
    from roadstate.papers.run import run_papers
    from roadstate.papers.tables import markdown as as_markdown
    from roadstate.papers.tables import papers_json

    chosen, plants = _papers(names or []), _known(plant or list(PLANTS), PLANTS, "plant")
    count = _QUICK if quick else seeds or _SEEDS
    written: list[str] = []
    # what cannot be written is refused now, not after minutes
    with ExitStack() as stack:
        folder = None if out is None else stack.enter_context(staged(out))
        tables = None if markdown is None else stack.enter_context(staged_file(markdown, "--markdown"))
        work = stack.enter_context(working())

        def progress(what: str, done: int, total: int) -> None:
            work.begin(what)
            work.advance(done, total)

        results = run_papers(chosen, plants=plants, seeds=count, progress=progress)
        found = papers_json(results)
        if out is not None and folder is not None:
            (folder / "papers.json").write_text(to_json(found), encoding="utf-8")
            for result in results:
                work.begin(f"{result.paper.name}: drawing")
                write_paper_page(folder / f"{result.paper.name}.html", result)
                write_pictures(folder, result)
            written = [str(out / file.name) for file in sorted(folder.iterdir())]
        if tables is not None:
            tables.write_text(as_markdown(results), encoding="utf-8")
            written.append(str(markdown))
    if as_json:
        print_json(found)
        return
    _print(results)
    for path in written:
        console().print(text(path), soft_wrap=True)


def _papers(names: Sequence[str]) -> list[Paper]:
    from roadstate.papers import all_papers

    known = all_papers()
    return [known[name] for name in _known(names or list(known), list(known), "paper")]


def _known(names: Sequence[str], known: Sequence[str], what: str) -> list[str]:
    """The names, each once, if there are such."""
    from roadstate.core import InputError
    from roadstate.core.channels import did_you_mean

    for name in names:
        if name not in known:
            raise InputError(f"no {what} is called '{name}'", mend=did_you_mean(name, known))
    return list(dict.fromkeys(names))


def _print(results: Sequence[PaperResult]) -> None:
    from roadstate.cli.console import console, text
    from roadstate.papers.tables import LEGEND, conditions, lines, notes

    screen = console()
    for result in results:
        screen.print(text(f"{result.paper.name}: {result.paper.title}. {result.seeds} noise seeds."))
        for name, title in conditions(result.paper):
            screen.print(text(f"- {name}: {title}"))
        screen.print()
        for plant, outcomes in result.cells.items():
            for name, of in lines(outcomes).items():
                screen.print(_table(f"{result.paper.name}, {plant}: {name}", of))
            for note in notes(outcomes):
                screen.print(text(note))
            screen.print()
    screen.print(text(LEGEND))


def _table(title: str, lines: Sequence[Line]) -> Table:
    from roadstate.cli.console import table, text

    bound = ("bound",) if any(line.bound for line in lines) else ()
    rows = table(
        "row", "column", "unit", "paper", "as printed", "best ± std", *bound, "",
        title=title, left=("row", "column", "unit", ""), wrap=("row", "column"), gap=1,
    )  # fmt: skip
    for line in lines:
        words = (text(line.row), text(line.column), text(line.unit))
        ours = (line.paper, line.as_printed, line.best_spread)
        rows.add_row(*words, *ours, *((line.bound,) if bound else ()), line.met)
    return rows
