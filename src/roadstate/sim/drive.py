"""A drive along a road by the longitudinal point-mass model, as exact truth at each instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from roadstate.core.numerics import jit_loop
from roadstate.sim.driver import Command, Driver, DriverState
from roadstate.sim.longitudinal import Motion
from roadstate.sim.roads.grade import GradeProfile
from roadstate.sim.speed_plan import SpeedPlan as SpeedPlan

STEP = 0.001
"""Integration step in s."""
SAMPLE_STEP = 0.01
"""Time between the samples that are kept, in s."""
Array = NDArray[np.float64]

_SUBSTEPS = round(SAMPLE_STEP / STEP)


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


@jit_loop
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
    target, slope = plan.at(fine)
    rows = _run(driver, road, *(of.reshape(count, _SUBSTEPS) for of in (target, slope)))
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
