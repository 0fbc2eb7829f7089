"""Double lane changes: paper 003's, and the two of ISO 3888."""

from __future__ import annotations

from collections.abc import Sequence

from roadstate.core.constants import GRAVITY
from roadstate.sim.manoeuvres.base import KMH, Manoeuvre, ManoeuvreKind, Setting
from roadstate.sim.manoeuvres.path import Path, rounded
from roadstate.sim.manoeuvres.roads import plain
from roadstate.sim.manoeuvres.script import Script
from roadstate.sim.speed_plan import SpeedPlan

_USED = 0.85  # share of the friction up to which a test driver rounds corners no more than he must
_MIRRORS = 0.25  # m by which a car is wider than its track


def gates(lengths: Sequence[float], offset: float, start: float, setting: Setting) -> Path:
    """A path through five gates: straight, over, straight, back, straight.

    Corners are rounded as the speed asks for: until the path's curvature costs 85 % of the friction, over at
    least two fifths and at most four fifths of the shorter ramp, which keeps the car within the gates.

    Args:
        lengths: l₁ … l₅, m.
        offset: D to the left, m.
        start: s of the first gate's entry, m.
        setting: of the manoeuvre.
    """
    first, over, aside, back, _ = lengths
    shorter = min(over, back)
    slope = offset / shorter
    needed = 2 * slope * setting.speed**2 / (_USED * setting.friction * GRAVITY)
    rounding = min(max(needed, 0.4 * shorter), 0.8 * shorter)
    at = start + first
    corners = [(at, 0.0), (at + over, offset), (at + over + aside, offset), (at + over + aside + back, 0.0)]
    return rounded(corners, rounding)


def _duration(lengths: Sequence[float], start: float, speed: float) -> float:
    return (start + sum(lengths)) / speed + 2.0


def _paper(setting: Setting) -> Manoeuvre:
    return _at_constant_speed(PAPER, setting)


def _iso_1(setting: Setting) -> Manoeuvre:
    return _at_constant_speed(ISO_1, setting)


def _at_constant_speed(kind: ManoeuvreKind, setting: Setting) -> Manoeuvre:
    lengths, start = (15.0, 30.0, 25.0, 25.0, 30.0), 2.0 * setting.speed
    plan = SpeedPlan.constant(setting.speed, _duration(lengths, start, setting.speed))
    return kind.make(
        setting,
        road=plain(setting.friction),
        script=Script.write(plan),
        path=gates(lengths, 3.5, start, setting),
    )


def _iso_2(setting: Setting) -> Manoeuvre:
    lengths, start = (12.0, 13.5, 11.0, 12.5, 12.0), 2.0 * setting.speed
    plan = SpeedPlan.constant(setting.speed, _duration(lengths, start, setting.speed))
    width = setting.vehicle.geometry.track_front + _MIRRORS
    # centres of lanes 1.1 b + 0.25 and b + 1 wide, 1 m between their sides
    offset = 0.5 * (1.1 * width + 0.25) + 1.0 + 0.5 * (width + 1.0)
    release = (start + 2.0) / setting.speed
    return ISO_2.make(
        setting,
        road=plain(setting.friction),
        script=Script.write(plan, pedals_from=release),
        path=gates(lengths, offset, start, setting),
    )


PAPER = ManoeuvreKind(
    "double-lane-change",
    "3.5 m over in 30 m, 25 m along, back in 25 m, at constant speed",
    "Li et al. (UKF and particle filter), §5.2: D = 3.5, l₁…l₅ = 15, 30, 25, 25, 30 m, l₀ = 2 v",
    48 * KMH,
    0.8,
    _paper,
)
ISO_1 = ManoeuvreKind(
    "iso-3888-1", "severe double lane change at constant speed", "ISO 3888-1:2018", 80 * KMH, 0.85, _iso_1
)
ISO_2 = ManoeuvreKind(
    "iso-3888-2",
    "obstacle avoidance, foot off the pedals 2 m into the first gate",
    "ISO 3888-2:2011",
    55 * KMH,
    0.85,
    _iso_2,
)
