"""A paper's outcome as one HTML file, and its figures as PNG files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from roadstate.papers.base import MATCHED
from roadstate.papers.run import Drawing, Outcome, PaperResult
from roadstate.papers.tables import LEGEND, conditions, lines, notes
from roadstate.report import static_figure
from roadstate.report.document import Section, write_document
from roadstate.report.figures import Panel, TimeAxes
from roadstate.report.panels import quantity_panels
from roadstate.report.tables import Table, settings_table, versions

_DATA_BYTES = 3_200_000  # of a page's 5 MB, before compression
_FEWEST, _MOST = 250, 1500  # points of a line
_HINTS = (
    "Figures show the first noise seed. Drag along a figure to zoom, Ctrl + wheel to zoom about the pointer; "
    "the reset tool at the figure's right brings everything back. A click on a legend entry hides its line."
)
_WHAT = {
    "matched": "The plant is the estimators' own model.",
    "full": "The plant is the full vehicle simulator with a Magic Formula 6.1 tire.",
    "full-mismatched": "The full simulator, production sensors, and a vehicle file whose figures are off: "
    "mass, yaw inertia, height of the centre of gravity, stiffnesses and friction of the tires, drag, "
    "rolling resistance and how the body leans by 5 to 10 %, the centre's place by 1 to 2 % "
    "of the wheelbase, the rolling radius by 0.3 to 1 %.",
}
_HOW = {"as_printed": "as printed", "best": "best settings"}


def write_paper_page(path: str | Path, result: PaperResult) -> Path:
    """Write tables and figures of a paper on all plants that were run: one HTML file that opens offline.

    Args:
        path: file to write; it appears whole or not at all.
        result: of the paper.

    Raises:
        InputError: Bokeh is not installed, or the path cannot be written.
    """
    paper = result.paper
    drives = Table("Conditions", ("condition", "what is driven"), conditions(paper), labels=2)
    sections = [Section("conditions", "Conditions", tables=[drives])]
    for plant, outcomes in result.cells.items():
        heading = plant.replace("-", " ").capitalize()
        sections.append(Section(plant, heading, tables=_tables(outcomes), intro=_WHAT[plant]))
    points = _points(result.drawings)
    for plant in result.cells:
        panels = [p for d in result.drawings if d.plant == plant for p in _panels(d, points)]
        sections.append(Section(f"figures-{plant}", f"Figures: {plant}", panels, columns=2))
    sections.append(Section("versions", "Versions", tables=[settings_table("Versions", versions())]))
    return write_document(
        path,
        title=f"roadstate: {paper.name}",
        sentences=[f"{paper.title}.", f"{result.seeds} noise seeds.", LEGEND],
        headline=None,
        sections=sections,
        hints=_HINTS,
    )


def write_pictures(folder: Path, result: PaperResult) -> list[str]:
    """Write each figure as the paper draws it, with the settings it asks for; gives the files' names.

    ``PAPER-FIGURE.png`` is the matched plant's, others have the plant's name at the end.

    Raises:
        InputError: matplotlib is not installed.
    """
    names = []
    for drawing in result.drawings:
        if drawing.variant == drawing.figure.variant:
            plant = "" if drawing.plant == MATCHED else f"-{drawing.plant}"
            names.append(f"{result.paper.name}-{drawing.figure.name}{plant}.png")
            static_figure(folder / names[-1], drawing.log, drawing.results, drawing.figure.quantity)
    return names


def _tables(outcomes: list[Outcome]) -> list[Table]:
    found = []
    for name, rows in lines(outcomes).items():
        has_bound = any(line.bound for line in rows)
        header = ("row", "column", "unit", "paper", "as printed", "best", "")
        texts = [
            (
                *(line.row, line.column, line.unit, line.paper),
                *(line.as_printed_spread, line.best_spread, line.met),
                *((line.bound,) if has_bound else ()),
            )
            for line in rows
        ]
        said = notes([o for o in outcomes if o.cell.table == name])
        whole = (*header, "bound") if has_bound else header
        found.append(Table(name, whole, texts, labels=3, note=" ".join(said)))
    return found


def _points(drawings: list[Drawing]) -> int:
    """How many points each line may have, as :func:`roadstate.report.page.points_per_line` counts them."""
    numbers = sum(2 + 10 * len(d.results) for d in drawings)
    return int(min(_MOST, max(_FEWEST, _DATA_BYTES / (max(numbers, 1) * 16 / 3))))


def _panels(drawing: Drawing, points: int) -> Iterator[Panel]:
    axes = TimeAxes(drawing.log.time, points)
    title = f"{drawing.figure.name}: {drawing.figure.title} ({_HOW[drawing.variant]})"
    parts = quantity_panels(axes, drawing.figure.quantity, drawing.results, drawing.log)
    for part, heading in zip(parts, (title, f"{drawing.figure.name}: error"), strict=False):
        yield replace(part, heading=heading)
