"""Drives on which the friction estimators' own model holds exactly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from roadstate.core import WHEELS, Log
from roadstate.core.constants import GRAVITY
from roadstate.papers.friction_measures import flat_car
from roadstate.sim.manoeuvres import manoeuvre
from roadstate.sim.run import drive, truth_table
from roadstate.sim.sensors import measure, sensor_preset, to_log
from roadstate.vehicles import Vehicle, load_vehicle

Array = NDArray[np.float64]
RATE = 100.0
FRICTION = 0.6


def level_car() -> Vehicle:
    """A car whose body neither pitches nor rolls, its stiffnesses those at a friction of one."""
    car = load_vehicle("family-car")
    still = {"pitch_gradient": 0.0, "roll_gradient": 0.0}
    return car.model_copy(
        update={
            "body": car.body.model_copy(update=still),
            "tires": car.tires.model_copy(update={"friction": 1.0}),
        }
    )


def lane_change(sensors: str = "ideal", seed: int = 0) -> Log:
    """A double lane change at 60 km/h by the plant with seven degrees of freedom."""
    car = level_car()
    made = manoeuvre("double-lane-change").prepare(car, speed=60 / 3.6, friction=FRICTION)
    table = truth_table(drive(flat_car(car), made, car))
    return to_log(measure(table, sensor_preset(sensors), seed=seed))


def force_share(vehicle: Vehicle, slip: Array) -> Array:
    """F⁰/F_z of the normalised Dugoff for a longitudinal slip alone, by hand."""
    reach = vehicle.tires.slip_stiffness / vehicle.tires.friction * slip / (1 + slip)
    size = np.abs(reach)
    return np.where(size < 0.5, reach, np.sign(reach) * (1 - 1 / (4 * np.maximum(size, 0.5))))


def pull(vehicle: Vehicle, friction: Array, slip: Array, speed: float, *, noise: float = 0.0) -> Log:
    """Straight ahead with the same slip at all wheels: m v̇ = μ m g F⁰/F_z − drag, in closed form.

    Args:
        vehicle: level.
        friction, slip: (T,) at 100 Hz.
        speed: at the start, m/s.
        noise: 1σ on a_x, a_y (m/s²) and ṙ (rad/s²).
    """
    random, count = np.random.default_rng(0), len(friction)
    v, accel = np.full(count, speed), np.zeros(count)
    drag = 0.5 * vehicle.aerodynamics.air_density * vehicle.drag_area / vehicle.mass
    share = force_share(vehicle, slip)
    for k in range(count):
        accel[k] = friction[k] * GRAVITY * share[k] - drag * v[k] ** 2
        v[min(k + 1, count - 1)] = v[k] + accel[k] / RATE
    zero = np.zeros(count)
    channels = {f"wheel_speed_{w}": (1 + slip) * v / vehicle.wheels.radius for w in WHEELS}
    channels |= {"speed": v, "velocity_y": zero, "yaw_rate": zero, "steer": zero}
    for name, value in (("accel_x", accel), ("accel_y", zero), ("yaw_accel", zero)):
        channels[name] = value + noise * random.standard_normal(count)
    channels |= {f"ref_friction_{w}": friction for w in WHEELS}
    channels |= {"ref_velocity_x": v, "ref_velocity_y": zero}
    return Log(np.arange(count) / RATE, channels)
