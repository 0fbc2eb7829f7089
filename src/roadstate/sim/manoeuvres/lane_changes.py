"""The two drives of paper 000: lane changes while accelerating, and on ice."""

from __future__ import annotations

from roadstate.sim.manoeuvres.base import KMH, Manoeuvre, ManoeuvreKind, Setting, full_throttle
from roadstate.sim.manoeuvres.path import cosine_changes
from roadstate.sim.manoeuvres.roads import plain
from roadstate.sim.manoeuvres.script import Script
from roadstate.sim.speed_plan import SpeedPlan

_LANE = 3.5  # m
_BEGIN = 1.6  # s: when paper 000's front wheels begin to tell (fig. 6)


def _accelerating(setting: Setting) -> Manoeuvre:
    start, end = setting.speed, setting.speed + 50 * KMH
    # 13 s, or what three fifths of the power need: a truck takes its time
    took = max(13.0, 0.5 * (end**2 - start**2) / (0.6 * full_throttle(setting.vehicle)[1]))
    gain = (end - start) / took
    plan = SpeedPlan((0.0, 0.5, 0.5 + took, 2.0 + took), (start, start, end, end))
    times = (_BEGIN, 0.4 * took, 0.7 * took)
    places = [start * t + 0.5 * gain * max(t - 0.5, 0) ** 2 for t in times]
    changes = [
        (place, (start + gain * t) * 3.0, side * _LANE)
        for place, t, side in zip(places, times, (1, -1, 1), strict=True)
    ]
    return ACCELERATING.make(
        setting, road=plain(setting.friction), script=Script.write(plan), path=cosine_changes(changes)
    )


def _on_ice(setting: Setting) -> Manoeuvre:
    v = setting.speed
    plan = SpeedPlan.constant(v, 20.0)
    changes = [
        (2.0 * v, 3.6 * v, _LANE),
        (6.0 * v, 2.6 * v, -1.5),
        (9.0 * v, 2.0 * v, 1.0),
        (11.5 * v, 4.0 * v, -3.0),
    ]
    return ON_ICE.make(
        setting, road=plain(setting.friction), script=Script.write(plan), path=cosine_changes(changes)
    )


ACCELERATING = ManoeuvreKind(
    "acceleration-lane-changes",
    "from 20 to 70 km/h with three lane changes",
    "Zhang et al. (two-stage estimator), §3.1; path chosen",
    20 * KMH,
    0.85,
    _accelerating,
)
ON_ICE = ManoeuvreKind(
    "ice-lane-change",
    "a lane change of irregular shape on ice",
    "Zhang et al. (two-stage estimator), §3.2; path and friction chosen",
    30 * KMH,
    0.2,
    _on_ice,
)
