"""A dozen figures that make a set of sensors: production sensors without their finer faults."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from roadstate.core import InputError
from roadstate.sim.sensors.inertial import InertialUnit
from roadstate.sim.sensors.probe import Probe
from roadstate.sim.sensors.satellite import SatelliteReceiver
from roadstate.sim.sensors.suite import SensorSuite

_GNSS_RATE = 1.0  # Hz


@dataclass(frozen=True)
class SensorNoise:
    """How the sensors err: 1σ of independent Gaussian errors of each 100 Hz sample, unless said otherwise.

    The defaults are those of ordinary production sensors, chosen, not identified from one car.

    Attributes:
        accel: accelerometer with the vibration of the body, m/s².
        accel_bias: constant error of the accelerometer, m/s² (the value, not a σ).
        yaw_rate: rad/s.
        wheel_speed: rad/s.
        engine_torque: N·m.
        torque_scale: constant relative error of the torques the car reports (the value, not a σ).
        engine_speed: rad/s.
        wheel_torque: drive torque of a wheel, and its brake torque while the pedal is pressed, N·m.
        position: east and north, m, per 1 Hz fix; half of its variance wanders over ``gnss_time``.
        altitude: m, likewise.
        gnss_time: correlation time of the wandering part, s.
    """

    accel: float = 0.1
    accel_bias: float = 0.05
    yaw_rate: float = 0.003
    wheel_speed: float = 0.05
    engine_torque: float = 2.0
    torque_scale: float = 0.02
    engine_speed: float = 0.5
    wheel_torque: float = 10.0
    position: float = 1.5
    altitude: float = 1.5
    gnss_time: float = 30.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            is_signed = field.name in ("accel_bias", "torque_scale")
            if not np.isfinite(value) or (value < 0 and not is_signed):
                raise InputError(f"sensor noise '{field.name}' is {value}", mend="give a number of 0 or more")

    @classmethod
    def none(cls) -> Self:
        """Sensors that do not err."""
        return cls(**{f.name: 0.0 for f in fields(cls)})

    def suite(self) -> SensorSuite:
        """The sensors; accelerometer along x and gyroscope about z only."""
        scale = self.torque_scale
        return SensorSuite(
            imu=InertialUnit(
                Probe(noise=self.accel, offset=self.accel_bias),
                Probe(noise=self.yaw_rate),
                axes=("accel_x", "yaw_rate"),
            ),
            wheel_speed=Probe(noise=self.wheel_speed, is_magnitude=True),
            drive_torque=Probe(noise=self.wheel_torque, gain=scale),
            brake_torque=Probe(noise=self.wheel_torque, gain=scale, is_magnitude=True),
            engine_torque=Probe(noise=self.engine_torque, gain=scale),
            engine_speed=Probe(noise=self.engine_speed),
            gnss=SatelliteReceiver(self._fix(self.position), self._fix(self.altitude), gives_speed=False),
        )

    def _fix(self, size: float) -> Probe:
        half = size * np.sqrt(0.5)
        time = self.gnss_time if self.gnss_time > 0 else 1e-3
        return Probe(rate=_GNSS_RATE, noise=half, wander=half, wander_time=time)
