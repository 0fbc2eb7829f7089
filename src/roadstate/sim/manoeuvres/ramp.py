"""The three drives of paper 002 on its interchange ramp."""

from __future__ import annotations

from roadstate.sim.manoeuvres.base import Manoeuvre, ManoeuvreKind, Setting
from roadstate.sim.manoeuvres.path import straight
from roadstate.sim.manoeuvres.script import Script
from roadstate.sim.roads.friction import uniform
from roadstate.sim.roads.grade import RAMP_SPEED
from roadstate.sim.roads.interchange import interchange_road
from roadstate.sim.speed_plan import SpeedPlan

_SOURCE = "Luo et al., J. Vibroengineering 2024"


def _constant(setting: Setting) -> Manoeuvre:
    plan = SpeedPlan.constant(setting.speed, 110.0 * RAMP_SPEED / setting.speed)
    return _on_ramp(STRAIGHT_CONSTANT, setting, plan, curved=False)


def _variable(setting: Setting) -> Manoeuvre:
    return _on_ramp(STRAIGHT_VARIABLE, setting, _scaled(setting), curved=False)


def _curve(setting: Setting) -> Manoeuvre:
    return _on_ramp(CURVE_VARIABLE, setting, _scaled(setting), curved=True)


def _scaled(setting: Setting) -> SpeedPlan:
    usual = SpeedPlan.variable()
    return SpeedPlan(usual.time, tuple(v * setting.speed / RAMP_SPEED for v in usual.speed))


def _on_ramp(kind: ManoeuvreKind, setting: Setting, plan: SpeedPlan, *, curved: bool) -> Manoeuvre:
    road = interchange_road(uniform(setting.friction), curved=curved)
    return kind.make(setting, road=road, script=Script.write(plan), path=straight())


STRAIGHT_CONSTANT = ManoeuvreKind(
    "straight-constant-speed",
    "straight ramp of grades -1.8°, 3.4°, -3.9° at one speed",
    f"{_SOURCE}, §4.1",
    RAMP_SPEED,
    0.85,
    _constant,
)
STRAIGHT_VARIABLE = ManoeuvreKind(
    "straight-variable-speed",
    "the straight ramp with braking, gear shifts and a stop on the slope",
    f"{_SOURCE}, §4.2; speeds chosen",
    RAMP_SPEED,
    0.85,
    _variable,
)
CURVE_VARIABLE = ManoeuvreKind(
    "curve-variable-speed",
    "the ramp with bends of 90 m and 120 m radius, speed as on the straight one",
    f"{_SOURCE}, §4.3; plan and speeds chosen",
    RAMP_SPEED,
    0.85,
    _curve,
)
