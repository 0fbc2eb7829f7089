"""Torques that come a few times a second, as a diagnostic plug gives them, and no word on brakes."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import WHEELS, Log
from roadstate.estimators import Estimator, build
from roadstate.estimators.traction import TractionMeter, TractionState
from roadstate.run import scan
from roadstate.vehicles import Vehicle

pytestmark = pytest.mark.usefixtures("optimised")

Array = NDArray[np.float64]
RATE = 100.0
TIME = np.arange(12000) / RATE
DRIVES = ("drive_torque_fl", "drive_torque_fr")


def pedalled(seed: int) -> Array:
    """Speed of a driver whose foot goes up and down with the traffic, and rests as often."""
    rng = np.random.default_rng(seed)
    places = np.arange(0, TIME[-1] + 4, 1.2)
    pushes = np.where(rng.random(len(places)) < 0.5, 0.0, rng.normal(scale=1.5, size=len(places)))
    rate = np.interp(TIME, places, pushes)
    return np.maximum(18 + np.cumsum(rate - rate.mean()) / RATE, 5.0)


def coasting(drive: Callable[..., Log], seed: int, every: int) -> Log:
    """A level road; the car never brakes but by its engine and the air. One torque in ``every`` is told."""
    whole = drive(pedalled(seed), np.zeros(len(TIME)))
    channels = {c: v for c, v in whole.channels.items() if not c.startswith("brake")}
    held_back = whole[DRIVES[0]] - 2 * whole["brake_torque_fl"]
    for name in DRIVES:
        channels[name] = np.where(np.arange(len(TIME)) % every == 0, held_back, np.nan)
    noise = np.random.default_rng(seed + 100).normal(size=len(TIME))
    channels["accel_x"] = channels["accel_x"] + 0.05 * noise
    return Log(TIME, channels)


def errors_of(estimator: Estimator, logs: list[Log]) -> tuple[float, float]:
    """Of grade on a level road, from 20 s on: root mean square, and share within ±1.96 σ."""
    told = [scan(estimator, log) for log in logs]
    off, std = (
        np.concatenate([part["grade"][TIME > 20] for part in parts])
        for parts in ([e.values for e in told], [e.std for e in told])
    )
    return float(np.sqrt(np.mean(off**2))), float(np.mean(np.abs(off) < 1.96 * std))


@pytest.fixture(scope="module")
def estimator(vehicle: Vehicle) -> Estimator:
    return build("joint", vehicle, [*(f"wheel_speed_{w}" for w in WHEELS), *DRIVES, "accel_x"])


@pytest.mark.parametrize("every", [1, 20, 50])
def test_what_drive_does_between_its_samples_is_no_brake(
    estimator: Estimator, drive: Callable[..., Log], every: int
) -> None:
    error, inside = errors_of(estimator, [coasting(drive, seed, every) for seed in range(4)])
    assert error < 0.0035
    assert inside > 0.93


@pytest.mark.parametrize(("name", "most", "least"), [("debe", 0.014, 0.98), ("tfobe", 0.016, 0.7)])
def test_torques_twice_a_second_tell_little_of_what_is_between_them(
    vehicle: Vehicle, drive: Callable[..., Log], name: str, most: float, least: float
) -> None:
    """Held for true they made errors of 1.6 and 3.6 %, of which nine in ten and four in ten were inside."""
    still = dict.fromkeys(("accel_y", "yaw_rate", "steer", "brake"), np.zeros(len(TIME)))
    logs = [coasting(drive, seed, 50).with_channels(still) for seed in range(4)]
    error, inside = errors_of(build(name, vehicle, logs[0].available), logs)
    assert error < most
    assert inside > least


@pytest.mark.parametrize("gap", [0.0, 0.2, 0.5])
def test_a_torque_that_is_held_errs_by_what_it_has_changed(vehicle: Vehicle, gap: float) -> None:
    """Against a random walk, of which each sample is held: the error's own mean square."""
    rng = np.random.default_rng(0)
    meter, dt = TractionMeter(vehicle, DRIVES), 0.01
    truth = np.cumsum(rng.normal(scale=20.0, size=20000))  # N·m, at each front wheel
    every = max(round(gap / dt), 1)
    told = np.where(np.arange(len(truth)) % every == 0, truth, np.nan)
    force, held = _held(meter, told, dt)
    error = force - 2 * truth / vehicle.wheels.radius
    late = slice(5000, None)
    measured = np.sqrt(np.mean(error[late] ** 2))
    assert np.sqrt(np.mean(held[late] ** 2)) == pytest.approx(measured, rel=0.25, abs=1e-9)


def _held(meter: TractionMeter, told: Array, dt: float) -> tuple[Array, Array]:
    """Force and 1σ of what it may have changed by, N, at each sample of both torques."""

    def body(state: TractionState, torque: jax.Array) -> tuple[TractionState, tuple[jax.Array, jax.Array]]:
        sample = dict.fromkeys(DRIVES, torque)
        state, drive = meter.read(state, sample, jnp.asarray(15.0), jnp.asarray(dt))
        return state, (drive.force, drive.held_std)

    _, (force, held) = jax.jit(lambda z: jax.lax.scan(body, meter.init(), z))(jnp.asarray(told))
    return np.asarray(force), np.asarray(held)
