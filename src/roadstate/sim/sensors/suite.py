"""All sensors of a car, from the truth to a recording and a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from roadstate.core import CHANNELS, WHEELS, InputError, Log, Recording, Signal
from roadstate.core.channels import RATES, SPECIFIC_FORCES
from roadstate.sim.sensors.faults import Fault, inject
from roadstate.sim.sensors.inertial import InertialUnit
from roadstate.sim.sensors.probe import Probe
from roadstate.sim.sensors.satellite import SatelliteReceiver
from roadstate.sim.sensors.wheel_pulses import ToothSensor

Array = NDArray[np.floating[Any]]
_INERTIAL = (*SPECIFIC_FORCES, *RATES)
_PLACE = ("east", "north", "altitude")
_REFERENCE_RATE = 100.0  # Hz

CHANNELS_OF = {
    "steering_wheel": ("steering_wheel",),
    "road_wheel": ("steer",),
    "drive_torque": tuple(f"drive_torque_{w}" for w in WHEELS),
    "brake_torque": tuple(f"brake_torque_{w}" for w in WHEELS),
    "brake_pressure": tuple(f"brake_pressure_{w}" for w in WHEELS),
    "engine_torque": ("engine_torque",),
    "engine_speed": ("engine_speed",),
    "gear_ratio": ("gear_ratio",),
    "brake": ("brake",),
    "kinematic": ("kinematic_accel_x", "kinematic_accel_y"),
    "velocity": ("speed", "velocity_y"),
    "yaw_accel": ("yaw_accel",),
}
"""The channels that each of a suite's plain sensors reads."""


@dataclass(frozen=True)
class SensorSuite:
    """What a car measures, and how badly. A sensor of ``None`` is not there.

    Attributes:
        imu: the inertial unit.
        wheel_speed: at each wheel.
        steering_wheel: its angle, rad.
        road_wheel: mean angle of the front wheels, rad, which simulators print and few cars measure.
        drive_torque, brake_torque: at each wheel, N·m.
        brake_pressure: at each wheel, Pa.
        engine_torque: N·m.
        engine_speed: rad/s.
        gear_ratio: as the gearbox reports it.
        brake: the pedal or its switch.
        kinematic: accelerations without gravity, as simulators print and no car measures.
        velocity: velocity over ground along x and y, as an optical sensor gives; takes the place of
            the receiver's speed.
        yaw_accel: rate of change of the yaw rate, which simulators print and few cars measure.
        gnss: satellite receiver.
        barometer: height from air pressure, m; takes the place of the receiver's height.
    """

    imu: InertialUnit | None = field(default_factory=InertialUnit)
    wheel_speed: Probe | ToothSensor | None = field(default_factory=Probe)
    steering_wheel: Probe | None = field(default_factory=Probe)
    road_wheel: Probe | None = field(default_factory=Probe)
    drive_torque: Probe | None = field(default_factory=Probe)
    brake_torque: Probe | None = field(default_factory=Probe)
    brake_pressure: Probe | None = field(default_factory=Probe)
    engine_torque: Probe | None = field(default_factory=Probe)
    engine_speed: Probe | None = field(default_factory=Probe)
    gear_ratio: Probe | None = field(default_factory=Probe)
    brake: Probe | None = field(default_factory=Probe)
    kinematic: Probe | None = None
    velocity: Probe | None = None
    yaw_accel: Probe | None = None
    gnss: SatelliteReceiver | None = field(default_factory=SatelliteReceiver)
    barometer: Probe | None = None


def measure(
    truth: Mapping[str, Array],
    suite: SensorSuite,
    *,
    seed: int = 0,
    faults: Sequence[Fault] = (),
    metadata: Mapping[str, Any] | None = None,
) -> Recording:
    """What the sensors record of a drive, each signal at its own rate, with the truth in ``ref_*`` at 100 Hz.

    Args:
        truth: (T,) columns on an equidistant ``time`` (s; 100 Hz or more, 1 kHz for wheel pulses worth the
            name), in SI: canonical names without error (``accel_x`` … at the centre of gravity, along the
            body's axes), ``roll_accel``, ``pitch_accel``, ``yaw_accel``, ``east``, ``north``, ``altitude``,
            and ``ref_*``. Sensors without their truth stay silent; columns without a sensor are not used.
        suite: the sensors.
        seed: same seed, same bits; each channel has random numbers of its own.
        faults: to put in.
        metadata: vehicle, manoeuvre …; JSON-able.

    Raises:
        InputError: no usable time, a column of another length, or a fault for a signal that is not there.
    """
    time = np.asarray(truth.get("time", ()), float)
    steps = np.diff(time)
    if not (len(steps) and steps[0] > 0 and np.allclose(steps, steps[0], rtol=1e-6, atol=1e-9)):
        raise InputError("the truth has no equidistant 'time' of two samples or more")
    table = {name: np.asarray(column, float) for name, column in truth.items()}
    for name, column in table.items():
        if column.shape != time.shape:
            raise InputError(f"truth '{name}' has shape {column.shape}, time has {time.shape}")

    def generator(name: str) -> np.random.Generator:
        return np.random.default_rng([seed, crc32(name.encode())])

    read: dict[str, tuple[Array, Array]] = {}
    if suite.imu is not None and all(n in table for n in _INERTIAL):
        seen = suite.imu.seen(table, generator("mounting"))
        for name in suite.imu.axes:
            probe = suite.imu.accel if name.startswith("accel") else suite.imu.gyro
            read[name] = probe.read(time, seen[name], generator(name))
    if suite.wheel_speed is not None:
        for name in (f"wheel_speed_{w}" for w in WHEELS):
            if name in table:
                read[name] = suite.wheel_speed.read(time, table[name], generator(name))
    if suite.gnss is not None and all(n in table for n in _PLACE):
        read |= suite.gnss.read(table, generator)
    for sensor, names in CHANNELS_OF.items():
        plain: Probe | None = getattr(suite, sensor)
        for name in names:
            if plain is not None and name in table:
                read[name] = plain.read(time, table[name], generator(name))
    if suite.barometer is not None and "altitude" in table:
        read["altitude"] = suite.barometer.read(time, table["altitude"], generator("barometer"))
    signals = {n: _signal(n, t, v, "simulated") for n, (t, v) in read.items()}
    stride = max(1, round(1 / (_REFERENCE_RATE * steps[0])))
    for name in (n for n in CHANNELS if n in table and CHANNELS[n].is_reference):
        column = table[name][::stride]
        signals[name] = _signal(name, time[::stride], column, "truth")
    described = {"frame": "ISO 8855", "seed": seed, "sensors": _plain(asdict(suite)), **(metadata or {})}
    return inject(Recording(signals, described), faults, seed)


def to_log(recording: Recording, rate: float = 100.0) -> Log:
    """The recording on one time base; samples whose time a fault has thrown back are left out.

    Args:
        recording: from :func:`measure`.
        rate: ticks per second, Hz.
    """
    kept = {name: signal.repaired() for name, signal in recording.signals.items()}
    return replace(recording, signals=kept).resample(rate)


def _signal(name: str, time: Array, values: Array, source: str) -> Signal:
    return Signal(np.asarray(time, np.float64), np.asarray(values, np.float64), CHANNELS[name].unit, source)


def _plain(value: Any) -> Any:
    """JSON-able: no infinity, no tuples."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items() if v is not None and v != np.inf}
    if isinstance(value, tuple):
        return [_plain(v) for v in value]
    return value
