"""Panels of a simulated drive by place: the track, the path, friction circles."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from roadstate.core import WHEELS
from roadstate.report import backend, style
from roadstate.report.downsample import Selection, select
from roadstate.report.figures import Drawn, Panel, set_view
from roadstate.report.plots import Curve, xy_figure
from roadstate.report.track import Shade, map_figure
from roadstate.sim.facts import force_over_load, off_path
from roadstate.sim.roads.friction import FrictionMap
from roadstate.sim.roads.road import Road
from roadstate.sim.run import Drive

Array = NDArray[np.float64]

_POINTS = 3000  # of a track
_CELL = 0.02  # of a friction circle's plane
# after ColorBrewer's Blues, from a tone that a single sample is still seen in
_SHADES = ("#A6CBE3", "#85BCDB", "#6BAED6", "#4292C6", "#2171B5", "#08519C", "#08306B")
_GROUNDS = ("#B8C4CC", "#C7D0D6", "#D5DCE0", "#E3E8EB", "#F2F4F5")  # slippery … grippy
_DECIMALS = 5  # of a place, m; what a straight road leaves is rounding
_LEAST = 0.05  # m off to either side that a figure shows, at least
_SQUARE = 380  # px
_LEFT = 116  # px left of a figure, as that of the track
_NAMES = dict(zip(WHEELS, ("Front left", "Front right", "Rear left", "Rear right"), strict=True))
_MOST_CIRCLES = 3
_SEEN = 0.02  # share of the drive for which a wheel is on a friction that gets a circle


def track_panels(driven: Drive) -> list[Panel]:
    """The track from above, and the distance from centreline and path over the way."""
    time = np.asarray(driven.time, np.float64)
    truth, apart = driven.truth, np.round(off_path(driven), _DECIMALS)
    east, north = (np.asarray(truth.position, np.float64)[:, k] for k in (0, 1))
    s, d = (np.round(np.asarray(truth.road, np.float64)[:, k], _DECIMALS) for k in (0, 1))
    is_steered = np.isfinite(apart)
    chosen = select(time, np.where(is_steered, apart, 0.0), _POINTS)
    beside, shade, heading = [], None, "Track, seen from above"
    wanted = np.where(is_steered, d - apart, np.nan)
    if is_steered.any():
        x, y = _place(driven, chosen.take(s), chosen.take(wanted))
        beside = [Curve("path to follow", x, y, style.REFERENCE, "dashed", 1.2)]
        shade = Shade("left of the path", chosen.take(apart), "m", 0.05)
        heading += ", coloured by the distance to the left of the path [m]"
    plot = map_figure(chosen.take(east), chosen.take(north), time[chosen.index], shade, beside=beside)
    return [Panel(heading, plot), *_over_way(driven, chosen, wanted, apart)]


def _over_way(driven: Drive, chosen: Selection, wanted: Array, apart: Array) -> list[Panel]:
    s, d = (np.round(np.asarray(driven.truth.road, np.float64)[:, k], _DECIMALS) for k in (0, 1))
    way, x_label = chosen.take(s), "s along the centreline [m]"
    lines = [Curve("centre of gravity", way, chosen.take(d), style.LINES[0], width=1.8)]
    is_steered = np.isfinite(apart).any()
    if is_steered:
        lines.append(Curve("path to follow", way, chosen.take(wanted), style.REFERENCE, "dashed", 1.4))
    plot = xy_figure(lines, x_label, "d to the left [m]", height=260)
    plot.min_border_left = _LEFT
    note = _ground(plot, driven, s, d)
    if not note:
        set_view(plot, _heights(chosen.take(d), chosen.take(wanted)), at_least=_LEAST)
    panels = [Panel("Distance from the centreline; the scales differ", plot, note)]
    if is_steered:
        off = Curve("off the path", way, chosen.take(apart), style.LINES[1], width=1.6)
        plot = xy_figure([off], x_label, "off [m]", height=200)
        plot.min_border_left = _LEFT
        set_view(plot, _heights(chosen.take(apart)), at_least=_LEAST)
        panels.append(Panel("Distance to the left of the path", plot))
    return panels


def _heights(*lines: Array) -> Drawn:
    joined = np.concatenate(lines)
    return Drawn(joined[np.isfinite(joined)], np.zeros(0))


def _place(driven: Drive, s: Array, d: Array) -> tuple[Array, Array]:
    """East and north of places along the road, NaN where there is none."""
    at = (jnp.asarray(np.nan_to_num(v)) for v in (s, d))
    point = eqx.filter_jit(Road.at)(driven.manoeuvre.road, *at)
    nowhere = ~(np.isfinite(s) & np.isfinite(d))
    x, y = (np.where(nowhere, np.nan, np.asarray(v, np.float64)) for v in (point.x, point.y))
    return x, y


def _ground(plot: Any, driven: Drive, s: Array, d: Array) -> str:
    """Shade the road by its friction where that changes; returns a note that says so, or nothing."""
    margin = 1.5
    along = np.linspace(s.min() - 2, s.max() + 2, 500)
    across = np.linspace(d.min() - margin, d.max() + margin, 80)
    s_at, d_at = (jnp.asarray(v) for v in np.meshgrid(along, across))
    friction = np.asarray(
        eqx.filter_jit(FrictionMap.at)(driven.manoeuvre.road.friction, s_at, d_at), np.float32
    )
    low, high = float(friction.min()), float(friction.max())
    if high - low < 1e-3:
        return ""
    models = backend.models()
    mapper = models.LinearColorMapper(list(_GROUNDS), low=low, high=high)
    box = {"x": along[0], "y": across[0], "dw": np.ptp(along), "dh": np.ptp(across)}
    plot.image([friction], **box, color_mapper=mapper, level="image")
    plot.add_layout(models.ColorBar(color_mapper=mapper, width=12, title="μ"), "right")
    return "Shaded: the friction of the road."


def circle_panels(driven: Drive) -> list[Panel]:
    """Each wheel's force over its load, in the wheel's frame as seen from above, and how long it stays."""
    along, across = force_over_load(driven.truth)
    step = float(driven.time[1] - driven.time[0])
    there = np.asarray(driven.truth.friction, np.float64)
    reach = 1.08 * max(float(np.nanmax(there)), float(np.nanmax(np.hypot(along, across))))
    found = [_cells(across[:, k], along[:, k]) for k in range(len(WHEELS))]
    longest = max(float(step * count.max()) for _, _, count in found)
    models = backend.models()
    panels = []
    for k, wheel in enumerate(WHEELS):
        levels = _frictions(there[:, k])
        turn = np.linspace(0, 2 * np.pi, 181)
        circles = [
            Curve(f"μ = {mu:.2f}", mu * np.cos(turn), mu * np.sin(turn), color, dash, 1.6)
            for mu, color, dash in zip(
                levels,
                (style.LINES[1], style.LINES[3], style.LINES[5]),
                ("solid", "dashed", "dotted"),
                strict=False,
            )
        ]
        plot = xy_figure(circles, "F_y / F_z, positive to the left [-]", "F_x / F_z [-]")
        # a square, so that circles are circles
        plot.update(sizing_mode=None, height=None, frame_width=_SQUARE, frame_height=_SQUARE)
        plot.x_range, plot.y_range = models.Range1d(reach, -reach), models.Range1d(-reach, reach)
        mapper = models.LogColorMapper(list(_SHADES), low=step, high=max(longest, 2 * step))
        x, y, count = found[k]
        data = {"x": x, "y": y, "t": (step * count).astype(np.float32)}
        fill = {"field": "t", "transform": mapper}
        cells = plot.rect(
            "x",
            "y",
            _CELL,
            _CELL,
            source=backend.source(data),
            fill_color=fill,
            line_color=fill,
            line_width=0.5,
        )
        tips = [("F_y/F_z, F_x/F_z", "@x{0.00}, @y{0.00}"), ("for", "@t{0.000} s")]
        plot.add_tools(models.HoverTool(renderers=[cells], tooltips=tips, visible=False))
        seconds = models.NumeralTickFormatter(format="0.[000]")
        bar = models.ColorBar(color_mapper=mapper, width=12, title="time [s]", formatter=seconds)
        plot.add_layout(bar, "right")
        panels.append(Panel(_NAMES[wheel], plot))
    return panels


def _cells(x: Array, y: Array) -> tuple[Any, Any, NDArray[np.intp]]:
    """Centres of the cells that are visited, and for how many samples."""
    there = np.isfinite(x) & np.isfinite(y)
    cell = np.round(np.stack([x[there], y[there]], axis=1) / _CELL).astype(np.int64)
    places, count = np.unique(cell, axis=0, return_counts=True)
    centres = (_CELL * places).astype(np.float32)
    return centres[:, 0], centres[:, 1], count


def _frictions(mu: Array) -> list[float]:
    """The frictions that a wheel was on for long, the largest first."""
    levels, count = np.unique(np.round(mu, 2), return_counts=True)
    usual = np.argsort(count)[::-1][:_MOST_CIRCLES]
    kept = [k for k in usual if count[k] >= _SEEN * len(mu)] or [usual[0]]
    return sorted((float(levels[k]) for k in kept), reverse=True)
