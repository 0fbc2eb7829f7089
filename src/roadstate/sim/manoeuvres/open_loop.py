"""Steering inputs as written: step steer and sine with dwell."""

from __future__ import annotations

import numpy as np

from roadstate.core.constants import GRAVITY
from roadstate.sim.manoeuvres.base import KMH, Manoeuvre, ManoeuvreKind, Setting
from roadstate.sim.manoeuvres.path import straight
from roadstate.sim.manoeuvres.roads import plain
from roadstate.sim.manoeuvres.script import Script, Times
from roadstate.sim.speed_plan import SpeedPlan

_BEGIN = 2.0  # s
_STEP_RATE = 6.0  # rad/s of the steering wheel: 340 °/s, within ISO 7401's 200 … 500
_FREQUENCY = 0.7  # Hz
_DWELL = 0.5  # s
_SCALE = 3.0  # times the angle of 0.3 g


def steady_angle(setting: Setting, accel: float) -> float:
    """Steering-wheel angle in rad for a lateral acceleration (m/s²) in a steady turn, linear tires.

    i_s (l/v² + K) a_y (Gillespie, *Fundamentals of Vehicle Dynamics*, ch. 6).
    """
    car = setting.vehicle
    ratio = 1.0 if car.steering is None else car.steering.ratio
    return ratio * (car.wheelbase / setting.speed**2 + max(car.understeer_gradient, 0.0)) * accel


def _step(setting: Setting) -> Manoeuvre:
    angle = steady_angle(setting, min(4.0, 0.5 * setting.friction * GRAVITY))

    def wheel(t: Times) -> Times:
        return np.asarray(np.clip((t - _BEGIN) * _STEP_RATE, 0, angle))

    plan = SpeedPlan.constant(setting.speed, _BEGIN + 6.0)
    script = Script.write(plan, steering_wheel=wheel, hold_pedals_from=_BEGIN)
    return STEP_STEER.make(setting, road=plain(setting.friction), script=script, path=straight())


def _sine(setting: Setting) -> Manoeuvre:
    # 270° is the standard's least largest amplitude, and about what hands can do at 0.7 Hz
    amplitude = min(_SCALE * steady_angle(setting, 0.3 * GRAVITY), np.deg2rad(270.0))
    half = 0.5 / _FREQUENCY

    def wheel(t: Times) -> Times:
        u = t - _BEGIN
        held = 1.5 * half
        later = np.where(u < held, u, np.maximum(u - _DWELL, held))
        angle = amplitude * np.sin(2 * np.pi * _FREQUENCY * later)
        return np.asarray(np.where((u >= 0) & (u < 2 * half + _DWELL), angle, 0.0))

    plan = SpeedPlan.constant(setting.speed, _BEGIN + 2 * half + _DWELL + 3.0)
    script = Script.write(plan, steering_wheel=wheel, steer_from=_BEGIN, pedals_from=_BEGIN)
    return SINE.make(setting, road=plain(setting.friction), script=script, path=straight())


STEP_STEER = ManoeuvreKind(
    "step-steer",
    "steering wheel turned at 340 °/s to what 4 m/s² asks for, pedals held",
    "ISO 7401:2011",
    80 * KMH,
    0.85,
    _step,
)
SINE = ManoeuvreKind(
    "sine-with-dwell",
    "0.7 Hz sine with 0.5 s at the second peak, three times the angle of 0.3 g, foot off the pedals",
    "ISO 19365:2016",
    80 * KMH,
    0.85,
    _sine,
)
