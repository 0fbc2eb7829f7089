"""The report's time panels: estimates, errors, innovations, NIS, validity."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import cycle

import numpy as np
from numpy.typing import NDArray

from roadstate.core import QUANTITIES, WHEELS, Estimates, Log, Validity, is_bound
from roadstate.core import reference as reference_of
from roadstate.core.quantities import BOUNDS
from roadstate.metrics import presented, presented_unit
from roadstate.report import backend, style
from roadstate.report.consistency import sensor_consistency, windowed_ratio
from roadstate.report.downsample import runs
from roadstate.report.figures import SPREADS, Panel, TimeAxes, Trace, plain, set_view
from roadstate.report.plots import Curve, xy_figure
from roadstate.report.view import unit_label

Array = NDArray[np.float64]
Results = Mapping[str, Estimates]

_STEEPEST = 1.4  # rad; a band is cut there, before its tangent runs away


def quantities(results: Results) -> list[str]:
    """The quantities to show of those that some estimator gives, grade first.

    Bounds are left to the bands, and a wheel's quantity where its axle's is there.
    """
    given = {q for e in results.values() for q in e.values}
    return [q for q in QUANTITIES if q in given and not is_bound(q) and not _is_within_another(q, given)]


def _is_within_another(quantity: str, given: Collection[str]) -> bool:
    stem, _, wheel = quantity.rpartition("_")
    return wheel in WHEELS and f"{stem}_{'front' if wheel[0] == 'f' else 'rear'}" in given


def has_bounds(quantity: str, estimates: Estimates) -> bool:
    """Whether an estimator gives 5 % and 95 % bounds of the quantity, which then are told instead of σ."""
    return all(quantity + bound in estimates.values for bound in BOUNDS)


def spread(quantity: str, estimates: Estimates) -> str:
    """What the legend says of :func:`band`, one of :data:`~roadstate.report.figures.SPREADS`."""
    return SPREADS[has_bounds(quantity, estimates)]


def band(quantity: str, estimates: Estimates) -> tuple[Array, Array]:
    """Lower and upper limit of an estimate, each (T,), as presented; NaN where there is none.

    Its own bounds where it has some, or else ± 2σ.
    """
    values = estimates.values[quantity]
    if has_bounds(quantity, estimates):
        lower, upper = (estimates.values[quantity + bound] for bound in BOUNDS)
    else:
        two_sigma = 2.0 * estimates.std.get(quantity, np.full_like(values, np.nan))
        lower, upper = values - two_sigma, values + two_sigma
    if quantity == "grade":
        lower, upper = np.clip(lower, -_STEEPEST, _STEEPEST), np.clip(upper, -_STEEPEST, _STEEPEST)
    return presented(quantity, lower), presented(quantity, upper)


def quantity_panels(axes: TimeAxes, quantity: str, results: Results, log: Log) -> list[Panel]:
    """The estimates of one quantity with their bands over the reference, and their errors below."""
    reference = reference_of(quantity, log.channels)
    truth = None if reference is None else presented(quantity, reference)
    unit = unit_label(presented_unit(quantity))
    traces, errors = [], []
    if truth is not None:
        traces.append(Trace("reference", truth, style.REFERENCE, width=2.0))
    for i, (name, estimates) in enumerate(results.items()):
        if quantity not in estimates.values:
            continue
        values, color = presented(quantity, estimates.values[quantity]), style.estimator_color(i)
        lower, upper = band(quantity, estimates)
        half = None if has_bounds(quantity, estimates) else 0.5 * (upper - lower)
        label = name + spread(quantity, estimates)
        traces.append(Trace(label, values, color, half, lower, upper))
        if truth is not None:
            edge = style.darker(color)
            low, high = values - upper, values - lower  # where the error is if the band holds the truth
            error = Trace(label, values - truth, color, half, low, high, 1.2, "solid", 0.8, edge)
            errors.append(error)
    text = QUANTITIES[quantity].description
    short = quantity.replace("_", " ")
    plot = axes.figure(f"{short} [{unit}]", 340)
    is_slope = quantity == "grade"
    drawn = axes.draw(plot, traces, unit, slope=is_slope)
    is_bounded = any(has_bounds(quantity, e) for e in results.values())
    note = set_view(plot, drawn, at_least=0.5 if is_slope else 0.0, with_bands=is_bounded)
    panels = [Panel(text[0].upper() + text[1:], plot, note)]
    if errors:
        plot = axes.figure(f"error [{unit}]", 220)
        halves = [0.5 * (e.upper - e.lower) for e in errors if e.upper is not None and e.lower is not None]
        drawn, least = axes.draw(plot, errors, unit), _bounds_height(halves)
        note = set_view(plot, drawn, at_least=least, with_bands=is_bounded)
        axes.mark(plot, 0.0, dash="solid")
        panels.append(Panel(f"Error of {short}: estimate − reference", plot, note))
    return panels


def innovation_panels(axes: TimeAxes, results: Results) -> list[Panel]:
    """For each estimator and sensor: z − ẑ with ±2 of the filter's own standard deviations."""
    panels = []
    for i, (name, estimates) in enumerate(results.items()):
        shares = {row.sensor: row.beyond for row in sensor_consistency(estimates)}
        for k, sensor in enumerate(estimates.sensors):
            if sensor not in shares:
                continue
            innovation, limit = estimates.innovation[:, k], 2.0 * estimates.innovation_std[:, k]
            color = style.estimator_color(i)
            limit = np.where(np.isfinite(innovation), limit, np.nan)
            trace = Trace("ν ± 2σ", innovation, color, limit, -limit, limit, 1.0, outline=style.TEXT)
            unit = unit_label(estimates.sensor_units.get(sensor, "SI unit"))
            plot = axes.figure(f"ν [{unit}]", 170)
            note = set_view(plot, axes.draw(plot, [trace], unit), at_least=_bounds_height([limit]))
            heading = f"{name}: {sensor} — {100 * shares[sensor]:.1f} % outside ±2σ"
            panels.append(Panel(heading, plot, note))
    return panels


def nis_panels(axes: TimeAxes, results: Results) -> list[Panel]:
    """NIS per sensor used, averaged over windows, of all estimators on one logarithmic axis."""
    duration = float(axes.time[-1] - axes.time[0])
    window = max(1.0, duration / 600.0)
    traces, centers = [], axes.time
    for i, (name, estimates) in enumerate(results.items()):
        if len(estimates.nis) and len(estimates.innovation):
            centers, ratio = windowed_ratio(axes.time, estimates, window)
            traces.append(Trace(name, np.maximum(ratio, 1e-4), style.estimator_color(i)))
    if not traces:
        return []
    windows = TimeAxes(centers, axes.points)
    windows.x_range, windows.crosshair = axes.x_range, axes.crosshair
    plot = windows.figure("NIS per sensor", 190, y_axis_type="log")
    heights = windows.draw(plot, traces, "").lines
    if len(heights):
        low, high = min(0.1, float(heights.min())), max(10.0, float(heights.max()))
        plot.y_range = backend.models().Range1d(low / 1.5, high * 1.5)
    windows.mark(plot, 1.0)
    return [Panel(f"NIS per sensor used, mean over {window:.3g} s (1 is consistent)", plot)]


def whiteness_panels(results: Results) -> list[Panel]:
    """For each estimator: the autocorrelation of every sensor's innovations, with its bound."""
    panels = []
    for name, estimates in results.items():
        drawn = []
        rows = [row for row in sensor_consistency(estimates) if row.autocorrelation is not None]
        for row, color in zip(rows, cycle(style.LINES), strict=False):
            assert row.autocorrelation is not None
            rho, bound = row.autocorrelation.correlation[:, 0], row.autocorrelation.bound[:, 0]
            lags = np.arange(1.0, len(rho) + 1)
            drawn.append(Curve(row.sensor, lags, rho, color))
            drawn += [Curve(row.sensor, lags, side * bound, color, "dashed", 1.0) for side in (-1, 1)]
        if drawn:
            heading = f"{name}: autocorrelation of the innovations"
            note = "Dashed: what white innovations stay within at 95 lags of 100."
            plot = xy_figure(drawn, "lag [samples of the sensor]", "ρ [-]", height=260)
            panels.append(Panel(heading, plot, note))
    return panels


def validity_panels(axes: TimeAxes, results: Results) -> list[Panel]:
    """A strip for each estimator, coloured by the reason of its validity."""
    models = backend.models()
    names = [plain(n) for n in results]
    plot = axes.figure("", 62 + 34 * len(names), y_range=models.FactorRange(*reversed(names)))
    plot.ygrid.grid_line_color = None
    stretches: dict[int, list[tuple[float, float, str]]] = {}
    for name, estimates in zip(names, results.values(), strict=True):
        for start, stop, code in zip(*runs(axes.time, estimates.validity, axes.points), strict=True):
            stretches.setdefault(int(code), []).append((float(start), float(stop), name))
    items = []
    for code in sorted(stretches):
        left, right, row = zip(*stretches[code], strict=True)
        color, label = style.VALIDITY[Validity(code)], Validity(code).label.replace("_", " ")
        data = {"left": np.array(left, axes.time_type), "right": np.array(right, axes.time_type), "row": row}
        bars = plot.hbar("row", 0.7, "right", "left", source=backend.source(data), color=color)
        tips = [("validity", label), ("from", "@left{0.00} s"), ("to", "@right{0.00} s")]
        plot.add_tools(models.HoverTool(renderers=[bars], tooltips=tips, visible=False))
        items.append(models.LegendItem(label=label, renderers=[bars]))
    look = {"orientation": "horizontal", "location": "top_left", "ncols": len(items)}
    plot.add_layout(models.Legend(items=items, **look), "above")
    changes = max(int(np.count_nonzero(np.diff(e.validity))) for e in results.values())
    note = "" if changes < axes.points else "Where reasons alternate quickly, the most severe one is drawn."
    return [Panel("Validity of each sample, by reason", plot, note)]


def _bounds_height(limits: Sequence[Array]) -> float:
    """What must be in view for the usual bounds ±``limits`` to be seen."""
    finite = [limit[np.isfinite(limit)] for limit in limits]
    return 1.15 * max((float(np.median(f)) for f in finite if len(f)), default=0.0)
