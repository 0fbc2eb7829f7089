"""A still figure of one quantity for documents."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roadstate.core import Estimates, InputError, Log
from roadstate.core import reference as reference_of
from roadstate.core.tabular import atomic_path
from roadstate.metrics import check_time, presented, presented_unit
from roadstate.report import backend, style
from roadstate.report.downsample import envelope, select
from roadstate.report.panels import band, has_bounds, spread
from roadstate.report.view import unit_label, view_limits

Array = NDArray[np.float64]

_POINTS = 4000


def static_figure(
    path_png: str | Path, log: Log, results: Mapping[str, Estimates], quantity: str = "grade"
) -> Path:
    """Draw estimates of a quantity with their bands over the reference and, if there is one, errors below.

    Args:
        path_png: PNG file to write; it appears whole or not at all.
        log: (T,) with the references that the quantity has.
        results: estimator name → estimates on the log's time base; those without the quantity are left out.
        quantity: what to draw.

    Raises:
        InputError: matplotlib is not installed, no result has the quantity, or the time bases differ.
    """
    given = {name: e for name, e in results.items() if quantity in e.values}
    if not given:
        raise InputError(f"no estimator gives '{quantity}' to draw", mend="choose one that does")
    for estimates in given.values():
        check_time(estimates, log)
    reference = reference_of(quantity, log.channels)
    truth = presented(quantity, reference) if reference is not None and np.isfinite(reference).any() else None
    rows = 1 if truth is None else 2
    size = (9.0, 1.8 + 1.8 * rows)
    figure = backend.load("matplotlib.figure").Figure(figsize=size, dpi=150, layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False, height_ratios=[2.2, 1][:rows])[:, 0]
    upper_panel = _Drawing(axes[0], log.time)
    lower_panel = _Drawing(axes[-1], log.time)
    if truth is not None:
        upper_panel.line(truth, style.REFERENCE, 1.8, "reference")
        axes[1].axhline(0, color="#7A7A7A", lw=0.8)
    for i, (name, estimates) in enumerate(given.items()):
        color, values = style.estimator_color(i), presented(quantity, estimates.values[quantity])
        lower, upper = band(quantity, estimates)
        upper_panel.band(lower, upper, color)
        upper_panel.line(values, color, 1.2, name + spread(quantity, estimates))
        if truth is not None:
            lower_panel.band(values - upper, values - lower, color)
            lower_panel.line(values - truth, color, 1.0)
    unit, least = unit_label(presented_unit(quantity)), 0.5 if quantity == "grade" else 0.0
    is_bounded = any(has_bounds(quantity, e) for e in given.values())
    upper_panel.finish(f"{quantity.replace('_', ' ')} [{unit}]", least, is_bounded)
    axes[0].legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=4, frameon=False, borderaxespad=0.2)
    if truth is not None:
        lower_panel.finish(f"error [{unit}]", least, is_bounded)
    axes[-1].set_xlabel("time [s]")
    with atomic_path(path_png) as temporary:
        figure.savefig(temporary, format="png")
    return Path(path_png)


class _Drawing:
    """One panel, and the heights of what is on it."""

    def __init__(self, axis: Any, time: Array) -> None:
        self.axis = axis
        self.time = time
        self.lines: list[Array] = []
        self.bands: list[Array] = []

    def line(self, values: Array, color: str, width: float, label: str = "") -> None:
        chosen = select(self.time, values, _POINTS)
        y = chosen.take(values)
        text = label.replace("$", r"\$")  # a name is never TeX
        self.axis.plot(self.time[chosen.index], y, color=color, lw=width, label=text or None)
        self.lines.append(y)

    def band(self, lower: Array, upper: Array, color: str) -> None:
        x, y = envelope(self.time, lower, upper, _POINTS // 2)
        lifts = np.flatnonzero(np.isnan(x))
        for xs, ys in zip(np.split(x, lifts), np.split(y, lifts), strict=True):
            inside = np.isfinite(xs)
            self.axis.fill(xs[inside], ys[inside], color=color, alpha=0.18, lw=0)
        self.bands.append(y)

    def finish(self, label: str, least: float, is_bounded: bool) -> None:
        lines, bands = np.concatenate(self.lines), np.concatenate(self.bands)
        lines, bands = lines[np.isfinite(lines)], bands[np.isfinite(bands)]
        if len(lines):
            self.axis.set_ylim(*view_limits(lines, bands, at_least=least, with_bands=is_bounded))
        self.axis.set_ylabel(label)
        self.axis.grid(color="#E4E4E4", lw=0.8)
        self.axis.set_axisbelow(True)
        self.axis.spines[["top", "right"]].set_visible(False)
        self.axis.margins(x=0.01)
