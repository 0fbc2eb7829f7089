"""The single-file HTML report."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from roadstate.core import Estimates, InputError, Log
from roadstate.estimators.remarks import remarks
from roadstate.metrics import Metrics, check_time, evaluate
from roadstate.report.document import Section, write_document
from roadstate.report.figures import TimeAxes
from roadstate.report.inputs import input_panels
from roadstate.report.panels import (
    innovation_panels,
    nis_panels,
    quantities,
    quantity_panels,
    validity_panels,
    whiteness_panels,
)
from roadstate.report.summary import source_of, summary
from roadstate.report.tables import (
    band_table,
    faults_table,
    innovation_table,
    metrics_table,
    settings_table,
    validity_table,
    versions,
)
from roadstate.report.track import track_panel

_DATA_BYTES = 3_200_000  # of the 5 MB, before compression; Bokeh's own script takes 1.3
_FEWEST, _MOST = 800, 20_000  # points of a line: enough for a projector; more than a canvas draws at ease
_MOST_ESTIMATORS = 12
_HINTS = (
    "Drag along a figure to zoom all time axes, Ctrl + wheel to zoom about the pointer; the reset tool at "
    "the figure's right brings everything back. A click on a legend entry hides its line. Lines of long logs "
    "are drawn by the minimum and maximum of each stretch, so every peak is shown."
)


def write_report(
    path: str | Path,
    log: Log,
    results: Mapping[str, Estimates],
    *,
    metrics: Mapping[str, Mapping[str, Metrics]] | None = None,
    vehicle: Mapping[str, Any] | None = None,
    settings: Mapping[str, Any] | None = None,
    title: str | None = None,
) -> Path:
    """Write one HTML file that opens offline: estimates, errors, consistency, inputs, map and tables.

    Long logs are thinned out by minimum and maximum, so that the file stays below 5 MB and every peak is in
    it. All text that came with the data is escaped, and the page forbids itself to load anything.

    Args:
        path: file to write; it appears whole or not at all.
        log: (T,) channels the estimates were made from, with references where there are any.
        results: estimator name → its estimates on the log's time base.
        metrics: estimator name → quantity → errors; computed over the whole log where not given.
        vehicle: vehicle parameters to list; may be nested.
        settings: further settings to list; may be nested.
        title: heading; the log's file name where not given.

    Raises:
        InputError: Bokeh is not installed, there are no results (or more than 12), the time bases differ,
            or the path cannot be written.
    """
    _check(log, results)
    if metrics is None:
        metrics = {name: evaluate(e, log) for name, e in results.items()}
    files = source_of(log)
    return write_document(
        path,
        title=title or f"roadstate: {files[0] if files else 'report'}",
        sentences=[*summary(log, results, metrics), *_remarks(results, vehicle)],
        headline=metrics_table(metrics),
        sections=_sections(log, results, metrics, vehicle, settings),
        hints=_HINTS,
    )


def _remarks(results: Mapping[str, Estimates], vehicle: Mapping[str, Any] | None) -> list[str]:
    told: Any = vehicle or {}
    bias = told.get("sensors", {}).get("accel", {}).get("bias")
    return [
        f"{name}: {one}."
        for name, estimates in results.items()
        for one in remarks(estimates, told.get("mass"), bias)
    ]


def _check(log: Log, results: Mapping[str, Estimates]) -> None:
    if not results:
        raise InputError("there is nothing to report: no estimator has a result")
    if len(results) > _MOST_ESTIMATORS:
        raise InputError(
            f"{len(results)} estimators are too many for one report",
            mend=f"choose {_MOST_ESTIMATORS} at most",
        )
    for estimates in results.values():
        check_time(estimates, log)


def _sections(
    log: Log,
    results: Mapping[str, Estimates],
    metrics: Mapping[str, Mapping[str, Metrics]],
    vehicle: Mapping[str, Any] | None,
    settings: Mapping[str, Any] | None,
) -> list[Section]:
    axes = TimeAxes(log.time, points_per_line(log, results))
    estimated = [p for q in quantities(results) for p in quantity_panels(axes, q, results, log)]
    innovations = innovation_panels(axes, results)
    bands = [t for t in (innovation_table(results), band_table(results, log)) if t is not None]
    first = next((n for n, e in results.items() if "grade" in e.values), "")
    track = track_panel(log, first, results.get(first), min(axes.points, 6000))
    about_validity = [t for t in (validity_table(results), faults_table(results)) if t is not None]
    details = [
        settings_table("Log", {"duration": f"{log.duration:g} s", "samples": len(log), **log.metadata})
    ]
    details += [settings_table("Vehicle", vehicle)] if vehicle else []
    details += [settings_table("Settings", settings)] if settings else []
    details += [settings_table(f"Estimator {n}", e.metadata) for n, e in results.items() if e.metadata]
    details += [settings_table("Versions", versions())]
    return [
        Section("estimates", "Estimates", estimated, []),
        Section(
            "innovations",
            "Innovations",
            [*innovations, *nis_panels(axes, results)],
            [],
            "Measurement less prediction ν, with ±2σ as the filter itself states it; "
            "4.6 % of the samples should lie outside.",
        ),
        Section("validity", "Validity", validity_panels(axes, results), about_validity),
        Section("inputs", "Inputs", input_panels(axes, log), []),
        Section("track", "Track", [track] if track else [], []),
        Section("consistency", "Consistency", whiteness_panels(results), bands, columns=2),
        Section("details", "Vehicle, settings, versions", [], details),
    ]


def points_per_line(log: Log, results: Mapping[str, Estimates]) -> int:
    """How many points each line may have so that the file stays small.

    A point of a line takes x and y, with an estimate also 2σ; a band takes half as many edges of four
    numbers each. All are float32 in base 64, 16/3 bytes a number.
    """
    numbers = 2 * len(log.available) + 4
    for estimates in results.values():
        numbers += sum(10 for _ in estimates.values) + 5 * len(estimates.sensors) + 2
    return int(min(_MOST, max(_FEWEST, _DATA_BYTES / (numbers * 16 / 3))))
