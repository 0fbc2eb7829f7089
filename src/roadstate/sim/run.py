"""A driver, a plant and a manoeuvre: the drive, and what sensors record of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from roadstate.core import CHANNELS, WHEELS, InputError, Recording
from roadstate.core.channels import RATES, SPECIFIC_FORCES
from roadstate.core.constants import GRAVITY
from roadstate.core.numerics import jit_loop
from roadstate.sim.manoeuvres.base import Manoeuvre
from roadstate.sim.manoeuvres.driver import Driver, seen
from roadstate.sim.plant.base import Controls, Plant, Truth
from roadstate.sim.plant.rollout import start
from roadstate.sim.sensors.faults import Fault
from roadstate.sim.sensors.suite import SensorSuite, measure

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

Array = NDArray[np.floating[Any]]
CONTROL_STEP = 0.01
"""Time between two looks of the driver, s."""
_CHUNK = 250  # looks in one compiled loop


@dataclass(frozen=True)
class Drive:
    """A drive as it was.

    Attributes:
        time: (T,) s.
        truth: (T, …) NumPy arrays.
        controls: (T, …) those in force until then.
        manoeuvre: what was driven.
        vehicle: as the driver knew it.
    """

    time: Array
    truth: Truth
    controls: Controls
    manoeuvre: Manoeuvre
    vehicle: Vehicle


def looks(plant: Plant, driver: Driver, carry: Any, first: Any, count: int, steps: int) -> Any:
    """A chunk of the drive from look number ``first`` on: what to go on with, and its rows.

    Args:
        plant, driver: who drives what.
        carry: state of the plant, of the driver, and controls in force.
        first: number of the first look.
        count: of looks.
        steps: rows per look.
    """
    road = driver.road

    # one loop over rows, in which the driver looks up now and then: the plant, which takes the compiler's
    # time, stands in it once
    def row(carry: Any, k: Any) -> tuple[Any, Any]:
        state, person, held = carry
        now = plant.truth(road, state, held)
        t = (k // steps) * CONTROL_STEP
        decided = driver.controls(person, seen(road, now), t, CONTROL_STEP)
        is_look = k % steps == 0
        person, controls = jax.tree.map(lambda a, b: jnp.where(is_look, a, b), decided, (person, held))
        return (plant.step(road, state, controls, CONTROL_STEP / steps), person, controls), (now, held)

    return jax.lax.scan(row, carry, steps * first + jnp.arange(count * steps))


_roll = jit_loop(looks)


def common_driver(manoeuvre: Manoeuvre, vehicle: Vehicle) -> Driver:
    """The driver of a manoeuvre with tables of one length for most of them, so that they compile once.

    What is added goes on as the tables do beyond their ends. The tables are NumPy's.
    """
    driver = Driver.for_vehicle(manoeuvre, vehicle)
    script, path = _repeated(driver.script.table, 16_384), _repeated(driver.path.table, 4096)
    line = np.asarray(driver.road.line)
    last = line[-1]
    slope = (last[1] + 2 * last[2] + 3 * last[3]) * np.asarray([1.0, 1.0, 0.0, 1.0, 0.0], line.dtype)
    added = np.arange(_room(len(line), 4096) - len(line), dtype=line.dtype)[:, None]
    none = np.zeros_like(slope + added)
    more = np.stack([last.sum(axis=0) + slope * added, slope + none, none, none], axis=1)
    tables = (script, path, np.concatenate([line, more]))
    longer: Driver = eqx.tree_at(lambda d: (d.script.table, d.path.table, d.road.line), driver, tables)
    return longer


def _repeated(table: Any, least: int) -> Array:
    """A table whose last row is repeated until it has a common length."""
    rows = np.asarray(table)
    return np.concatenate([rows, np.repeat(rows[-1:], _room(len(rows), least) - len(rows), axis=0)])


def _room(rows: int, least: int) -> int:
    return max(least, 1 << (rows - 1).bit_length())


def drive(plant: Plant, manoeuvre: Manoeuvre, vehicle: Vehicle, *, rate: float = 100.0) -> Drive:
    """Drive a manoeuvre; the driver looks 100 times a second.

    Args:
        plant: the car.
        manoeuvre: what to drive.
        vehicle: what the driver knows of the car.
        rate: rows per second, a multiple of 100 Hz that the plant's inner step allows.

    Raises:
        InputError: another rate, or a drive whose truth is not finite.
    """
    steps = round(rate * CONTROL_STEP)
    if not 1 <= steps <= 100 or abs(steps / CONTROL_STEP - rate) > 1e-6:
        raise InputError(f"a rate of {rate:g} Hz", mend="choose a multiple of 100 Hz, up to 10 kHz")
    driver = jax.tree.map(jnp.asarray, common_driver(manoeuvre, vehicle))
    state = start(plant, driver.road, manoeuvre.speed, manoeuvre.s, manoeuvre.d)
    carry, chunks = (state, driver.init(), Controls.make()), []
    count = round(manoeuvre.duration / CONTROL_STEP) + 1
    for first in range(0, count, _CHUNK):
        carry, rows = _roll(plant, driver, carry, jnp.asarray(first), _CHUNK, steps)
        chunks.append(jax.tree.map(np.asarray, rows))
    truth, controls = jax.tree.map(lambda *parts: np.concatenate(parts)[: count * steps], *chunks)
    return checked(np.arange(len(truth.position)) / rate, truth, controls, manoeuvre, vehicle)


def checked(time: Array, truth: Truth, controls: Controls, manoeuvre: Manoeuvre, vehicle: Vehicle) -> Drive:
    """The drive, if it is one.

    Raises:
        InputError: its truth is not finite.
    """
    lost = ~np.isfinite(truth.position).all(axis=-1)
    if lost.any():
        raise InputError(
            f"the simulation of '{manoeuvre.name}' breaks down at t={time[int(np.argmax(lost))]:.2f} s",
            mend="lower the speed or check the vehicle's figures",
        )
    return Drive(time, truth, controls, manoeuvre, vehicle)


def truth_table(driven: Drive) -> dict[str, Array]:
    """The drive as columns for :func:`roadstate.sim.sensors.measure`, and as references.

    There is no column of what the plant does not have.
    """
    truth, controls = driven.truth, driven.controls
    # what an accelerometer at rest in this attitude reads: the world's up, times g, in the body's axes
    _, pitch, roll = truth.attitude.T
    up = np.stack([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)])
    kinematic = truth.specific_force.T - GRAVITY * up
    table: dict[str, Any] = {
        "time": driven.time,
        **_named(SPECIFIC_FORCES, truth.specific_force.T),
        **_named(RATES, truth.angular_rate.T),
        **_named(("roll_accel", "pitch_accel", "yaw_accel"), truth.angular_accel.T),
        "speed": truth.planar_velocity[:, 0],
        "velocity_y": truth.planar_velocity[:, 1],
        "kinematic_accel_x": kinematic[0],
        "kinematic_accel_y": kinematic[1],
        **_named(("east", "north", "altitude"), truth.position.T),
        "steering_wheel": controls.steering_wheel,
        "steer": truth.steer[:, :2].mean(axis=1),
        "brake": controls.brake,
        "engine_torque": truth.engine_torque,
        "engine_speed": truth.engine_speed,
        # the plant's is from engine to wheel, the channel's is the gearbox's alone
        "gear_ratio": truth.gear_ratio / driven.vehicle.driveline.final_drive,
        "ref_grade": truth.grade,
        "ref_bank": truth.bank,
        "ref_velocity_x": truth.planar_velocity[:, 0],
        "ref_velocity_y": truth.planar_velocity[:, 1],
    }
    per_wheel = {
        "wheel_speed": truth.wheel_speed,
        "drive_torque": truth.drive_torque,
        "brake_torque": np.abs(np.asarray(truth.brake_torque)),
        "brake_pressure": truth.brake_pressure,
        "ref_friction": truth.friction,
        "ref_force_x": truth.force_x,
        "ref_force_y": truth.force_y,
        "ref_load": truth.load,
        "ref_slip": truth.slip,
        "ref_slip_angle": truth.slip_angle,
    }
    for name, rows in per_wheel.items():
        table |= _named([f"{name}_{w}" for w in WHEELS], np.asarray(rows).T)
    columns = {n: np.asarray(v, np.float64) for n, v in table.items()}
    return {
        n: v
        for n, v in columns.items()
        if (not n.startswith("ref_") or n in CHANNELS) and not np.isnan(v).all()
    }


def _named(names: Sequence[str], rows: Any) -> dict[str, Any]:
    return dict(zip(names, rows, strict=True))


def record(
    driven: Drive,
    suite: SensorSuite,
    *,
    seed: int = 0,
    faults: Sequence[Fault] = (),
    metadata: Mapping[str, Any] | None = None,
) -> Recording:
    """What sensors record of a drive, with the truth in ``ref_*``.

    Args:
        driven: from :func:`drive`.
        suite: the sensors.
        seed: same seed, same bits.
        faults: to put in.
        metadata: more of it, such as the vehicle's name.
    """
    described = {"source": "simulated", "manoeuvre": driven.manoeuvre.name, **(metadata or {})}
    return measure(truth_table(driven), suite, seed=seed, faults=faults, metadata=described)
