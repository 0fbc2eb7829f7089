"""Logs that begin on ice: wheels that spin or lock from the first sample on, and no receiver."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import WHEELS, Estimates, Log
from roadstate.core.constants import GRAVITY
from roadstate.estimators import Estimator, build
from roadstate.run import scan
from roadstate.vehicles import Vehicle

Array = NDArray[np.float64]
Drive = Callable[..., Log]
RATE = 100.0
TIME = np.arange(2000) / RATE


@pytest.fixture(scope="module")
def estimator(vehicle: Vehicle) -> Estimator:
    """Of a car with front-wheel drive, whose bus tells torques."""
    torques = [f"{kind}_torque_{w}" for kind in ("drive", "brake") for w in WHEELS]
    wheels = [f"wheel_speed_{w}" for w in WHEELS]
    return build("joint", vehicle, [*wheels, *torques, "accel_x"])


def on_ice(vehicle: Vehicle, speed: Array, slips: Array, grade: float | Array) -> Log:
    """Wheels that slip as (4, T) says, and torques that do not turn them: what they push is less.

    Args:
        vehicle: the car.
        speed: (T,) m/s.
        slips: practical slips of the wheels.
        grade: rad, (T,) or of all of the road.
    """
    rng = np.random.default_rng(0)
    slope = np.gradient(speed, 1 / RATE)
    pitch = 1 + GRAVITY * vehicle.body.pitch_gradient
    felt = slope + GRAVITY * np.sin(grade)
    drag = 0.5 * vehicle.aerodynamics.air_density * vehicle.drag_area * speed**2
    rolling = vehicle.rolling_resistance.coefficient * vehicle.mass * GRAVITY
    force = vehicle.mass * felt + drag + rolling
    spin = speed * (1 + slips) / vehicle.wheels.radius
    inertia = vehicle.wheels.inertia * np.gradient(spin, 1 / RATE, axis=1)
    # all of the drive is the front axle's; brakes are everybody's
    share = np.where(force > 0, np.array([0.5, 0.5, 0.0, 0.0])[:, None], 0.25)
    torque = share * force * vehicle.wheels.radius + inertia
    channels = {"accel_x": pitch * felt + 0.05 * rng.normal(size=len(speed)), "ref_velocity_x": speed}
    for i, wheel in enumerate(WHEELS):
        channels[f"wheel_speed_{wheel}"] = spin[i] + 0.05 * rng.normal(size=len(speed))
        channels[f"drive_torque_{wheel}"] = np.where(force > 0, torque[i], 0.0)
        channels[f"brake_torque_{wheel}"] = np.where(force > 0, 0.0, np.maximum(-torque[i], 0.0))
    return Log(TIME, channels)


def honest(said: Estimates, speed: Array, grade: float, error: float) -> None:
    """From a second on the speed within ``error`` (m/s); from the first sample on within three of its σ, as
    the slope."""
    off, slope = said.values["speed"] - speed, said.values["grade"] - grade
    assert np.abs(off[TIME > 1]).max() < error
    assert np.mean(np.abs(off) < 3 * said.std["speed"]) > 0.99
    assert np.abs(slope).max() < 0.05 + 3 * said.std["grade"].max()
    assert np.mean(np.abs(slope) < 3 * said.std["grade"]) > 0.97


def test_driven_wheels_that_spin_from_the_first_sample_on(vehicle: Vehicle, estimator: Estimator) -> None:
    """They spin up by a half and more; the others roll, and tell the speed."""
    speed = 8 + 0.3 * TIME
    slips = np.zeros((4, len(TIME)))
    slips[0] = 0.6 + 0.3 * np.sin(2 * np.pi * 0.8 * TIME)
    slips[1] = 0.2 + 0.15 * np.sin(2 * np.pi * 0.5 * TIME)
    said = scan(estimator, on_ice(vehicle, speed, slips, 0.02))
    honest(said, speed, 0.02, 0.4)


@pytest.mark.parametrize("phase", [0.0, 2.0, 4.0])
def test_wheels_under_anti_lock_brakes_from_the_first_sample_on(
    vehicle: Vehicle, estimator: Estimator, phase: float
) -> None:
    """None rolls at the first sample but the fastest; after that now one comes up to the car's speed, now
    another: to 3 % of it, at 17 m/s half a metre per second."""
    speed = 17.5 - 0.5 * TIME
    phases = phase + np.array([0.0, 2.0, 4.0, 5.0])[:, None]
    slips = -0.3 - 0.27 * np.cos(2 * np.pi * 1.3 * TIME + phases)
    said = scan(estimator, on_ice(vehicle, speed, slips, -0.05))
    honest(said, speed, -0.05, 1.0)


@pytest.mark.parametrize("reads", [0.0, 0.8, 1.2])
def test_one_wheel_that_lies_from_the_first_sample_on(
    vehicle: Vehicle, estimator: Estimator, reads: float
) -> None:
    """Brakes act on all of them; the other three agree, and do not race: they are taken."""
    speed = 18 - 0.5 * TIME
    log = on_ice(vehicle, speed, np.zeros((4, len(TIME))), 0.01)
    log = log.with_channels({"wheel_speed_fl": reads * log["wheel_speed_fl"]})
    said = scan(estimator, log)
    honest(said, speed, 0.01, 0.3)


def test_a_filter_astray_is_brought_back_by_wheels_that_roll(
    vehicle: Vehicle, estimator: Estimator, drive: Drive
) -> None:
    """No wheel's speed comes for two seconds, in which the accelerometer lies."""
    rng = np.random.default_rng(0)
    speed = 12 + np.sin(2 * np.pi * TIME / 7)
    log = drive(speed, np.zeros(len(TIME)))
    lies = (TIME > 5) & (TIME < 7)
    channels = {c: log[c] + 0.05 * rng.normal(size=len(TIME)) for c in log.channels}
    channels |= {c: np.where(lies, np.nan, v) for c, v in channels.items() if c.startswith("wheel_speed")}
    channels["accel_x"] += 3.0 * lies
    said = scan(estimator, log.with_channels(channels))
    after = TIME > 10
    np.testing.assert_allclose(said.values["speed"][after], speed[after], atol=0.3)
    assert np.abs(said.values["grade"][TIME > 12]).max() < 0.03


@pytest.mark.parametrize("phase", [0.0, 1.0, 2.0])
def test_anti_lock_brakes_that_hold_every_wheel_below_the_speed_for_long(
    vehicle: Vehicle, estimator: Estimator, phase: float
) -> None:
    """What all wheels err by lasts: samples of 18 s do not average it away."""
    braking = np.maximum(TIME - 2, 0.0)
    speed = 22 - 0.6 * braking
    phases = phase + np.array([0.0, 2.0, 4.0, 5.0])[:, None]
    slips = (-0.3 - 0.24 * np.cos(2 * np.pi * 1.3 * TIME + phases)) * np.minimum(braking / 0.3, 1.0)
    said = scan(estimator, on_ice(vehicle, speed, slips, -0.01))
    off = np.abs(said.values["speed"] - speed)
    assert off.max() < 1.6
    assert np.mean(off < 1.96 * said.std["speed"]) > 0.95


def test_wheels_that_anti_lock_brakes_let_go_are_not_ahead_of_the_car(
    vehicle: Vehicle, estimator: Estimator
) -> None:
    """Let go, they roll, though brakes act; and they come back so swiftly that they are read as faster."""
    braking = np.clip(TIME - 10, 0.0, 3.0)
    speed = 27 - 8 * braking
    cycle = (3 * TIME + np.array([0.0, 0.05, 0.4, 0.5])[:, None]) % 1
    locks = np.interp(cycle, [0.0, 0.3, 0.7, 0.8, 1.0], [0.0, -0.03, -0.35, 0.0, 0.0])
    begun = (TIME > 10) & (speed > 3)
    log = on_ice(vehicle, speed, np.where(begun, locks, 0.0), 0.0)
    ahead = np.where(begun & (cycle > 0.8) & (cycle < 0.86), 0.8 / vehicle.wheels.radius, 0.0)
    log = log.with_channels(
        {f"wheel_speed_{w}": log[f"wheel_speed_{w}"] + ahead[i] for i, w in enumerate(WHEELS)}
    )
    said = scan(estimator, log)
    off = said.values["speed"] - speed
    assert np.abs(off[begun]).max() < 0.35
    assert np.mean(np.abs(off) < 1.96 * said.std["speed"]) > 0.95


@pytest.mark.parametrize("phase", [0.0, 0.3])
def test_wheels_that_anti_lock_brakes_let_go_bound_the_speed(
    vehicle: Vehicle, estimator: Estimator, phase: float
) -> None:
    """The road falls away as brakes come on, which the accelerometer takes for braking; a car is no slower
    than the fastest of its wheels, which tells the slope."""
    braking = np.clip(TIME - 10, 0.0, 5.0)
    speed = 27 - 4 * braking
    cycle = (3 * TIME + phase + np.array([0.0, 0.05, 0.4, 0.5])[:, None]) % 1
    locks = np.interp(cycle, [0.0, 0.3, 0.7, 0.9, 1.0], [0.0, -0.03, -0.35, 0.0, 0.0])
    grade = -0.03 * np.clip(TIME - 10, 0.0, 1.0)
    said = scan(estimator, on_ice(vehicle, speed, np.where((braking > 0) & (braking < 5), locks, 0.0), grade))
    off, slope = said.values["speed"] - speed, said.values["grade"] - grade
    late = (braking > 2) & (braking < 5)
    assert off[late].min() > -0.45
    assert np.sqrt(np.mean(slope[late] ** 2)) < 0.012
    assert np.mean(np.abs(off) < 1.96 * said.std["speed"]) > 0.99
