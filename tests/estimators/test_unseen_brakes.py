"""Drives of a car whose torque is known while nothing tells of its brakes."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import WHEELS, Log
from roadstate.core.constants import GRAVITY
from roadstate.estimators import build
from roadstate.estimators.shortfall import Shortfall
from roadstate.estimators.signals import Held
from roadstate.estimators.unseen_brakes import BrakeWatch
from roadstate.run import scan
from roadstate.vehicles import Vehicle

DT = 0.01
Array = NDArray[np.float64]


def watched(*parts: tuple[float, float, float], forward: float = 1.0) -> BrakeWatch:
    """After parts of a drive: s, specific force, what the drive makes of it (m/s²)."""
    watch = BrakeWatch.none()
    for seconds, accel, push in parts:
        for _ in range(round(seconds / DT)):
            held = Held(jnp.asarray(accel), jnp.zeros(()))
            watch = watch.take(held, *map(jnp.asarray, (push, push, forward, DT)))
    return watch


@pytest.mark.parametrize(
    ("parts", "seems", "possible"),
    [
        ([(0.2, 1.0, 1.0)], False, True),  # the log has just begun
        ([(2.0, 1.0, 1.0)], False, False),
        ([(2.0, 1.0, 1.0), (0.1, -0.7, 0.0)], False, True),  # a brake begins
        ([(2.0, 1.0, 1.0), (1.0, 0.0, 0.0), (0.02, -0.6, 0.0)], False, False),  # the road jolts
        ([(2.0, 1.0, 1.0), (0.5, -0.6, 0.0)], True, True),
        ([(2.0, 1.0, 1.0), (0.5, 0.0, 0.0)], False, False),  # it coasts
        ([(2.0, 0.0, 0.0)], False, True),  # it has done so from the first sample, or dragged a brake
        ([(2.0, -0.5, 0.0)], True, True),
        ([(2.0, -0.5, 0.0), (1.0, 0.8, 0.8)], False, False),  # it drives off
        ([(2.0, 0.2, 0.2)], False, False),  # at constant speed
        ([(2.0, -1.0, -1.0)], False, False),  # in reverse
        ([(2.0, 0.0, 1.0)], True, True),  # with both feet
    ],
)
def test_when_brakes_seem_or_may_act(
    parts: list[tuple[float, float, float]], seems: bool, possible: bool
) -> None:
    watch = watched(*parts)
    assert (bool(watch.seems), bool(watch.possible)) == (seems, possible)


def test_a_road_that_shakes_a_coasting_car_leaves_no_mean() -> None:
    """What is believed of an accelerometer, low-passed as forces are, is not what would push the car only."""
    shaken = 0.4 * np.random.default_rng(0).standard_normal(20_000)
    lag = -np.expm1(-DT / 0.05)
    take = jax.jit(lambda watch, a: watch.take(Held(a, 0.0 * DT), *map(jnp.asarray, (0.0, 0.3, 1.0, DT))))
    watch, low, believed = watched((2.0, 1.0, 1.0)), 0.0, []
    for accel in shaken:
        watch, low = take(watch, jnp.asarray(accel)), low + lag * (accel - low)
        if not watch.possible:
            believed.append(low)
    assert len(believed) > 0.99 * len(shaken)
    assert abs(np.mean(believed)) < 0.01


def test_brakes_push_ahead_a_car_that_backs_up() -> None:
    parts = [(2.0, -1.0, -1.0), (0.5, 0.6, 0.0)]
    assert bool(watched(*parts, forward=-1.0).seems)
    assert not bool(watched(*parts).seems)


@pytest.mark.parametrize("name", ["joint", "tfobe", "debe"])
@pytest.mark.parametrize("brake", [0.15, 0.7])
def test_brakes_that_nothing_tells_of_are_no_bias_and_no_slope(
    vehicle: Vehicle, drive: Callable[..., Log], name: str, brake: float
) -> None:
    """The log begins under brakes, gentle or not, of which the accelerometer could be blamed."""
    gains = np.repeat([-brake, 0.0, 0.8, 0.3, -brake, 0.6], 700)
    speed = 15 + np.cumsum(gains) * DT
    log = drive(speed, np.full(len(speed), 0.02))
    rng = np.random.default_rng(1)
    seen = {c: v for c, v in log.channels.items() if "brake" not in c}
    seen |= {c: 0.001 * rng.standard_normal(len(speed)) for c in ("accel_y", "yaw_rate", "steer")}
    seen["accel_x"] = seen["accel_x"] + 0.02 * rng.standard_normal(len(speed))
    log = Log(log.time, seen)
    found = scan(build(name, vehicle, log.available), log)
    error, std = found.values["grade"] - 0.02, found.std["grade"]
    assert np.mean((np.abs(error) < 2 * std)[log.time > 1]) > 0.98
    assert np.abs(error)[log.time > 21].max() < {"joint": 0.004, "tfobe": 0.02, "debe": 0.06}[name]


def pressed(*parts: tuple[float, float, float]) -> Shortfall:
    """After parts of a drive: s, specific force that is missing and 1σ of what is foreseen (m/s²)."""
    short = Shortfall.none()
    for seconds, missing, std in parts:
        for _ in range(round(seconds / DT)):
            short = short.take(*map(jnp.asarray, (-missing, std, 1.0, DT)))
    return short


@pytest.mark.parametrize(
    ("parts", "is_brake"),
    [
        ([(0.1, 0.3, 0.01)], True),  # well before a slower watch has seen it
        ([(2.0, 0.1, 0.01)], False),
        ([(2.0, 0.3, 0.12)], False),  # the mass, say, is not known yet
        ([(2.0, -1.0, 0.01)], False),  # more than is foreseen is no brake's
        ([(2.0, 0.3, 0.01), (0.2, 0.0, 0.01)], False),
        ([(2.0, 0.3, 0.01), (2.0, np.nan, 0.01)], True),  # nothing comes
    ],
)
def test_what_the_filter_misses_is_a_brake(parts: list[tuple[float, float, float]], is_brake: bool) -> None:
    assert bool(pressed(*parts).is_brake) == is_brake


def test_white_noise_that_is_muted_has_no_mean() -> None:
    """As many samples too high as too low are believed: the verdict is on the next one."""
    noise = 0.3 * np.random.default_rng(0).standard_normal(20_000)
    short, believed = Shortfall.none(), []
    take = jax.jit(lambda short, now: short.take(now, jnp.asarray(0.01), jnp.ones(()), jnp.asarray(DT)))
    for now in noise:
        if not short.is_brake:
            believed.append(now)
        short = take(short, now)
    assert 1000 < len(believed) < len(noise) - 100
    assert abs(np.mean(believed)) < 3 * 0.3 / len(believed) ** 0.5


@pytest.mark.parametrize(("gain", "against"), [(-0.65, 0.0), (-0.1, 0.25)])
def test_brakes_that_rub_are_no_bias(
    vehicle: Vehicle, drive: Callable[..., Log], gain: float, against: float
) -> None:
    """A quarter of a m/s² for 20 s, with the drive idle or against it, in a log whose start tells bias and
    slope apart."""
    gains = np.concatenate([np.tile(np.repeat([0.8, 0.1], 300), 3), np.full(2000, gain), np.full(600, 0.5)])
    speed = 15 + np.cumsum(gains) * DT
    log = drive(speed, np.full(len(speed), 0.02), accel_bias=0.05)
    rng = np.random.default_rng(2)
    seen = {c: v for c, v in log.channels.items() if "brake" not in c}
    seen |= {c: 0.001 * rng.standard_normal(len(speed)) for c in ("accel_y", "yaw_rate", "steer")}
    seen["accel_x"] = seen["accel_x"] + 0.02 * rng.standard_normal(len(speed))
    rubs = (log.time > 18) & (log.time <= 38)
    for wheel in ("fl", "fr"):
        torque = against * vehicle.mass * vehicle.wheels.radius / 2
        seen[f"drive_torque_{wheel}"] = seen[f"drive_torque_{wheel}"] + torque * rubs
    log = Log(log.time, seen)
    found = scan(build("joint", vehicle, log.available), log)
    error, std = found.values["grade"] - 0.02, found.std["grade"]
    assert np.mean((np.abs(error) < 2 * std)[log.time > 1]) > 0.95
    assert np.abs(error)[log.time > 18].max() < 0.006


@pytest.mark.parametrize("lags", [(0.0, 0.6, 0.26, 0.28), (0.5, 0.52, 0.5, 0.51)])
def test_wheels_that_agree_by_chance_under_brakes_that_nothing_tells_of(
    vehicle: Vehicle, lags: tuple[float, ...]
) -> None:
    """The log begins under anti-lock brakes on ice, when both rear wheels, or all of them, slip alike."""
    time = np.arange(800) * DT
    speed = 16 - 0.9 * np.minimum(time, 6) + 0.4 * np.maximum(time - 6, 0)
    phase = 2 * np.pi * (1.3 * time[:, None] - np.array(lags))
    slip = np.where(time[:, None] < 6, 0.2 * (1 - np.cos(phase)), 0.0)
    noise = np.random.default_rng(0).standard_normal((6, len(time)))
    gain = np.gradient(speed, DT)
    drag = 0.5 * vehicle.aerodynamics.air_density * vehicle.drag_area * speed**2 / vehicle.mass
    force = vehicle.mass * (gain + drag + GRAVITY * vehicle.rolling_resistance.coefficient)
    torque = np.where(time < 6, 0.0, 0.5 * vehicle.wheels.radius * force)
    channels = {
        "accel_x": (1 + GRAVITY * vehicle.body.pitch_gradient) * gain + 0.05 * noise[4],
        **{
            f"wheel_speed_{w}": (1 - slip[:, i]) * speed / vehicle.wheels.radius + 0.05 * noise[i]
            for i, w in enumerate(WHEELS)
        },
        **{f"drive_torque_{w}": torque + noise[5] for w in ("fl", "fr")},
    }
    log = Log(time, channels)
    found = scan(build("joint", vehicle, log.available), log)
    error, std = np.abs(found.values["speed"] - speed), found.std["speed"]
    assert error[time > 0.5].max() < 2.0
    assert np.mean(error < 2 * std) > 0.9
    grade = np.abs(found.values["grade"])
    assert np.mean(grade < 2 * found.std["grade"]) > 0.95
