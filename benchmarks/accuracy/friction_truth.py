"""A recorded drive as the ideal filter of :mod:`benchmarks.accuracy.friction_bound` linearises about it."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from roadstate.core import WHEELS, Log
from roadstate.sim.plant import multibody_plant
from roadstate.tires.magic_formula import MagicFormula
from roadstate.vehicles import Vehicle

SLOWEST = 2.0
"""m/s under which slips are no longer taken for known, and tires tell nothing."""
_SHORTEST = 0.01  # m: floor of the plant's relaxation lengths
_ALIKE = 1e-3  # peak frictions that are of one piece of road
_TINY = 1.0  # N of elastic force under which the secant of the force is its slope


class Truth(NamedTuple):
    """(T,) of the car, (T, 4) of its wheels.

    Attributes:
        velocity_x, velocity_y: of the centre of gravity, m/s.
        yaw_rate: rad/s.
        steer: angle of each wheel, rad.
        kappa, alpha: slips that the forces have, which lag behind the wheels' motion; -, rad.
        load: N.
        friction: peak friction coefficients.
        grippy: how far each wheel stands on the less slippery of the drive's two pieces of road, 0 to 1; all
            0 where there is but one.
        force_x, force_y: in the wheels' frames, N.
        drive_torque, brake_torque: as reported, N·m; the brakes' as amounts.
    """

    velocity_x: Any
    velocity_y: Any
    yaw_rate: Any
    steer: Any
    kappa: Any
    alpha: Any
    load: Any
    friction: Any
    grippy: Any
    force_x: Any
    force_y: Any
    drive_torque: Any
    brake_torque: Any


def plant_tire(vehicle: Vehicle) -> MagicFormula:
    """The tire of the plant that the benchmark drives."""
    return multibody_plant(vehicle).tires.model


def truth_of(log: Log, vehicle: Vehicle, tire: MagicFormula) -> Truth:
    """What was true on a drive; where the log does not hold it, what follows from what it holds.

    The rear wheels do not steer: their slip angles tell the yaw rate, and with it those of the front wheels
    tell how they are steered.

    Args:
        log: with the truth, and the torques that were reported.
        vehicle: that was driven.
        tire: its tires.
    """
    speed, across = log["ref_velocity_x"], log["ref_velocity_y"]
    kept = np.maximum(speed, SLOWEST)
    angle, load, friction = (_wheels(log, f"ref_{name}") for name in ("slip_angle", "load", "friction"))
    geometry = vehicle.geometry
    yaw_rate = (across + kept * angle[:, 2:].mean(axis=1)) / geometry.cg_to_rear_axle
    yaw_rate = np.where(speed > SLOWEST, yaw_rate, 0.0)
    beside = 0.5 * geometry.track_front * np.array([1.0, -1.0])
    ahead = across + geometry.cg_to_front_axle * yaw_rate
    heading = np.arctan2(ahead[:, None], kept[:, None] - beside * yaw_rate[:, None])
    steer = np.zeros_like(angle)
    steer[:, :2] = np.where(speed[:, None] > SLOWEST, angle[:, :2] + heading, 0.0)
    low, high = friction.min(), friction.max()
    slips = _lagging(tire, _wheels(log, "ref_slip"), angle, load, friction, log.time, speed)
    return Truth(
        velocity_x=speed,
        velocity_y=across,
        yaw_rate=yaw_rate,
        steer=steer,
        kappa=slips[..., 0],
        alpha=np.arctan(slips[..., 1]),
        load=load,
        friction=friction,
        grippy=(friction - low) / (high - low) if high > low + _ALIKE else np.zeros_like(friction),
        force_x=_wheels(log, "ref_force_x"),
        force_y=_wheels(log, "ref_force_y"),
        drive_torque=np.nan_to_num(_wheels(log, "drive_torque")),
        brake_torque=np.abs(np.nan_to_num(_wheels(log, "brake_torque"))),
    )


def _wheels(log: Log, stem: str) -> np.ndarray:
    return np.stack([log[f"{stem}_{w}"] for w in WHEELS], axis=1)


def _lagging(
    tire: MagicFormula,
    slip: np.ndarray,
    angle: np.ndarray,
    load: np.ndarray,
    friction: np.ndarray,
    time: np.ndarray,
    speed: np.ndarray,
) -> np.ndarray:
    """(T, 4, 2) κ' and tan α', which follow the wheels' motion over the relaxation lengths of the plant."""
    stiffness = jnp.stack(tire.stiffnesses(load), axis=-1)
    lengths = jnp.stack(tire.relaxation_lengths(load), axis=-1)
    steady = jnp.stack([jnp.asarray(slip), jnp.tan(angle)], axis=-1)
    rolled, pressed, mu = (
        jnp.asarray(a) for a in (np.abs(speed) * np.diff(time, prepend=time[0]), load, friction)
    )
    return np.asarray(_follow(tire, steady, rolled, pressed, mu, stiffness, lengths))


@eqx.filter_jit
def _follow(
    tire: MagicFormula, steady: Any, rolled: Any, load: Any, friction: Any, stiffness: Any, lengths: Any
) -> Any:
    def step(slip: Any, row: Any) -> tuple[Any, Any]:
        target, distance, pressed, mu, C, length = row
        force = jnp.stack(tire.forces(slip[:, 0], jnp.arctan(slip[:, 1]), pressed, mu, SLOWEST), axis=-1)
        elastic = jnp.linalg.norm(C * slip, axis=-1)
        secant = jnp.linalg.norm(force, axis=-1) / jnp.maximum(elastic, _TINY)
        slope = brush_slope(jnp.where(elastic > _TINY, secant, 1.0))
        sigma = jnp.maximum(length * slope[:, None], _SHORTEST)
        slip = target + (slip - target) * jnp.exp(-distance / sigma)
        return slip, slip

    rows = (steady, rolled, load, friction, stiffness, lengths)
    return jax.lax.scan(step, steady[0], rows)[1]


def brush_slope(secant: Any) -> Any:
    """Slope of a brush tire's force over that at zero slip, by which the plant's carcass shortens its lag.

    With θ from 0 to 1 the secant is 1 − θ + θ²/3 and the slope (1 − θ)² (Pacejka, 3rd ed., §3.2).

    Args:
        secant: of the force over its slope at zero slip, any shape.
    """
    return (0.5 * (jnp.sqrt(jnp.clip(12 * secant - 3, 1.0, 9.0)) - 1)) ** 2
