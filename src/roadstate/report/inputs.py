"""The report's input panels: every channel of the log, those of one kind and unit together."""

from __future__ import annotations

from collections.abc import Iterable

from roadstate.core import CHANNELS, WHEELS, Log
from roadstate.core.channels import RATES, SPECIFIC_FORCES
from roadstate.report import style
from roadstate.report.figures import Panel, TimeAxes, Trace
from roadstate.report.view import unit_label

_MOST = 8  # lines that one figure still tells apart


def kind_of(name: str) -> tuple[str, str]:
    """A channel's kind in words, and its unit: what is drawn on one figure.

    Args:
        name: canonical channel name.
    """
    unit = CHANNELS[name].unit
    stem, _, wheel = name.rpartition("_")
    if wheel in WHEELS:
        return stem.removeprefix("ref_").replace("_", " "), unit
    if name in RATES:
        return "rotation rates", unit
    if name.endswith(SPECIFIC_FORCES):
        return "accelerations", unit
    if name in ("speed", "ref_velocity_x", "ref_velocity_y"):
        return "speed", unit
    if name in ("ref_grade", "ref_bank"):
        return "road angles (reference)", unit
    return name.replace("_", " "), unit


def grouped(names: Iterable[str]) -> dict[tuple[str, str], list[str]]:
    """Channel names by :func:`kind_of`, in the order of the table of channels, 8 at most to a group."""
    groups: dict[tuple[str, str], list[str]] = {}
    present = set(names)
    for name in (n for n in CHANNELS if n in present):
        kind, unit = kind_of(name)
        part = 1
        key = (kind, unit)
        while len(groups.get(key, [])) == _MOST:
            part += 1
            key = (f"{kind} ({part})", unit)
        groups.setdefault(key, []).append(name)
    return groups


def input_panels(axes: TimeAxes, log: Log) -> list[Panel]:
    """A figure for each kind and unit of channel that has a sample; references are dashed."""
    panels = []
    for (kind, unit), names in grouped(log.available).items():
        traces = [
            Trace(
                name,
                log[name],
                style.LINES[i % len(style.LINES)],
                width=1.2,
                dash="dashed" if CHANNELS[name].is_reference else "solid",
            )
            for i, name in enumerate(names)
        ]
        plot = axes.figure(f"[{unit_label(unit)}]", 180)
        axes.draw(plot, traces, unit_label(unit))
        panels.append(Panel(kind[0].upper() + kind[1:], plot))
    return panels
