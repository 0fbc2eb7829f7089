"""Logs with few samples a second, as buses and loggers thin them out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from benchmarks import slow_samples
from benchmarks.accuracy.measures import relative_error, share_used
from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import SATELLITE, on_plant

from roadstate.core import Log
from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.estimators import build
from roadstate.run import scan
from roadstate.vehicles import Vehicle

_TEETH = 0.2  # rad/s: 1σ of a sample at 100 Hz, of teeth out of place


def slipping(log: Log, vehicle: Vehicle) -> Log:
    """The same with wheels that slip as much as their forces make them."""
    channels = dict(log.channels)
    load = 0.25 * vehicle.mass * GRAVITY
    for wheel in WHEELS:
        drives = log.channels.get(f"drive_torque_{wheel}", 0.0)
        force = (drives - log[f"brake_torque_{wheel}"]) / vehicle.wheels.radius
        share = 1 + force / (vehicle.tires.slip_stiffness * load)
        channels[f"wheel_speed_{wheel}"] = share * log[f"wheel_speed_{wheel}"]
    return Log(log.time, channels)


def thinned(log: Log, every: int, seed: int) -> Log:
    """Every so manieth sample of a log whose wheel speeds and pitch rate are noisy.

    A speed is the way from tooth to tooth over the time: one that is out of place makes it too high, and
    the next too low.
    """
    rng, channels = np.random.default_rng(seed), dict(log.channels)
    for name in log.channels:
        if name.startswith("wheel_speed"):
            place = rng.normal(0, _TEETH / 2**0.5, len(log.time) + 1)
            channels[name] = channels[name] + np.diff(place)
    channels["pitch_rate"] = rng.normal(0, 0.005, len(log.time))
    return Log(log.time[::every], {name: values[::every] for name, values in channels.items()})


@pytest.mark.parametrize("every", [2, 4, 10])
def test_noise_of_few_samples_is_no_slippery_road_and_no_fault(
    vehicle: Vehicle, drive: Callable[..., Log], every: int
) -> None:
    """What a low pass leaves of noise passed for slips, or for a gyroscope that contradicts the motion."""
    speed = 10 + 2 * np.sin(np.arange(0, 60, 0.01) / 5)
    uphill = slipping(drive(speed, np.full(len(speed), 0.03)), vehicle)
    for seed in range(max(3, every)):
        log = thinned(uphill, every, seed)
        said = scan(build("joint", vehicle, log.available), log)
        assert np.min(said.values["friction_peak"]) > 0.7 * vehicle.tires.friction, seed
        assert not said.metadata["faults"], seed
        error = said.values["grade"] - log["ref_grade"]
        assert np.mean(np.abs(error) < 1.96 * said.std["grade"]) > 0.9, seed


@pytest.mark.usefixtures("optimised")
def test_few_samples_of_a_winding_road_tell_no_more_than_many() -> None:
    """What the low pass leaves of an accelerometer's noise grows as samples come seldom: unless that counts,
    friction is told 40 % too high, and at 10 Hz the lower bound too, for a seventh of the time."""
    logs = on_plant("family-car", slow_samples.DRIVES["winding-0.5"], 2)
    for log, car in logs:
        few = slow_samples.thinned(without(log, SATELLITE), 10)
        said = scan(build("joint", car, few.available), few)
        assert np.mean(said.values["friction_peak_lower"] < 0.5) > 0.98
        for axle in ("front", "rear"):
            much = share_used(few, axle) > 0.7
            assert np.median(relative_error(said, few, f"friction_peak_{axle}")[much]) < 15.0
