"""Twenty minutes in town: starts, stops, corners, hills."""

from __future__ import annotations

import numpy as np

from roadstate.core.constants import GRAVITY
from roadstate.sim.manoeuvres.base import KMH, Manoeuvre, ManoeuvreKind, Setting
from roadstate.sim.manoeuvres.path import straight
from roadstate.sim.manoeuvres.script import Script
from roadstate.sim.roads.centreline import Bend, make_road
from roadstate.sim.roads.friction import uniform
from roadstate.sim.roads.grade import GradeProfile
from roadstate.sim.speed_plan import SpeedPlan

_DURATION = 1200.0  # s
_SHARPEST = 40.0  # m of radius
_SEED = 20  # the same town for everyone
_STANDING = 8.0  # s at a stop, on average


def _urban(setting: Setting) -> Manoeuvre:
    rng = np.random.default_rng(_SEED)
    # wherever the car may be when it is fastest, the sharpest bend costs at most 45 % of the friction
    fastest = min(setting.speed, float(np.sqrt(0.45 * setting.friction * GRAVITY * _SHARPEST)))
    plan, length = _stops(fastest, rng)
    bends: list[Bend] = [Bend(80.0)]
    while sum(b.length for b in bends) < length + 100.0:
        radius = rng.uniform(_SHARPEST, 150.0)
        angle = np.deg2rad(rng.uniform(30.0, 90.0))
        k, ramp = rng.choice([-1.0, 1.0]) / radius, 0.5 * radius
        arc = max(radius * angle - ramp, 1.0)
        bends += [Bend(ramp, 0.0, k), Bend(arc, k), Bend(ramp, k, 0.0), Bend(rng.uniform(40.0, 250.0))]
    places = np.arange(0.0, sum(b.length for b in bends), 150.0)
    hills = 0.02 * rng.standard_normal(len(places))
    hills[0] = 0.0
    road = make_road(
        bends,
        height=GradeProfile.in_plan(places, hills, 30.0).over_plan,
        friction=uniform(setting.friction),
    )
    return URBAN.make(setting, road=road, script=Script.write(plan), path=straight(), speed=0.0)


def _stops(fastest: float, rng: np.random.Generator) -> tuple[SpeedPlan, float]:
    """Legs between stops, and how far they go, m."""
    time, speed, length = [0.0, 3.0], [0.0, 0.0], 0.0

    def to(target: float, accel: float) -> None:
        nonlocal length
        took = max(abs(target - speed[-1]) / accel, 0.5)
        length += took * (target + speed[-1]) / 2
        time.append(time[-1] + took)
        speed.append(target)

    def stay(seconds: float) -> None:
        nonlocal length
        length += seconds * speed[-1]
        time.append(time[-1] + seconds)
        speed.append(speed[-1])

    while time[-1] < _DURATION - 90.0:
        to(fastest * rng.uniform(0.5, 1.0), rng.uniform(0.7, 1.6))
        for _ in range(rng.integers(0, 3)):
            stay(rng.uniform(4.0, 15.0))
            to(fastest * rng.uniform(0.35, 1.0), rng.uniform(0.4, 1.5))
        stay(rng.uniform(3.0, 15.0))
        to(0.0, rng.uniform(0.8, 2.5))
        stay(3.0 + rng.exponential(_STANDING))
    time.append(max(_DURATION, time[-1] + 1.0))
    speed.append(0.0)
    return SpeedPlan(tuple(time), tuple(speed)), length


URBAN = ManoeuvreKind(
    "urban-drive",
    "twenty minutes: stops, corners from 40 m radius, hills",
    "chosen",
    50 * KMH,
    0.85,
    _urban,
)
