"""Steady and repeated cornering: constant radius, slalom."""

from __future__ import annotations

import numpy as np

from roadstate.core.constants import GRAVITY
from roadstate.sim.manoeuvres.base import KMH, Manoeuvre, ManoeuvreKind, Setting
from roadstate.sim.manoeuvres.path import straight, waves
from roadstate.sim.manoeuvres.roads import plain
from roadstate.sim.manoeuvres.script import Script
from roadstate.sim.roads.centreline import Bend, make_road
from roadstate.sim.roads.friction import uniform
from roadstate.sim.speed_plan import SpeedPlan

_RADIUS = 100.0  # m
_GATES, _SPACING, _WAVE = 8, 30.0, 1.4


def _constant_radius(setting: Setting) -> Manoeuvre:
    fastest = max(float(np.sqrt(0.8 * setting.friction * GRAVITY * _RADIUS)), setting.speed + 1.0)
    rise = (fastest - setting.speed) / 0.2
    plan = SpeedPlan((0.0, 15.0, 15.0 + rise, 20.0 + rise), (setting.speed, setting.speed, fastest, fastest))
    length = 15.0 * setting.speed + rise * (setting.speed + fastest) / 2 + 10.0 * fastest
    bends = [Bend(20.0), Bend(40.0, 0.0, 1 / _RADIUS), Bend(length, 1 / _RADIUS)]
    road = make_road(bends, friction=uniform(setting.friction))
    return CONSTANT_RADIUS.make(setting, road=road, script=Script.write(plan), path=straight())


def _slalom(setting: Setting) -> Manoeuvre:
    start = 3.0 * setting.speed + _SPACING
    plan = SpeedPlan.constant(setting.speed, (start + _GATES * _SPACING) / setting.speed + 3.0)
    path = waves(start, _SPACING, _GATES, _WAVE)
    return SLALOM.make(setting, road=plain(setting.friction), script=Script.write(plan), path=path)


CONSTANT_RADIUS = ManoeuvreKind(
    "constant-radius",
    "a circle of 100 m radius, speed rising by 0.2 m/s² to 80 % of the friction",
    "ISO 4138:2021, method 1",
    30 * KMH,
    0.85,
    _constant_radius,
)
SLALOM = ManoeuvreKind(
    "slalom", "eight cones 30 m apart, 1.4 m to either side", "chosen", 55 * KMH, 0.85, _slalom
)
