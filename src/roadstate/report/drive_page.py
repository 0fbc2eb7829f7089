"""A simulated drive as one HTML file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from roadstate.report.document import Section, write_document
from roadstate.report.drive_panels import (
    driver_panels,
    friction_panels,
    motion_panels,
    road_panels,
    wheel_panels,
)
from roadstate.report.drive_places import circle_panels, track_panels
from roadstate.report.figures import TimeAxes
from roadstate.report.tables import Table, settings_table, versions
from roadstate.sim.facts import drive_facts
from roadstate.sim.run import Drive

_POINTS = 2000  # of a line: about forty lines in less than a megabyte
_KMH = 3.6
_HINTS = (
    "Drag along a figure to zoom all time axes, Ctrl + wheel to zoom about the pointer; the reset tool at "
    "the figure's right brings everything back. A click on a legend entry hides its line. Long drives are "
    "drawn by the minimum and maximum of each stretch, so every peak is shown."
)


def write_drive_page(
    path: str | Path,
    driven: Drive,
    *,
    title: str | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Path:
    """Write what really happened in a drive, no sensor between: one HTML file that opens offline.

    Track and path, what the driver does, accelerations, forces, loads and slips of the wheels, their
    friction circles, friction used and available, slopes of the road. All text is escaped.

    Args:
        path: file to write; it appears whole or not at all.
        driven: the drive.
        title: heading; the manoeuvre's name where not given.
        settings: to list; may be nested.

    Raises:
        InputError: Bokeh is not installed, or the path cannot be written.
    """
    axes = TimeAxes(np.asarray(driven.time, np.float64), _POINTS)
    manoeuvre, vehicle = driven.manoeuvre, driven.vehicle
    details = [settings_table("Settings", settings)] if settings else []
    details += [
        settings_table("Vehicle, as in its file", vehicle.model_dump(mode="json", exclude_none=True)),
        settings_table("Versions", versions()),
    ]
    sections = [
        Section("track", "Track", track_panels(driven)),
        Section("driver", "Driver", driver_panels(axes, driven)),
        Section("motion", "Motion", motion_panels(axes, driven)),
        Section(
            "circles",
            "Friction circles",
            circle_panels(driven),
            intro="Force of the road on each wheel over its load, in the wheel's frame as seen from above: "
            "driving is up, braking down, a force to the left is on the left. The darker a spot, the longer "
            "the force stayed there.",
            columns=2,
        ),
        Section(
            "friction",
            "Friction used and available",
            friction_panels(axes, driven),
            intro="Available is the peak friction coefficient of the road under the wheel. A tire's own peak "
            "is a little above it at small loads and below it at large ones.",
        ),
        Section("wheels", "Wheels", wheel_panels(axes, driven)),
        Section("road", "Road", road_panels(axes, driven)),
        Section("details", "Settings, vehicle, versions", tables=details),
    ]
    return write_document(
        path,
        title=title or f"roadstate: {manoeuvre.name}",
        sentences=[f"{manoeuvre.name}: {manoeuvre.description}.", f"Driven with {vehicle.name}."],
        headline=_facts(driven),
        sections=sections,
        hints=_HINTS,
    )


def _facts(driven: Drive) -> Table:
    facts = drive_facts(driven)
    friction, load = driven.truth.friction, driven.truth.load
    cells = {
        "duration": f"{facts['duration']:.1f} s",
        "distance": f"{facts['distance']:.0f} m",
        "speed": f"{_KMH * facts['speed_least']:.0f} to {_KMH * facts['speed_most']:.0f} km/h",
        "|a_x| up to": f"{facts['accel_x_most']:.1f} m/s²",
        "|a_y| up to": f"{facts['accel_y_most']:.1f} m/s²",
        "yaw rate up to": f"{math.degrees(abs(driven.truth.angular_rate[:, 2]).max()):.1f} °/s",
        "friction there": _span(float(friction.min()), float(friction.max())),
        "friction used": f"{100 * facts['friction_used_most']:.0f} %",
        "least load": f"{1e-3 * float(load.min()):.2f} kN",
    }
    note = (
        "Friction there: under the wheels. Friction used: largest share of it that a wheel takes, for 0.1 s "
        "or longer. Least load: of any wheel."
    )
    if "off_path_most" in facts:
        cells["off path by"] = f"{facts['off_path_most']:.2f} m"
        note += " Off path: the largest distance."
    return Table("Facts", tuple(cells), [tuple(cells.values())], labels=0, note=note)


def _span(low: float, high: float) -> str:
    return f"{high:.2f}" if high - low < 0.005 else f"{low:.2f} to {high:.2f}"
