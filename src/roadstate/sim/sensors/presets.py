"""Sets of sensors by name. Where figures come from: docs/simulation.md."""

from __future__ import annotations

import math
from collections.abc import Callable

from roadstate.core import InputError
from roadstate.core.channels import did_you_mean
from roadstate.core.constants import GRAVITY
from roadstate.sim.sensors.inertial import InertialUnit
from roadstate.sim.sensors.probe import Probe
from roadstate.sim.sensors.satellite import SatelliteReceiver
from roadstate.sim.sensors.suite import SensorSuite
from roadstate.sim.sensors.wheel_pulses import ToothSensor

_DEG = math.pi / 180
_BAR = 1e5


def ideal() -> SensorSuite:
    """No errors; everything at 100 Hz, GNSS at 10 Hz."""
    return SensorSuite(kinematic=Probe(), velocity=Probe(), yaw_accel=Probe())


def paper() -> SensorSuite:
    """White Gaussian noise at 100 Hz and nothing else, as the papers add to their simulators' signals.

    None of the papers prints its noise; the figures are chosen.
    """
    accel, rate, torque = Probe(noise=0.05), Probe(noise=0.2 * _DEG), Probe(noise=10.0)
    return SensorSuite(
        imu=InertialUnit(accel, rate),
        wheel_speed=Probe(noise=0.05),
        steering_wheel=Probe(noise=0.5 * _DEG),
        road_wheel=Probe(noise=0.05 * _DEG),
        drive_torque=torque,
        brake_torque=torque,
        brake_pressure=Probe(noise=0.2 * _BAR, least=0.0),
        engine_torque=Probe(noise=2.0),
        engine_speed=Probe(noise=0.5),
        kinematic=accel,
        velocity=Probe(noise=0.02),
        yaw_accel=Probe(noise=0.05),
        gnss=SatelliteReceiver(
            Probe(rate=10.0, noise=1.0), Probe(rate=10.0, noise=1.5), Probe(rate=10.0, noise=0.05)
        ),
    )


def automotive() -> SensorSuite:
    """Production sensors of a car in good order, on its bus."""
    return SensorSuite(
        imu=InertialUnit(
            accel=Probe(
                bandwidth=50.0,
                gain_std=0.01,
                bias=0.05,
                walk=5e-4,
                noise_density=0.008,
                resolution=0.01,
                limit=4.2 * GRAVITY,
                delay=0.005,
                jitter=0.0005,
            ),
            gyro=Probe(
                bandwidth=50.0,
                gain_std=0.01,
                bias=0.3 * _DEG,
                walk=0.002 * _DEG,
                noise_density=0.01 * _DEG,
                resolution=0.02 * _DEG,
                limit=163 * _DEG,
                delay=0.005,
                jitter=0.0005,
            ),
            place=(-0.3, 0.1, -0.15),
            mounting_std=0.5 * _DEG,
        ),
        wheel_speed=ToothSensor(teeth=48, tooth_error=0.01, resolution=0.02, delay=0.01),
        steering_wheel=Probe(
            bias=1.0 * _DEG,
            gain_std=0.005,
            resolution=0.1 * _DEG,
            limit=780 * _DEG,
            delay=0.005,
            jitter=0.0005,
        ),
        road_wheel=None,
        drive_torque=Probe(gain_std=0.03, bias=5.0, noise=5.0, resolution=1.0, delay=0.02),
        brake_torque=Probe(gain_std=0.05, noise=5.0, resolution=1.0, delay=0.02, is_magnitude=True),
        brake_pressure=Probe(
            rate=50.0,
            bandwidth=50.0,
            gain_std=0.01,
            bias=0.5 * _BAR,
            noise=0.1 * _BAR,
            resolution=0.1 * _BAR,
            least=0.0,
        ),
        engine_torque=Probe(gain_std=0.05, bias=2.0, noise=1.0, resolution=0.5, delay=0.02),
        engine_speed=Probe(noise=0.3, resolution=0.25 * 2 * math.pi / 60, delay=0.01, is_magnitude=True),
        gear_ratio=Probe(rate=50.0, delay=0.02),
        brake=Probe(rate=50.0, delay=0.02, resolution=0.01),
        gnss=_receiver(1.0),
    )


def worn() -> SensorSuite:
    """Cheap, old or badly fitted: three to five times the errors of ``automotive``, and no torque sensor."""
    return SensorSuite(
        imu=InertialUnit(
            accel=Probe(
                bandwidth=20.0,
                gain_std=0.03,
                bias=0.25,
                walk=2e-3,
                noise_density=0.03,
                resolution=0.05,
                limit=2.0 * GRAVITY,
                delay=0.02,
                jitter=0.002,
            ),
            gyro=Probe(
                bandwidth=20.0,
                gain_std=0.03,
                bias=1.0 * _DEG,
                walk=0.01 * _DEG,
                noise_density=0.05 * _DEG,
                resolution=0.1 * _DEG,
                limit=100 * _DEG,
                delay=0.02,
                jitter=0.002,
            ),
            place=(0.8, -0.4, 0.2),
            mounting_std=2.0 * _DEG,
        ),
        wheel_speed=ToothSensor(
            rate=50.0, teeth=44, tooth_error=0.04, resolution=0.05, timeout=0.5, delay=0.02
        ),
        steering_wheel=Probe(
            rate=50.0, bias=4.0 * _DEG, gain_std=0.02, resolution=1.5 * _DEG, delay=0.02, jitter=0.002
        ),
        road_wheel=None,
        drive_torque=None,
        brake_torque=None,
        brake_pressure=Probe(
            rate=20.0,
            gain_std=0.05,
            bias=1.5 * _BAR,
            noise=0.5 * _BAR,
            resolution=0.5 * _BAR,
            delay=0.05,
            least=0.0,
        ),
        engine_torque=Probe(rate=20.0, gain_std=0.1, bias=8.0, noise=3.0, resolution=2.0, delay=0.05),
        engine_speed=Probe(rate=20.0, noise=2.0, resolution=1.0, delay=0.05, is_magnitude=True),
        gear_ratio=Probe(rate=10.0, delay=0.1),
        brake=Probe(rate=10.0, delay=0.1, resolution=1.0),
        gnss=_receiver(3.0, rate=1.0),
        barometer=Probe(
            rate=5.0, bandwidth=0.5, noise=0.3, wander=2.0, wander_time=300.0, bias=5.0, resolution=0.1
        ),
    )


def _receiver(size: float, rate: float = 5.0) -> SatelliteReceiver:
    return SatelliteReceiver(
        Probe(rate=rate, noise=0.3 * size, wander=1.5 * size, wander_time=60.0, delay=0.1),
        Probe(rate=rate, noise=0.5 * size, wander=2.5 * size, wander_time=60.0, delay=0.1),
        Probe(rate=rate, noise=0.05 * size, delay=0.1),
    )


PRESETS: dict[str, Callable[[], SensorSuite]] = {
    "ideal": ideal,
    "paper": paper,
    "automotive": automotive,
    "worn": worn,
}
"""The presets by name."""


def sensor_preset(name: str) -> SensorSuite:
    """A set of sensors by its name.

    Raises:
        InputError: there is none; names those there are.
    """
    if name not in PRESETS:
        raise InputError(f"no sensors are called '{name}'", mend=did_you_mean(name, PRESETS))
    return PRESETS[name]()
