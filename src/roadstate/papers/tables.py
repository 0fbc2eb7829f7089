"""The outcome of papers as one object for programs, as texts for tables, and as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from roadstate.papers.base import Paper
from roadstate.papers.run import Outcome, PaperResult, Spread
from roadstate.report.tables import number
from roadstate.report.view import unit_label

NONE = "–"
MET = "✓"
"""Marks a cell whose mean with the best settings is no larger than the paper's figure."""
LEGEND = (
    f"as printed: the paper's method exactly as described; best: our best settings of the same method. Ours "
    f"are means over the noise seeds; ± is the standard deviation over them. {MET}: best is at most the "
    f"paper's figure. Lost: seeds that diverged, or never came there; the mean is the others'."
)
"""What the columns mean."""


def papers_json(results: Iterable[PaperResult]) -> dict[str, Any]:
    """``{paper: {plant: {table: {row: {column: cell}}}}}``; ``None`` for what there is not."""
    found: dict[str, Any] = {}
    for result in results:
        plants: dict[str, Any] = found.setdefault(result.paper.name, {})
        for plant, outcomes in result.cells.items():
            tables: dict[str, Any] = plants.setdefault(plant, {})
            for o in outcomes:
                row = tables.setdefault(o.cell.table, {}).setdefault(o.cell.row, {})
                row[o.cell.column] = _cell_json(o)
    return found


def _cell_json(outcome: Outcome) -> dict[str, Any]:
    nothing = Spread(None, None, 0)
    as_printed, best = outcome.as_printed or nothing, outcome.best or nothing
    made = {
        "paper": outcome.cell.paper,
        "ours_as_printed": as_printed.mean,
        "ours_best": best.mean,
        "std": best.std,
        "std_as_printed": as_printed.std,
        "seeds": outcome.seeds,
        "not_finite": best.lost,
        "not_finite_as_printed": as_printed.lost,
        "unit": outcome.cell.unit,
        "condition": outcome.cell.condition,
        "method": outcome.cell.method,
    }
    if outcome.cell.bound is not None:
        made["bound"] = outcome.bound
    if outcome.reason:
        made["reason"] = outcome.reason
    elif any(spread.lost and spread.mean is None for spread in (as_printed, best)):
        made["reason"] = f"in every seed: {outcome.cell.lost}"
    return made


@dataclass(frozen=True)
class Line:
    """A cell on one plant as texts; – where there is nothing.

    Attributes:
        row, column, unit, paper: as in the paper.
        as_printed, as_printed_spread: our mean; mean ± standard deviation, and how many seeds were lost.
        best, best_spread: the same.
        bound: the least that any estimator could reach; empty where the cell has none.
        met: :data:`MET` or empty.
    """

    row: str
    column: str
    unit: str
    paper: str
    as_printed: str
    as_printed_spread: str
    best: str
    best_spread: str
    bound: str
    met: str


def lines(outcomes: Iterable[Outcome]) -> dict[str, list[Line]]:
    """Table → its lines, both in the paper's order."""
    found: dict[str, list[Line]] = {}
    for o in outcomes:
        line = Line(
            row=o.cell.row,
            column=o.cell.column,
            unit=unit_label(o.cell.unit),
            paper=NONE if o.cell.paper is None else f"{o.cell.paper:g}",
            as_printed=_mean(o.as_printed),
            as_printed_spread=_spread(o.as_printed),
            best=_mean(o.best),
            best_spread=_spread(o.best),
            bound="" if o.cell.bound is None else number(o.bound),
            met=MET if o.meets_paper else "",
        )
        found.setdefault(o.cell.table, []).append(line)
    return found


def _mean(spread: Spread | None) -> str:
    return number(spread.mean if spread else None) + _lost(spread)


def _spread(spread: Spread | None) -> str:
    """``0.135 ± 0.012``, both to the same decimal."""
    if spread is None or spread.mean is None or spread.std is None:
        return _mean(spread)
    mean = number(spread.mean)
    decimals = len(mean.partition(".")[2])
    std = number(spread.std, 2) if "e" in mean else f"{spread.std:.{decimals}f}"
    return f"{mean} ± {std}{_lost(spread)}"


def _lost(spread: Spread | None) -> str:
    return f", {spread.lost} lost" if spread is not None and spread.lost else ""


def notes(outcomes: Iterable[Outcome]) -> list[str]:
    """Why cells are empty; one sentence each."""
    return list(dict.fromkeys(f"{o.cell.method}: {o.reason}." for o in outcomes if o.reason))


def markdown(results: Sequence[PaperResult]) -> str:
    """All papers' tables, the plants side by side, to be put into a document."""
    parts = [
        "# The papers' figures and ours",
        "",
        "Written by `roadstate papers --markdown FILE`.",
        LEGEND,
        "",
    ]
    for result in results:
        parts += _paper_markdown(result)
    return "\n".join(parts).rstrip("\n") + "\n"


def _paper_markdown(result: PaperResult) -> list[str]:
    paper = result.paper
    parts = [f"## {paper.name}", "", f"{paper.title}. {result.seeds} noise seeds.", ""]
    parts += [*(f"- {name}: {title}" for name, title in conditions(paper)), ""]
    by_plant = {plant: lines(outcomes) for plant, outcomes in result.cells.items()}
    for table, first in next(iter(by_plant.values()), {}).items():
        has_bound = any(line.bound for line in first)
        heads = ["row", "column", "unit", "paper"]
        for plant in by_plant:
            heads += [f"{plant}: as printed", "best", *(["bound"] if has_bound else [])]
        parts += [f"### {table}", "", _row(heads), _row(["---"] * 3 + ["---:"] * (len(heads) - 3))]
        for i, line in enumerate(first):
            texts = [line.row, line.column, line.unit, line.paper]
            for found in by_plant.values():
                own = found[table][i]
                texts += [own.as_printed_spread, f"{own.best_spread} {own.met}"]
                texts += [own.bound] if has_bound else []
            parts.append(_row(texts))
        parts.append("")
    said = [f"- {plant}: {_cell_text(n)}" for plant, of in result.cells.items() for n in notes(of)]
    return [*parts, *said, ""]


def conditions(paper: Paper) -> list[tuple[str, ...]]:
    """Name and description of each drive."""
    return [(c.name, c.title) for c in paper.conditions]


def _row(texts: Sequence[str]) -> str:
    return "| " + " | ".join(_cell_text(t) for t in texts) + " |"


def _cell_text(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
