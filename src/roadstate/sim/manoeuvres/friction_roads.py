"""Roads of two frictions: paper 004's joint and split road, and braking on a split road."""

from __future__ import annotations

from roadstate.sim.manoeuvres.base import KMH, Manoeuvre, ManoeuvreKind, Setting
from roadstate.sim.manoeuvres.path import straight
from roadstate.sim.manoeuvres.roads import plain
from roadstate.sim.manoeuvres.script import Script
from roadstate.sim.roads.friction import joint, split
from roadstate.sim.speed_plan import SpeedPlan

_SLIPPERY = 0.25  # of the better surface: paper 004 has 0.2 and 0.8
_PAPER = "limited-memory adaptive EKF paper"
_PEDAL = 0.15  # of the brake: enough to lock the wheels of the slippery side without anti-lock control


def _joint(setting: Setting) -> Manoeuvre:
    friction = joint([25.0], [_SLIPPERY * setting.friction, setting.friction])
    script = Script.write(
        SpeedPlan.constant(setting.speed, 8.0), steering_wheel=0.0, throttle=0.5, pedals_from=0.0
    )
    return JOINT.make(setting, road=plain(friction), script=script, path=straight())


def _split(setting: Setting) -> Manoeuvre:
    friction = split(_SLIPPERY * setting.friction, setting.friction)
    script = Script.write(SpeedPlan.constant(setting.speed, 10.0))
    return SPLIT.make(setting, road=plain(friction), script=script, path=straight())


def _braking(setting: Setting) -> Manoeuvre:
    friction = split(_SLIPPERY * setting.friction, setting.friction)
    plan = SpeedPlan((0.0, 2.0, 12.0), (setting.speed, setting.speed, 0.0))
    script = Script.write(plan, brake=_PEDAL, pedals_from=2.0)
    return BRAKING.make(setting, road=plain(friction), script=script, path=straight())


JOINT = ManoeuvreKind(
    "joint-road-acceleration",
    "half throttle from 30 km/h, 25 m of a quarter of the friction, then all of it; wheel straight",
    f"{_PAPER}, §4.1",
    30 * KMH,
    0.8,
    _joint,
)
SPLIT = ManoeuvreKind(
    "split-road",
    "straight at constant speed, a quarter of the friction under the left wheels",
    f"{_PAPER}, §4.3",
    40 * KMH,
    0.8,
    _split,
)
BRAKING = ManoeuvreKind(
    "split-road-braking",
    "braking on a split road, a quarter of the friction under the left wheels; driver steers",
    "ISO 14512:1999; pedal and frictions chosen",
    80 * KMH,
    0.8,
    _braking,
)
