"""Speed where a satellite receiver tells it late, and rolling radii are not those of the file."""

from __future__ import annotations

import numpy as np
import pytest

from roadstate.core import WHEELS, Log
from roadstate.core.constants import GRAVITY
from roadstate.estimators import build
from roadstate.run import scan
from roadstate.vehicles import Vehicle

RATE = 100.0
NOISE = 0.05  # m/s, 1σ of a sample of the receiver


def braking(
    vehicle: Vehicle, *, late: float, bigger: float, seed: int, rate: float = 4.0
) -> tuple[Log, np.ndarray]:
    """Straight and level: 4 s at 25 m/s, then down to 9 m/s, and on; and the true speed.

    Args:
        vehicle: its tires slip in proportion to the force.
        late: s by which the receiver's speed, ten times a second, comes late.
        bigger: rolling radius over the file's.
        seed: of the sensors' noise.
        rate: m/s² by which the car brakes.
    """
    random = np.random.default_rng(seed)
    time = np.arange(0.0, 12.0, 1 / RATE)
    end = 4.0 + 16.0 / rate
    accel = np.interp(time, [4.0, 4.1, end, end + 0.1], [0.0, -rate, -rate, 0.0])
    v = 25.0 + np.cumsum(accel) / RATE
    slip = accel / GRAVITY / vehicle.tires.slip_stiffness
    told = np.interp(time - late, time, v) + NOISE * random.normal(size=len(time))
    told[np.arange(len(time)) % 10 != 0] = np.nan
    noise = random.normal(size=(7, len(time)))
    spin = v * (1 + slip) / (bigger * vehicle.wheels.radius)
    return Log(
        time,
        {
            "accel_x": accel + 0.05 * noise[0],
            "accel_y": 0.05 * noise[1],
            "yaw_rate": 0.002 * noise[2],
            "steering_wheel": np.zeros(len(time)),
            "speed": told,
            **{f"wheel_speed_{w}": spin + 0.05 * noise[3 + i] for i, w in enumerate(WHEELS)},
        },
    ), v


@pytest.mark.parametrize("late", [0.0, 0.06, 0.12])
@pytest.mark.parametrize("bigger", [0.99, 1.01])
def test_speed_while_braking(vehicle: Vehicle, late: float, bigger: float) -> None:
    log, true = braking(vehicle, late=late, bigger=bigger, seed=1)
    found = scan(build("joint", vehicle, log.available), log)
    error, std = found.values["speed"] - true, found.std["speed"]
    assert np.abs(error / std).max() < 2.5
    assert np.abs(error[200:]).max() < 0.16


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_all_that_comes_over_a_bus_may_be_late(vehicle: Vehicle, seed: int) -> None:
    """Receiver, wheels and accelerometer by 10 ms alike, which nothing contradicts: σ allows for it."""
    log, true = braking(vehicle, late=0.01, bigger=1.0, seed=seed, rate=9.0)
    late = {c: np.interp(log.time - 0.01, log.time, log[c]) for c in log.available if c != "speed"}
    found = scan(build("joint", vehicle, log.available), log.with_channels(late))
    brakes = (log.time > 4.3) & (log.time < 5.7)
    error, std = (found.values["speed"] - true)[brakes], found.std["speed"][brakes]
    assert np.median(error) > 0.06
    assert np.mean(np.abs(error) < 1.96 * std) > 0.95


@pytest.mark.parametrize("bigger", [0.92, 0.95, 1.05, 1.08])
def test_wheels_of_another_car(vehicle: Vehicle, bigger: float) -> None:
    """A vehicle file that is only nearly the car's: the receiver is right, and nothing is at fault."""
    log, true = braking(vehicle, late=0.06, bigger=bigger, seed=1)
    found = scan(build("joint", vehicle, log.available), log)
    assert not found.metadata["faults"]
    error, std = found.values["speed"] - true, found.std["speed"]
    assert np.mean(np.abs(error / std)[100:] < 1.96) > 0.9
    assert np.abs(error[300:]).max() < 0.25


def test_one_sample_of_everything_is_no_exact_speed(vehicle: Vehicle) -> None:
    log, _ = braking(vehicle, late=0.06, bigger=1.0, seed=2)
    first = scan(build("joint", vehicle, log.available), log).std["speed"][0]
    radius = vehicle.sensors.wheel_speed.scale * 25.0
    assert first > 0.7 / np.hypot(1 / vehicle.sensors.speed.noise, 1 / radius)


def test_a_receivers_speed_is_over_ground(vehicle: Vehicle) -> None:
    """Up a slope of 16 % a car is 1.3 % faster than its receiver says; a bus says what it is."""
    random = np.random.default_rng(3)
    time = np.arange(0.0, 30.0, 1 / RATE)
    grade, v = np.arctan(0.16), 20.0
    told = v + NOISE * random.normal(size=len(time))
    told[np.arange(len(time)) % 20 != 0] = np.nan
    noise = random.normal(size=(5, len(time)))
    channels = {
        "accel_x": GRAVITY * np.sin(grade) + 0.05 * noise[0],
        **{f"wheel_speed_{w}": v / vehicle.wheels.radius + 0.05 * noise[1 + i] for i, w in enumerate(WHEELS)},
    }
    level = np.cos(grade) * told
    climb = np.sin(grade) * told
    received = Log(time, {**channels, "speed": level, "vertical_speed": climb})
    of_bus = Log(time, {**channels, "speed": told})
    for log in (received, of_bus):
        found = scan(build("joint", vehicle, log.available), log)
        assert found.values["speed"][2000:].mean() == pytest.approx(v, abs=0.06)
