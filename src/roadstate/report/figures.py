"""Time figures that pan, zoom and point together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roadstate.report import backend
from roadstate.report.downsample import envelope, select
from roadstate.report.view import out_of_view, view_limits

Array = NDArray[np.float64]

_SIDES = ("right", "left", "above", "below")  # of the pointer, so that the lines' read-outs do not overlap


@dataclass(frozen=True)
class Panel:
    """One figure of the page with what stands above and below it.

    Attributes:
        heading: what is drawn.
        figure: the Bokeh figure.
        note: a remark below; empty for none.
    """

    heading: str
    figure: Any
    note: str = ""


SPREADS = (" ± 2σ", ", 5 to 95 %")
"""What a name in a legend says of the band around its line: by a standard deviation, or by bounds."""


@dataclass(frozen=True)
class Trace:
    """One line of a figure, and the values behind it.

    Attributes:
        label: name in the legend.
        values: (T,) in the figure's unit, NaN where missing.
        color: CSS colour.
        half_width: (T,) optional; told beside the value when one points at it.
        lower, upper: (T,) optional limits of a band around the line.
        width: px.
        dash: Bokeh's dash pattern.
        alpha: opacity of the line.
        outline: CSS colour of the band's limits, drawn over all lines; empty for none.
    """

    label: str
    values: Array
    color: str
    half_width: Array | None = None
    lower: Array | None = None
    upper: Array | None = None
    width: float = 1.6
    dash: str = "solid"
    alpha: float = 1.0
    outline: str = ""


@dataclass(frozen=True)
class Drawn:
    """What :meth:`TimeAxes.draw` put on a figure, thinned out: heights of the lines, and of the bands."""

    lines: Array
    bands: Array


class TimeAxes:
    """What the time figures of one page share: the range, the crosshair and how finely lines are drawn.

    Args:
        time: (T,) s, the log's.
        points: samples drawn of one line.
    """

    def __init__(self, time: Array, points: int) -> None:
        start, stop = float(time[0]), float(time[-1])
        pad = 0.01 * (stop - start) or 0.5
        self.time = time
        self.points = points
        self.x_range = backend.models().Range1d(
            start - pad, stop + pad, bounds=(start - 10 * pad, stop + 10 * pad)
        )
        self.crosshair = backend.models().Span(
            dimension="height", line_color="#7A7A7A", line_width=1, line_dash="dotted"
        )
        # float32 halves the file; an epoch as time base does not fit into it
        fits = np.spacing(np.float32(max(abs(start), abs(stop)))) <= 1e-6 * (stop - start)
        self.time_type = np.float32 if fits else np.float64

    def figure(self, y_label: str, height: int, **options: Any) -> Any:
        """An empty figure on the shared time axis; ``height`` in px."""
        plot = backend.load("bokeh.plotting").figure(
            height=height,
            sizing_mode="stretch_width",
            x_range=self.x_range,
            tools="xpan,auto_box_zoom,yzoom_out,reset,save",
            active_drag="auto_box_zoom",
            toolbar_location="right",
            min_border_left=116,
            min_border_right=20,
            min_border_bottom=8,
            x_axis_label="time [s]",
            y_axis_label=y_label,
            **options,
        )
        backend.place_tools(plot, backend.models().WheelZoomTool(dimensions="width"))
        plot.add_tools(backend.models().CrosshairTool(overlay=self.crosshair))
        if "y_range" not in options:
            plot.yaxis.ticker.desired_num_ticks = max(3, height // 45)
        plot.xaxis.ticker.desired_num_ticks = 10
        return plot

    def draw(self, plot: Any, traces: Sequence[Trace], unit: str, *, slope: bool = False) -> Drawn:
        """Draw bands, then lines over them, with one legend entry for each trace above the plot.

        Args:
            plot: a figure of :meth:`figure`.
            traces: what to draw.
            unit: told with a value when one points at it.
            slope: values are slopes in %, to be told as angles too.
        """
        heights: dict[str, list[Array]] = {"lines": [], "bands": []}
        renderers = []
        for trace, side in zip(traces, cycle(_SIDES), strict=False):
            lines = self._line(plot, trace, heights["lines"])
            plot.add_tools(_hover(trace, lines[:1], side, unit, slope))
            renderers.append(lines + self._band(plot, trace, heights["bands"]))
        for trace, own in zip(traces, renderers, strict=True):
            if trace.outline:  # over all lines, which would hide it where they are dense
                edge = {"line_color": trace.outline, "fill_alpha": 0.0, "line_width": 1.1}
                own.append(plot.patch("x", "y", source=own[-1].data_source, **edge))
        models = backend.models()
        items = [
            models.LegendItem(label=plain(t.label), renderers=own)
            for t, own in zip(traces, renderers, strict=True)
        ]
        look = {"orientation": "horizontal", "click_policy": "hide", "location": "top_left"}
        plot.add_layout(models.Legend(items=items, ncols=min(len(items), 4), **look), "above")
        return Drawn(_finite(heights["lines"]), _finite(heights["bands"]))

    def mark(self, plot: Any, level: float, *, dash: str = "dashed", color: str = "#7A7A7A") -> None:
        """A horizontal line across the plot."""
        style = {"line_color": color, "line_dash": dash, "line_width": 1}
        plot.add_layout(backend.models().Span(location=level, dimension="width", **style))

    def _line(self, plot: Any, trace: Trace, heights: list[Array]) -> list[Any]:
        chosen = select(self.time, trace.values, self.points)
        y = chosen.take(trace.values)
        heights.append(y)
        data = {"x": self.time[chosen.index].astype(self.time_type), "y": _compact(y)}
        if trace.half_width is not None:
            data["half"] = _compact(chosen.take(trace.half_width))
        style = {"line_color": trace.color, "line_width": trace.width, "line_alpha": trace.alpha}
        lines = [plot.line("x", "y", source=backend.source(data), line_dash=trace.dash, **style)]
        if len(chosen.lone):
            x, y = self.time[chosen.lone], trace.values[chosen.lone]
            dots = {"x": x.astype(self.time_type), "y": _compact(y)}
            lines.append(plot.scatter("x", "y", source=backend.source(dots), size=3, color=trace.color))
        return lines

    def _band(self, plot: Any, trace: Trace, heights: list[Array]) -> list[Any]:
        if trace.lower is None or trace.upper is None:
            return []
        x, y = envelope(self.time, trace.lower, trace.upper, self.points // 2)
        heights.append(y)
        data = {"x": x.astype(self.time_type), "y": _compact(y)}
        look = {"color": trace.color, "fill_alpha": 0.18, "line_alpha": 0.35, "line_width": 0.5}
        return [plot.patch("x", "y", source=backend.source(data), level="image", **look)]


def set_view(plot: Any, drawn: Drawn, *, at_least: float = 0.0, with_bands: bool = False) -> str:
    """Set the vertical range by :func:`view_limits`; returns a note of what lies out of view, or nothing.

    Args:
        plot: the figure.
        drawn: on it.
        at_least, with_bands: as there.
    """
    if len(drawn.lines) == 0:
        return ""
    low, high = view_limits(drawn.lines, drawn.bands, at_least=at_least, with_bands=with_bands)
    plot.y_range = backend.models().Range1d(low, high)
    return out_of_view(drawn.lines, low, high)


def plain(text: str) -> str:
    """A name as Bokeh should show it: never as TeX, for which it would look for a script on the net."""
    for mark in ("$$", "\\[", "\\("):
        text = text.replace(mark, "\u200b".join(mark))
    return text


def _hover(trace: Trace, renderers: list[Any], side: str, unit: str, slope: bool) -> Any:
    models = backend.models()
    label = plain(trace.label.removesuffix(SPREADS[0]).removesuffix(SPREADS[1]))
    value, half = ("@y{number}", "@half{0.00}") if slope else ("@y{0.[0000]}", "@half{0.[0000]}")
    text = value if trace.half_width is None else f"{value} ± {half}"
    text += "" if unit == "-" else f" {unit}"
    text += " (@y{degrees}°)" if slope else ""
    if side == _SIDES[0]:  # once is enough, and keeps the read-outs one line high
        text += " at @x{0.000} s"
    hover = models.HoverTool(
        renderers=renderers, tooltips=[(label, text)], mode="vline", attachment=side, visible=False
    )
    if slope:
        angle = "Math.atan(value / 100) * 180 / Math.PI"
        code = f"return (format == 'degrees' ? {angle} : value).toFixed(2)"
        hover.formatters = {"@y": models.CustomJSHover(code=code)}
    return hover


def _compact(values: Array) -> NDArray[np.floating[Any]]:
    """Single precision, which halves the file, unless that would show as steps (longitudes, epochs)."""
    finite = values[np.isfinite(values)]
    if len(finite) == 0:
        return values.astype(np.float32)
    largest, extent = float(np.max(np.abs(finite))), float(np.ptp(finite))
    is_constant = extent <= 1e-9 * largest  # but for rounding
    if largest > 3e38 or (not is_constant and np.spacing(np.float32(largest)) > 1e-4 * extent):
        return values
    return values.astype(np.float32)


def _finite(parts: Sequence[Array]) -> Array:
    joined = np.concatenate(parts) if parts else np.zeros(0)
    return joined[np.isfinite(joined)]
