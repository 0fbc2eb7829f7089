"""The report's map: where the car went, coloured by the road's grade."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roadstate.core import Estimates, Log
from roadstate.core.constants import EARTH_RADIUS
from roadstate.metrics import presented
from roadstate.report import backend, style
from roadstate.report.downsample import select
from roadstate.report.figures import Panel, plain
from roadstate.report.plots import Curve, draw_curve

Array = NDArray[np.float64]

_HEIGHT, _WIDEST = 460, 1500  # px


def local_metres(latitude: Array, longitude: Array) -> tuple[Array, Array]:
    """East and north of the first fix on a local equirectangular projection.

    Args:
        latitude: (N,) deg, finite.
        longitude: (N,) deg, finite; may cross the date line.

    Returns:
        East and north, each (N,) m.
    """
    turned = (longitude - longitude[0] + 180.0) % 360.0 - 180.0
    east = EARTH_RADIUS * math.cos(math.radians(float(latitude[0]))) * np.radians(turned)
    return east, EARTH_RADIUS * np.radians(latitude - latitude[0])


def track_panel(log: Log, name: str, estimates: Estimates | None, points: int) -> Panel | None:
    """The track in local metres, equal scale on both axes, nothing fetched from the net.

    Args:
        log: has ``latitude`` and ``longitude``; otherwise there is no panel.
        name: the estimator whose grade colours the track.
        estimates: its result; without a grade the track is drawn in one colour.
        points: fixes drawn; each stands for the steepest of its bin.
    """
    if not {"latitude", "longitude"} <= log.available:
        return None
    latitude, longitude = log["latitude"], log["longitude"]
    somewhere = (latitude != 0) | (longitude != 0)  # receivers without a fix report 0, 0
    fixes = np.flatnonzero(np.isfinite(latitude) & np.isfinite(longitude) & somewhere)
    if len(fixes) < 2:
        return None
    east, north = local_metres(latitude[fixes], longitude[fixes])
    time = log.time[fixes]
    grade = estimates.values.get("grade") if estimates is not None else None
    slope = None if grade is None else presented("grade", grade[fixes])
    chosen = select(time, np.zeros(len(fixes)) if slope is None else np.nan_to_num(slope), points)
    shade = None if slope is None else Shade("grade", chosen.take(slope), "%", 0.5)
    plot = map_figure(chosen.take(east), chosen.take(north), time[chosen.index], shade)
    coloured = f", coloured by the grade [%] that {name} estimates"
    return Panel("Track" + (coloured if shade else ""), plot)


@dataclass(frozen=True)
class Shade:
    """What colours a track: values about zero.

    Attributes:
        label: told with a value when one points at it.
        values: (N,) in ``unit``, NaN where missing.
        unit: of the values.
        least: reach of the colours, at least.
    """

    label: str
    values: Array
    unit: str
    least: float


def map_figure(
    east: Array, north: Array, time: Array, shade: Shade | None, *, beside: Sequence[Curve] = ()
) -> Any:
    """A track with its start and end, of equal scale on both axes.

    Args:
        east, north: (N,) m, NaN where the pen is lifted.
        time: (N,) s.
        shade: what colours it; one colour without.
        beside: other lines on the map, m.
    """
    models = backend.models()
    # no wider and no higher than the track needs at equal scale, so that the map is not mostly empty
    extent = [float(np.nanmax(v) - np.nanmin(v)) for v in (east, north)]
    width = 260 + (_HEIGHT - 110) * extent[0] / max(extent[1], 1.0)
    height = 110 + (_WIDEST - 260) * 1.3 * extent[1] / max(extent[0], 1.0)
    plot = backend.load("bokeh.plotting").figure(
        height=int(min(max(height, 230), _HEIGHT)),
        max_width=int(min(max(width, 640), _WIDEST)),
        sizing_mode="stretch_width",
        match_aspect=True,
        tools="pan,box_zoom,reset,save",
        active_drag="pan",
        toolbar_location="right",
        min_border_left=116,
        x_axis_label="east [m]",
        y_axis_label="north [m]",
    )
    backend.place_tools(plot, models.WheelZoomTool())
    data = {k: v.astype(np.float32) for k, v in (("x", east), ("y", north), ("t", time))}
    if shade is not None:
        data["shade"] = shade.values.astype(np.float32)
    source = backend.source(data)
    plot.line("x", "y", source=source, line_color="#9A9A9A", line_width=1.5)
    tips = [("time", "@t{0.0} s"), ("east, north", "@x{0} m, @y{0} m")]
    if shade is not None:
        seen = np.abs(shade.values[np.isfinite(shade.values)])
        reach = max(float(np.percentile(seen, 99)) if len(seen) else 0.0, shade.least)
        mapper = models.LinearColorMapper(list(style.SLOPES), low=-reach, high=reach)
        fill = {"field": "shade", "transform": mapper}
        dots = plot.scatter("x", "y", source=source, size=6, line_color=None, fill_color=fill)
        plot.add_layout(models.ColorBar(color_mapper=mapper, width=14), "right")
        tips.insert(0, (shade.label, f"@shade{{0.00}} {shade.unit}"))
    else:
        dots = plot.scatter("x", "y", source=source, size=4, color=style.ESTIMATORS[0])
    plot.add_tools(models.HoverTool(renderers=[dots], tooltips=tips, visible=False))
    items = []
    for curve in beside:
        line = draw_curve(plot, curve)
        items.append(models.LegendItem(label=plain(curve.label), renderers=[line]))
    seen_at = np.flatnonzero(np.isfinite(east))
    look = {"size": 12, "fill_color": "#FFFFFF", "line_color": style.TEXT, "line_width": 2}
    for k, label, marker in ((seen_at[0], "start", "triangle"), (seen_at[-1], "end", "square")):
        place = plot.scatter([float(east[k])], [float(north[k])], marker=marker, **look)
        items.append(models.LegendItem(label=label, renderers=[place]))
    plot.add_layout(models.Legend(items=items, orientation="horizontal", location="top_left"), "above")
    return plot
