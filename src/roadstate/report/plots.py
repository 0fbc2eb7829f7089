"""Figures whose abscissa is not the log's time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roadstate.report import backend
from roadstate.report.figures import plain

Array = NDArray[np.float64]

_ENTRIES_IN_ROW = 6  # of a legend


@dataclass(frozen=True)
class Curve:
    """A line with its own abscissa; curves of one label share a legend entry.

    Attributes:
        label: name in the legend.
        x, y: (N,) in the figure's units.
        color: CSS colour.
        dash: Bokeh's dash pattern.
        width: px.
    """

    label: str
    x: Array
    y: Array
    color: str
    dash: str = "solid"
    width: float = 2.0


def xy_figure(curves: Sequence[Curve], x_label: str, y_label: str, *, height: int = 340) -> Any:
    """A figure of curves with a legend above and their values under the pointer.

    Args:
        curves: drawn in this order; (N,) each.
        x_label, y_label: names with units in brackets.
        height: px.
    """
    models = backend.models()
    figure = backend.load("bokeh.plotting").figure(
        height=height,
        sizing_mode="stretch_width",
        tools="pan,box_zoom,reset,save",
        active_drag="box_zoom",
        toolbar_location="right",
        min_border_left=70,
        min_border_right=20,
        x_axis_label=x_label,
        y_axis_label=y_label,
    )
    backend.place_tools(figure, models.WheelZoomTool())
    entries: dict[str, list[Any]] = {}
    for curve in curves:
        entries.setdefault(curve.label, []).append(draw_curve(figure, curve))
    for label, lines in entries.items():
        tips = [(plain(label), "@y{0.[000]} at @x{0.[000]}")]
        figure.add_tools(models.HoverTool(renderers=lines, tooltips=tips, visible=False))
    items = [models.LegendItem(label=plain(label), renderers=lines) for label, lines in entries.items()]
    look = {"orientation": "horizontal", "click_policy": "hide", "location": "top_left"}
    figure.add_layout(models.Legend(items=items, ncols=min(len(items), _ENTRIES_IN_ROW), **look), "above")
    for dimension in ("width", "height"):
        zero = {"dimension": dimension, "line_color": "#B0B0B0", "line_width": 1, "level": "underlay"}
        figure.add_layout(models.Span(location=0.0, **zero))
    return figure


def draw_curve(figure: Any, curve: Curve) -> Any:
    """One curve as a line of a figure."""
    with np.errstate(over="ignore"):  # infinity is not drawn
        data = {"x": np.asarray(curve.x, np.float32), "y": np.asarray(curve.y, np.float32)}
    style = {"line_color": curve.color, "line_dash": curve.dash, "line_width": curve.width}
    return figure.line("x", "y", source=backend.source(data), **style)
