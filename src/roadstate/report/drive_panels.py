"""Panels of a simulated drive over time: what the driver does, how the car moves, what the wheels do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roadstate.core import WHEELS
from roadstate.report import style
from roadstate.report.figures import Panel, TimeAxes, Trace, set_view
from roadstate.sim.facts import cues, force_over_load
from roadstate.sim.manoeuvres.script import CLOSED, OPEN
from roadstate.sim.run import Drive

Array = NDArray[np.float64]

_KMH = 3.6
_HEIGHT = 210  # px
_FLAT = 1e-4  # rad; a road whose slopes stay below is level
_TURNED = 0.2  # degrees under which a rear wheel only follows its suspension
_STANDING = 0.5  # m/s under which sideslip says nothing


def _panel(
    axes: TimeAxes, heading: str, label: str, unit: str, traces: Sequence[Trace], *, at_least: float = 0.0
) -> Panel:
    plot = axes.figure(f"{label} [{unit}]", _HEIGHT)
    note = set_view(plot, axes.draw(plot, traces, unit), at_least=at_least)
    return Panel(heading, plot, note)


def _wheels(columns: Any, *, scale: float = 1.0, dash: str = "solid", suffix: str = "") -> list[Trace]:
    """A line for each column of (T, 4), the wheels in their colours."""
    return [
        Trace(wheel + suffix, scale * np.asarray(column, np.float64), color, width=1.3, dash=dash)
        for wheel, column, color in zip(WHEELS, np.asarray(columns).T, style.LINES, strict=False)
    ]


def driver_panels(axes: TimeAxes, driven: Drive) -> list[Panel]:
    """Speed beside the one planned, steering, pedals and gear."""
    truth, controls, cue = driven.truth, driven.controls, cues(driven)
    blue, orange, green = style.LINES[:3]
    planned = _KMH * np.where(cue[:, 7] == CLOSED, cue[:, 0], np.nan)
    speed = [Trace("car", _KMH * np.asarray(truth.planar_velocity[:, 0], np.float64), blue)]
    if np.isfinite(planned).any():
        speed.insert(0, Trace("planned", planned, style.REFERENCE, dash="dashed", width=1.4))
    steer = np.degrees(np.asarray(truth.steer, np.float64))
    turned = [t for t in _wheels(steer) if t.label[0] == "f" or np.abs(t.values).max() > _TURNED]
    percent = [100.0 * np.asarray(v, np.float64) for v in (controls.throttle, controls.brake)]
    panels = [
        _panel(axes, "Speed", "speed", "km/h", speed, at_least=0.0),
        _panel(
            axes,
            "Steering wheel, positive to the left" + (", as written" if (cue[:, 6] == OPEN).any() else ""),
            "angle",
            "°",
            [Trace("steering wheel", np.degrees(controls.steering_wheel), blue)],
            at_least=1.0,
        ),
        _panel(axes, "Angles of the wheels to the body", "δ", "°", turned, at_least=0.1),
        _panel(
            axes,
            "Pedals" + (", as written" if (cue[:, 7] == OPEN).any() else ""),
            "pressed",
            "%",
            [Trace("accelerator", percent[0], green), Trace("brake", percent[1], orange)],
            at_least=1.0,
        ),
    ]
    gear = np.asarray(truth.gear, np.float64)
    if np.ptp(gear) > 0:
        panels.append(_panel(axes, "Gear in mesh; 0 is neutral", "gear", "-", [Trace("gear", gear, blue)]))
    return panels


def motion_panels(axes: TimeAxes, driven: Drive) -> list[Panel]:
    """Accelerations, yaw rate, sideslip, attitude."""
    truth = driven.truth
    blue, orange, green = style.LINES[:3]
    felt = np.asarray(truth.specific_force, np.float64)
    v_x, v_y = (np.asarray(truth.planar_velocity, np.float64)[:, k] for k in (0, 1))
    sideslip = np.where(np.abs(v_x) > _STANDING, np.degrees(np.arctan2(v_y, np.abs(v_x))), np.nan)
    pitch, roll = np.degrees(np.asarray(truth.attitude, np.float64)[:, 1:]).T
    accel = [Trace("along", felt[:, 0], blue), Trace("across", felt[:, 1], orange)]
    return [
        _panel(
            axes,
            "Accelerations, as an ideal sensor at the centre of gravity feels them",
            "a",
            "m/s²",
            accel,
            at_least=0.5,
        ),
        _panel(
            axes,
            "Yaw rate, positive to the left",
            "yaw rate",
            "°/s",
            [Trace("yaw rate", np.degrees(np.asarray(truth.angular_rate)[:, 2]), blue)],
            at_least=1.0,
        ),
        _panel(axes, "Sideslip of the car", "β", "°", [Trace("sideslip", sideslip, green)], at_least=0.2),
        _panel(
            axes,
            "Attitude: pitch is positive nose down, roll right side down; the road's slopes included",
            "angle",
            "°",
            [Trace("pitch", pitch, blue), Trace("roll", roll, orange)],
            at_least=0.2,
        ),
    ]


def wheel_panels(axes: TimeAxes, driven: Drive) -> list[Panel]:
    """Forces, loads, slips and slip angles of the wheels."""
    truth = driven.truth
    rows: list[tuple[str, str, str, list[Trace], float]] = [
        ("Longitudinal force, along the wheel", "F_x", "kN", _wheels(truth.force_x, scale=1e-3), 0.1),
        ("Lateral force, across the wheel to the left", "F_y", "kN", _wheels(truth.force_y, scale=1e-3), 0.1),
        ("Load, normal to the road", "F_z", "kN", _wheels(truth.load, scale=1e-3), 0.0),
        ("Slip κ", "κ", "%", _wheels(truth.slip, scale=100.0), 0.1),
        ("Slip angle α", "α", "°", _wheels(np.degrees(truth.slip_angle)), 0.1),
    ]
    return [_panel(axes, *row[:4], at_least=row[4]) for row in rows]


def friction_panels(axes: TimeAxes, driven: Drive) -> list[Panel]:
    """What the wheels of each axle use of the friction, and what there is."""
    used = np.hypot(*force_over_load(driven.truth))
    there = np.asarray(driven.truth.friction, np.float64)
    panels = []
    for name, pair in (("Front", (0, 1)), ("Rear", (2, 3))):
        traces = []
        alike = np.array_equal(there[:, pair[0]], there[:, pair[1]])
        for k in pair:
            if k == pair[0] or not alike:
                label = "available" + ("" if alike else f", {WHEELS[k]}")
                color = style.REFERENCE if alike else style.darker(style.LINES[k])
                traces.append(Trace(label, there[:, k], color, width=1.6, dash="dashed"))
            traces.append(Trace(f"used, {WHEELS[k]}", used[:, k], style.LINES[k], width=1.3))
        plot = axes.figure("|F|/F_z, μ [-]", _HEIGHT)
        note = set_view(plot, axes.draw(plot, traces, "-"))
        panels.append(Panel(f"{name} wheels", plot, note))
    return panels


def road_panels(axes: TimeAxes, driven: Drive) -> list[Panel]:
    """Grade, bank and height where the road is not level."""
    truth = driven.truth
    grade, bank = (np.asarray(v, np.float64) for v in (truth.grade, truth.bank))
    height = np.asarray(truth.position, np.float64)[:, 2]
    panels = []
    if max(np.abs(grade).max(), np.abs(bank).max()) > _FLAT:
        blue, orange = style.LINES[:2]
        traces = [Trace("grade", 100 * np.tan(grade), blue), Trace("bank", 100 * np.tan(bank), orange)]
        what = "Grade along the car's heading (uphill is positive) and bank (left side higher is positive)"
        panels.append(_panel(axes, what, "slope", "%", traces, at_least=0.1))
        risen = [Trace("height", height - height[0], blue)]
        panels.append(_panel(axes, "Height of the car over its start", "height", "m", risen))
    return panels
