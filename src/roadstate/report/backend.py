"""Bokeh, imported when first drawn with.

Its type information contradicts itself between versions and refuses valid calls, so it comes as ``Any``.
"""

from __future__ import annotations

import importlib
from typing import Any

from roadstate.core import InputError


def models() -> Any:
    """``bokeh.models``."""
    return load("bokeh.models")


def load(module: str) -> Any:
    """A module of the ``report`` extra.

    Raises:
        InputError: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise InputError(
            f"{package} is not installed, which reports need",
            mend="install roadstate[report]: pip install 'roadstate[report]'",
        ) from error


def source(data: dict[str, Any]) -> Any:
    """A ``ColumnDataSource`` of equally long columns."""
    return models().ColumnDataSource(data)


def components(figures: list[Any], theme: dict[str, Any]) -> tuple[str, tuple[str, ...]]:
    """The script that draws the figures, and the element to put in the page for each.

    Args:
        figures: of one page, so that they can share ranges.
        theme: as ``bokeh.themes.Theme`` takes it.
    """
    document = load("bokeh.document").Document(theme=load("bokeh.themes").Theme(json=theme))
    with document.models.freeze():  # otherwise all models are gathered anew for each figure
        for figure in figures:
            document.add_root(figure)
    script, divs = load("bokeh.embed").components(tuple(figures))
    return script, divs


def place_tools(plot: Any, wheel: Any) -> None:
    """A quiet toolbar whose wheel zoom needs Ctrl, so that the wheel alone still scrolls the page."""
    wheel.modifiers = {"ctrl": True}
    plot.add_tools(wheel)
    plot.toolbar.active_scroll = wheel
    plot.toolbar.logo = None
    plot.toolbar.autohide = True
