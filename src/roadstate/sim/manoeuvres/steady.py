"""Little going on: coast-down, cruise; and a start on a hill."""

from __future__ import annotations

import numpy as np

from roadstate.sim.manoeuvres.base import KMH, Manoeuvre, ManoeuvreKind, Setting
from roadstate.sim.manoeuvres.path import straight
from roadstate.sim.manoeuvres.roads import plain
from roadstate.sim.manoeuvres.script import Script, Times
from roadstate.sim.plant.base import AUTOMATIC, NEUTRAL
from roadstate.sim.roads.centreline import Bend, make_road
from roadstate.sim.roads.friction import uniform
from roadstate.sim.roads.grade import GradeProfile
from roadstate.sim.speed_plan import SpeedPlan

_HILL = 0.12  # rise over run
_BENDS = 2000.0  # m of radius


def _coast(setting: Setting) -> Manoeuvre:
    begin = 2.0

    def gear(t: Times) -> Times:
        return np.where(t < begin, float(AUTOMATIC), float(NEUTRAL))

    script = Script.write(SpeedPlan.constant(setting.speed, 62.0), gear=gear, pedals_from=begin)
    return COAST_DOWN.make(setting, road=plain(setting.friction, 4000.0), script=script, path=straight())


def _hill(setting: Setting) -> Manoeuvre:
    slope = float(np.arctan(_HILL))
    profile = GradeProfile.in_plan([0.0], [slope])
    road = make_road([Bend(500.0)], height=profile.over_plan, friction=uniform(setting.friction))
    plan = SpeedPlan((0.0, 4.0, 12.0, 18.0), (0.0, 0.0, setting.speed, setting.speed))
    return HILL_START.make(setting, road=road, script=Script.write(plan), path=straight(), speed=0.0, s=50.0)


def _cruise(setting: Setting) -> Manoeuvre:
    times = np.arange(0.0, 121.0, 15.0)
    speeds = setting.speed * (1 + 0.01 * np.sin(2 * np.pi * times / 45.0))
    plan = SpeedPlan(tuple(times.tolist()), tuple(speeds.tolist()))
    sides = [1, -1] * int(np.ceil(setting.speed * 125.0 / 800.0))
    bends = [
        section
        for side in sides
        for section in (
            Bend(100.0, 0.0, side / _BENDS),
            Bend(200.0, side / _BENDS),
            Bend(100.0, side / _BENDS, 0.0),
        )
    ]
    road = make_road(bends, friction=uniform(setting.friction))
    return CRUISE.make(setting, road=road, script=Script.write(plan), path=straight(), speed=float(speeds[0]))


COAST_DOWN = ManoeuvreKind(
    "coast-down",
    "out of gear for 60 s, straight and level",
    "ISO 10521-1:2006",
    100 * KMH,
    0.85,
    _coast,
)
HILL_START = ManoeuvreKind(
    "hill-start", "held for 4 s on a slope of 12 %, then up to speed", "chosen", 30 * KMH, 0.85, _hill
)
CRUISE = ManoeuvreKind(
    "low-excitation-cruise",
    "two minutes on bends of 2000 m radius, speed within 1 %",
    "chosen",
    90 * KMH,
    0.85,
    _cruise,
)
