"""The figures as tables: on the screen and as Markdown."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping
from importlib import metadata
from typing import Any

from benchmarks.machine import processor
from benchmarks.peers.implementations import LIBRARIES
from benchmarks.peers.measure import Row
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

Results = Mapping[str, Mapping[str, Row]]
"""Problem → implementation → figures."""

_TITLES = {
    "tfobe-lower-ukf": "TFOBE's lower layer: unscented Kalman filter, 15 states, 7 sensors",
    "friction-ukf": "Friction of four wheels: unscented Kalman filter, 4 states, 3 sensors",
    "friction-pf-1000": "Friction of four wheels: 1000 particles, systematic resampling at each step",
    "kf-2": "Grade: Kalman filter, 2 states, 1 sensor",
}
_COLUMNS = (
    "implementation",
    "µs a step",
    "least",
    "CPU, µs",
    "× C",
    "p99, µs",
    "first, s",
    "max. diff.",
    "samples × logs",
)
_SHOWN = tuple(c for c in _COLUMNS[1:] if c not in ("least", "samples × logs"))
"""What a terminal of 80 columns has room for."""


def show(results: Results, console: Console) -> None:
    """A table for each problem, quickest first."""
    for problem, rows in results.items():
        table = Table(box=SIMPLE, padding=0, title=_TITLES[problem], title_justify="left", title_style="bold")
        table.add_column("implementation", no_wrap=True)
        for column in _SHOWN:
            table.add_column(column, justify="right", min_width=7 if "diff" in column else 6)
        for name, row in _sorted(rows):
            cells = dict(zip(_COLUMNS[1:], _cells(row), strict=True))
            table.add_row(name, *(cells[column] for column in _SHOWN))
        console.print(table)
        for note in _notes(rows):
            console.print(note, highlight=False, markup=False)
        console.print()


def markdown(results: Results, repeats: int, command: str) -> str:
    """The same as a page."""
    lines = [
        "# The same filters elsewhere",
        "",
        f"`{command}` on {os.cpu_count()} cores ({processor()}), {_versions()}.",
        "",
        "Every implementation is given the same system, noises, prior and log; unscented filters the same "
        "points (α = 1, β = 2, κ = 0). Compiled loops, other libraries and C take turns, "
        f"{repeats} rounds of them; a figure is the median of all calls, per sample and log, and its "
        "ratio to C the median over the rounds, least call to least call. `CPU` is the time of all "
        "threads. `first` is the first call, which includes compiling, without a cache on disk. `max. "
        "diff.` is the greatest difference of any mean "
        "from a plain loop over the textbook's equations in NumPy, in SI units of the states.",
        "",
    ]
    for problem, rows in results.items():
        lines += [f"## {_TITLES[problem]}", "", "| " + " | ".join(_COLUMNS) + " |"]
        lines.append("|---|" + "---:|" * (len(_COLUMNS) - 1))
        lines += [f"| {name} | " + " | ".join(_cells(row)) + " |" for name, row in _sorted(rows)]
        notes = _notes(rows)
        lines += ["", *(f"- {note}" for note in notes), ""] if notes else [""]
    return "\n".join(lines)


def _sorted(rows: Mapping[str, Row]) -> list[tuple[str, Row]]:
    last = float("inf")
    return sorted(rows.items(), key=lambda item: item[1]["us_per_step"] or last)


def _cells(row: Row) -> list[str]:
    figures = [row.get(key) for key in ("us_per_step", "us_per_step_min", "cpu_us_per_step")]
    ratio, p99, diff = row.get("ratio_to_c"), row.get("p99_us"), row["max_abs_diff"]
    return [
        *map(_number, figures),
        _number(ratio),
        _number(p99),
        _number(row["first_call_s"]),
        "–" if diff is None else f"{diff:.1e}",
        f"{row['steps']} × {row['logs']}" if "steps" in row else "–",
    ]


def _number(value: Any) -> str:
    if value is None:
        return "–"
    return f"{value:.0f}" if value >= 100 else f"{value:.{3 if value >= 0.1 else 2}g}"


def _notes(rows: Mapping[str, Row]) -> list[str]:
    notes = [f"{name}: {row[key]}" for name, row in rows.items() for key in ("note", "why_not") if key in row]
    drawn = [row["sampling_error"] for row in rows.values() if "sampling_error" in row]
    if drawn:
        notes.append(
            "differences are from very many particles and are chance: the greatest of ten runs of the plain "
            f"loop with as many particles as are timed is {drawn[0]:.1e}"
        )
    return notes


def _versions() -> str:
    found = [f"Python {platform.python_version()}"]
    for name in ("roadstate", "jax", "numpy", *LIBRARIES):
        try:
            found.append(f"{name} {metadata.version(name)}")
        except metadata.PackageNotFoundError:
            continue
    return ", ".join(found)
