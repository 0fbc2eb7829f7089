"""One HTML file from sections of figures and tables, that opens without a network."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from roadstate.core.tabular import atomic_path
from roadstate.report import style
from roadstate.report.backend import components, load
from roadstate.report.figures import Panel
from roadstate.report.tables import Table


@dataclass(frozen=True)
class Section:
    """A heading of the page with its panels and tables.

    Attributes:
        key: target of the link to it.
        heading: its title.
        panels: figures, above the tables.
        tables: with their own headings where there are several.
        intro: a sentence above all.
        columns: figures beside each other on a wide screen.
    """

    key: str
    heading: str
    panels: list[Panel] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    intro: str = ""
    columns: int = 1


def write_document(
    path: str | Path,
    *,
    title: str,
    sentences: Sequence[str],
    headline: Table | None,
    sections: Sequence[Section],
    hints: str,
) -> Path:
    """Write the page; all text is escaped, and the page forbids itself to load anything.

    Args:
        path: file to write; it appears whole or not at all.
        title: heading.
        sentences: below it.
        headline: a table before all sections.
        sections: in this order; those with neither figure nor table are left out.
        hints: how to use the figures, at the end.

    Raises:
        InputError: Bokeh is not installed, or the path cannot be written.
    """
    bokeh_files = load("bokeh.resources")
    markup = load("markupsafe").Markup
    shown = [s for s in sections if s.panels or s.tables]
    panels = [p for s in shown for p in s.panels]
    script, divs = components([p.figure for p in panels], style.theme())
    drawn = {id(panel): markup(div) for panel, div in zip(panels, divs, strict=True)}
    here = resources.files(__package__)
    html = _template(here.joinpath("page.html").read_text("utf-8")).render(
        title=title,
        sentences=sentences,
        headline=headline,
        sections=shown,
        figure_of=lambda panel: drawn[id(panel)],
        css=markup(here.joinpath("page.css").read_text("utf-8")),
        bokeh=markup(bokeh_files.Resources(mode="inline", components=["bokeh"]).render_js()),
        script=markup(script),
        hints=hints,
        written=datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
    )
    with atomic_path(path) as temporary:
        temporary.write_text(html, "utf-8")
    return Path(path)


def _template(text: str) -> Any:
    """A template that escapes whatever is put into it."""
    jinja2 = load("jinja2")
    return jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    ).from_string(text)
