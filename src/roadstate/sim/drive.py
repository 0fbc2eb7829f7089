"""A drive along a road by the longitudinal point-mass model, as exact truth at each instant."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from numpy.typing import NDArray

from roadstate.core import InputError
from roadstate.sim.driver import Command, Driver, DriverState
from roadstate.sim.longitudinal import Motion
from roadstate.sim.road import RAMP_SPEED, GradeProfile

STEP = 0.001
"""Integration step in s."""
SAMPLE_STEP = 0.01
"""Time between the samples that are kept, in s."""
Array = NDArray[np.float64]

_SUBSTEPS = round(SAMPLE_STEP / STEP)


@dataclass(frozen=True)
class SpeedPlan:
    """A target speed over time, linear between its knots.

    Attributes:
        time: knots in s, the first at 0, increasing.
        speed: target speed at the knots in m/s, never negative.

    Raises:
        InputError: knots that do not increase or a negative speed.
    """

    time: tuple[float, ...]
    speed: tuple[float, ...]

    def __post_init__(self) -> None:
        increasing = len(self.time) > 1 and bool((np.diff(self.time) > 0).all()) and self.time[0] == 0
        if len(self.time) != len(self.speed) or not increasing or min(self.speed) < 0:
            raise InputError("a speed plan needs times from 0 upward and as many speeds of 0 or more")

    @property
    def duration(self) -> float:
        """Seconds from first to last knot."""
        return self.time[-1]

    @classmethod
    def constant(cls, speed: float = RAMP_SPEED, duration: float = 110.0) -> SpeedPlan:
        """One speed (m/s) throughout: paper 002, §4.1."""
        return cls((0.0, duration), (speed, speed))

    @classmethod
    def variable(cls) -> SpeedPlan:
        """Braking, gear shifts and 8 s of standstill on the upslope, within the length of paper 002's ramp.

        The paper's §4.2 does not print its speeds; these are chosen.
        """
        knots = (
            (0.0, 9.7), (12.0, 9.7), (18.0, 14.0), (26.0, 14.0), (31.0, 8.0), (42.0, 8.0), (48.0, 0.0),
            (56.0, 0.0), (68.0, 13.0), (78.0, 13.0), (84.0, 8.0), (90.0, 8.0), (98.0, 15.0), (106.0, 15.0),
            (112.0, 10.0), (124.0, 10.0),
        )  # fmt: skip
        return cls(tuple(t for t, _ in knots), tuple(v for _, v in knots))


@dataclass(frozen=True)
class Truth:
    """What really happened, (T,) each; torques are sums over the wheels unless they are the engine's.

    Attributes:
        time: s.
        distance: along the road, m.
        velocity: m/s.
        acceleration: v̇, m/s².
        grade: rad.
        altitude: m.
        drive_torque: what the engine torque gives in steady running, N·m.
        brake_torque: N·m.
        total_ratio: engine speed over wheel speed; 0 with the clutch open.
        engine_torque: N·m.
        engine_speed: rad/s.
        gear_ratio: of the transmission alone; 0 with the clutch open.
        brake: 1 where the pedal is pressed, else 0.
    """

    time: Array
    distance: Array
    velocity: Array
    acceleration: Array
    grade: Array
    altitude: Array
    drive_torque: Array
    brake_torque: Array
    total_ratio: Array
    engine_torque: Array
    engine_speed: Array
    gear_ratio: Array
    brake: Array


class _Row(NamedTuple):
    motion: Motion
    acceleration: Any
    command: Command


@eqx.filter_jit
def _run(driver: Driver, road: GradeProfile, target: Any, target_accel: Any) -> _Row:
    def substep(state: tuple[Motion, DriverState], plan: Any) -> tuple[Any, _Row]:
        motion, person = state
        speed, slope = plan
        grade = road.grade(motion.distance)
        person, command = driver.drive(person, motion.velocity, grade, speed, slope, STEP)
        acceleration = driver.plant.acceleration(motion.velocity, grade, command.push)
        row = _Row(motion, acceleration, command)
        return (driver.plant.step(motion, road, command.push, STEP), person), row

    def sample(state: tuple[Motion, DriverState], plan: Any) -> tuple[Any, _Row]:
        state, rows = jax.lax.scan(substep, state, plan)
        return state, jax.tree.map(lambda a: a[0], rows)

    start = Motion(jax.numpy.zeros(()), target[0, 0])
    return jax.lax.scan(sample, (start, driver.init(target[0, 0])), (target, target_accel))[1]


def follow(driver: Driver, road: GradeProfile, plan: SpeedPlan) -> Truth:
    """Drive a plan along a road, integrated at 1 kHz and kept at 100 Hz.

    Args:
        driver: with the car that is driven.
        road: its grade; the drive begins at distance 0.
        plan: T = 100 · duration samples.
    """
    count = round(plan.duration / SAMPLE_STEP)
    fine = np.arange(count * _SUBSTEPS) * STEP
    knots, speeds = np.asarray(plan.time), np.asarray(plan.speed)
    slopes = np.diff(speeds) / np.diff(knots)
    section = np.clip(np.searchsorted(knots, fine, side="right") - 1, 0, len(slopes) - 1)
    as_rows = partial(np.reshape, shape=(count, _SUBSTEPS))
    rows = _run(driver, road, as_rows(np.interp(fine, knots, speeds)), as_rows(slopes[section]))
    command, distance = rows.command, rows.motion.distance
    columns = {
        "time": np.arange(count) * SAMPLE_STEP,
        "distance": distance,
        "velocity": rows.motion.velocity,
        "acceleration": rows.acceleration,
        "grade": road.grade(distance),
        "altitude": road.altitude(distance),
        **command.push._asdict(),
        **{name: value for name, value in command._asdict().items() if name != "push"},
    }
    return Truth(**{name: np.asarray(values, dtype=np.float64) for name, values in columns.items()})
