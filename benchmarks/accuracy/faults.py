"""What a fault of one sensor does to an estimator: whether it survives, and whether it says so."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
from benchmarks.accuracy.ahead import made_ahead
from benchmarks.accuracy.built import buildable
from benchmarks.accuracy.scenarios import SCENARIOS, driven
from numpy.typing import NDArray

from roadstate.core import Estimates, Log, Validity, reference
from roadstate.estimators import Estimator
from roadstate.metrics import presented
from roadstate.papers.base import MISMATCHED
from roadstate.papers.plants import told
from roadstate.run import batch
from roadstate.sim.run import record
from roadstate.sim.sensors import KINDS, Fault, inject, sensor_preset, to_log
from roadstate.vehicles import load_vehicle

Array = NDArray[np.float64]

DRIVE = "curve-variable-speed"
_FROM, _TO = 44.0, 84.9  # s of the drive: braking, a stop, speeding up into the bends
_START, _LASTS = 63.0, 8.0  # s
_RECOVERS = 2.0  # s after the fault that do not count
_SOON = 1.0  # s within which a fault should be flagged
_LARGEST = 5.0  # % of slope
_VALID = 0.95  # share of samples in which a lower bound lies below the truth
_SAYS_SO = (Validity.SENSOR_MISSING, Validity.DIVERGED, Validity.SENSOR_FAULT)
_SPIKES = 2.0  # per second
_JUMP = 0.5  # s
SEEDS = 3
"""Sensors' seeds of each vehicle at most: each fault takes its time."""
_SURE = 3.0  # σ of what tells the same, from which on a deviation can be told
# sensor → what tells the same, and how well: 1σ in the unit of the channel. It follows from errors of plant
# and file: 15 % of a torque, a slope or bank of 5 to 8 %, slips of 3 % at 10 m/s, stiffnesses off by 10 %
REDUNDANCY: dict[str, tuple[str, float]] = {
    "accel_x": ("torques; wheels, but for the slope", 0.45),
    "accel_y": ("v r, but for the bank", 0.8),
    "roll_rate": ("what a bank does to a_y, but for sideslip", 0.05),
    "yaw_rate": ("wheels' differences, a_y/v, steering", 0.07),
    "wheel_speed_fl": ("the other wheels, but for slip", 1.5),
    "wheel_speed_rr": ("the other wheels, but for slip", 1.5),
    "wheel_speed_*": ("accelerometer, speed signal", 1.7),
    "steering_wheel": ("yaw rate by the single-track model", 0.15),
    "drive_torque_*": ("accelerometer and wheels", 100.0),
    "brake_torque_*": ("accelerometer and wheels", 50.0),
    "speed": ("the wheels", 0.5),
    "altitude": ("distance times slope, but for the signal's own wander", 3.0),
    "vertical_speed": ("speed times slope", 0.5),
}
"""Sensors that are read and what each can be compared with; one that is not here cannot be judged at all."""
# pattern of channels → size of a spike, and of a drift per second, in the channel's unit
SENSORS: dict[str, tuple[float, float]] = {
    "accel_x": (10.0, 0.3),
    "accel_y": (10.0, 0.3),
    "accel_z": (10.0, 0.3),
    "roll_rate": (0.5, 0.03),
    "pitch_rate": (0.5, 0.03),
    "yaw_rate": (0.5, 0.03),
    "wheel_speed_fl": (20.0, 1.0),
    "wheel_speed_rr": (20.0, 1.0),
    "wheel_speed_*": (20.0, 1.0),
    "steering_wheel": (1.0, 0.1),
    "drive_torque_*": (1000.0, 50.0),
    "brake_torque_*": (1000.0, 50.0),
    "speed": (10.0, 0.5),
    "altitude": (50.0, 2.0),
    "vertical_speed": (5.0, 0.2),
}
"""The sensors that fail in turn; a pattern fails as a whole."""


@dataclass(frozen=True)
class Case:
    """One fault of one sensor.

    Attributes:
        sensor: of :data:`SENSORS`.
        kind: of :data:`roadstate.sim.sensors.KINDS`.
        log: with the fault.
        onset: s, when the log first differs from the clean one.
        deviation: of the sensor within :data:`_SOON` of the onset, over 1σ of :data:`REDUNDANCY`; infinite
            where its samples are missing.
    """

    sensor: str
    kind: str
    log: Log
    onset: float
    deviation: float


@dataclass(frozen=True)
class Outcome:
    """What became of an estimator.

    Attributes:
        vehicle, seed, estimator, sensor, kind: which.
        survived: finite throughout, and sound after the fault.
        why: what was not, else empty.
        flagged_s: s from the onset until validity says that a sensor is missing or at fault, or the filter
            has failed; 1 where only the gate refused more samples within 1 s; ``None`` where neither.
        tellable: whether the sensor deviates within 1 s by so much that others can tell.
    """

    vehicle: str
    seed: int
    estimator: str
    sensor: str
    kind: str
    survived: bool
    why: str
    flagged_s: float | None
    tellable: bool = True


def cases(vehicle: str, seed: int = 0) -> tuple[Log, list[Case]]:
    """The clean log of the drive, and each fault that changes it.

    Args:
        vehicle: preset to drive.
        seed: of the sensors.
    """
    car = load_vehicle(vehicle)
    recording = record(driven(car, SCENARIOS[DRIVE]), sensor_preset("automotive"), seed=seed)
    clean = to_log(recording).between(_FROM, _TO)
    found = []
    for sensor, (spike, drift) in SENSORS.items():
        for kind in KINDS:
            size = {"spike": spike, "drift": drift, "time_jump": _JUMP}.get(kind, 1.0)
            fault = Fault(kind, sensor, _START, _LASTS, size, _SPIKES)
            whole = to_log(inject(recording, [fault], seed))
            log = whole.select(clean.channels).between(_FROM, _TO)
            onset = first_difference(clean, log)
            if onset is not None and len(log) == len(clean):
                found.append(Case(sensor, kind, log, onset, deviation(clean, log, sensor, onset)))
    return clean, found


def first_difference(clean: Log, other: Log) -> float | None:
    """s at which a measured channel first differs; ``None`` where none does."""
    differs = np.zeros(len(clean), bool)
    for name, values in clean.channels.items():
        if not name.startswith("ref_"):
            differs |= ~((values == other[name]) | (np.isnan(values) & np.isnan(other[name])))
    return float(clean.time[int(np.argmax(differs))]) if differs.any() else None


def deviation(clean: Log, other: Log, sensor: str, onset: float) -> float:
    """By how many σ of what tells the same a sensor is off within :data:`_SOON`; infinite if it is silent."""
    _, std = REDUNDANCY.get(sensor, ("nothing", np.inf))
    soon = (clean.time >= onset) & (clean.time <= onset + _SOON)
    most = 0.0
    for name, values in clean.channels.items():
        if fnmatchcase(name, sensor):
            there, here = values[soon], other[name][soon]
            if np.isfinite(here).sum() < 0.8 * np.isfinite(there).sum():
                return np.inf
            off = np.abs(here - there)
            most = max(most, float(np.nanmax(off)) if np.isfinite(off).any() else 0.0)
    return most / std


def study(
    vehicles: Sequence[str],
    estimators: Sequence[str],
    seeds: int,
    tell: Callable[[str], None] = lambda what: None,
) -> list[Outcome]:
    """Every fault on every estimator that reads the sensor.

    Args:
        vehicles: presets to drive.
        estimators: names.
        seeds: of the sensors and of the vehicle file told, for each vehicle.
        tell: called with what is being done.
    """
    found = []
    wanted = list(itertools.product(vehicles, range(seeds)))
    for (vehicle, seed), (clean, every) in zip(wanted, made_ahead(cases, wanted), strict=True):
        tell(f"faults: {vehicle}, seed {seed}")
        car = told(load_vehicle(vehicle), MISMATCHED, seed)
        for _, estimator in buildable(estimators, car, clean.available):
            some = [c for c in every if _reads(estimator, c.sensor)]
            found += _of_one(estimator, clean, some, vehicle, seed)
    return found


def _reads(estimator: Estimator[Any], sensor: str) -> bool:
    return any(channel.startswith(sensor.rstrip("*")) for channel in estimator.channels)


def _of_one(
    estimator: Estimator[Any], clean: Log, some: Sequence[Case], vehicle: str, seed: int
) -> list[Outcome]:
    whole = batch(estimator, [clean, *(case.log for case in some)])
    # who was refused within a second is seen from logs that end then, each beside the clean one cut alike
    ends = [case.onset + _SOON for case in some]
    cut = [case.log.between(_FROM, end) for case, end in zip(some, ends, strict=True)]
    refused = [_refused(e) for e in batch(estimator, cut)]
    stops = dict.fromkeys(ends)
    usual = batch(estimator, [clean.between(_FROM, end) for end in stops])
    at_best = dict(zip(stops, map(_refused, usual), strict=True))
    outcomes = []
    for case, estimates, count, end in zip(some, whole[1:], refused, ends, strict=True):
        why = trouble(estimates, whole[0], case.log)
        flagged = flag_time(estimates, whole[0], case.onset)
        if (flagged is None or flagged > _SOON) and count > at_best[end]:
            flagged = _SOON
        tellable = case.deviation >= _SURE
        which = vehicle, seed, estimator.name, case.sensor, case.kind
        outcomes.append(Outcome(*which, not why, why, flagged, tellable))
    return outcomes


def _refused(estimates: Estimates) -> int:
    return sum(estimates.metadata["rejected"].values())


def trouble(estimates: Estimates, usual: Estimates, log: Log) -> str:
    """What is wrong with estimates after a fault; empty where nothing is.

    Args:
        estimates: with the fault.
        usual: of the same drive without.
        log: with the truth.
    """
    if not all(np.isfinite(values).all() for values in estimates.values.values()):
        return "nan"
    after = log.time >= _START + _LASTS + _RECOVERS
    truth = reference("grade", log.channels)
    if "grade" in estimates.values and truth is not None:
        error = presented("grade", estimates.values["grade"]) - presented("grade", truth)
        if np.abs(error[after]).max() > _LARGEST:
            return "grade"
    peak = reference("friction_peak", log.channels)
    if "friction_peak_lower" in estimates.values and peak is not None:
        valid, before = (
            float(np.mean((e.values["friction_peak_lower"] <= peak)[after])) for e in (estimates, usual)
        )
        if valid < min(_VALID, before - 0.05):
            return "friction"
    return ""


def flag_time(estimates: Estimates, usual: Estimates, onset: float) -> float | None:
    """s from the onset until validity tells of a fault where it does not without; ``None`` where never."""
    says, said = (np.isin(e.validity, [int(v) for v in _SAYS_SO]) for e in (estimates, usual))
    flagged = says & ~said & (estimates.time >= onset)
    return float(estimates.time[int(np.argmax(flagged))] - onset) if flagged.any() else None


def words(outcomes: Sequence[Outcome]) -> str:
    """A cell of the worst: ``ok`` or what is wrong, and when it was flagged, or that nobody could have within
    1 s; and in how many of all something is wrong."""
    if not outcomes:
        return ""
    worst = max(outcomes, key=_badness)
    flagged, lost = worst.flagged_s, sum(not o.survived for o in outcomes)
    state = f"{worst.why.upper()} {lost}/{len(outcomes)}" if lost else "ok"
    if not worst.tellable and (flagged is None or flagged > _SOON):
        return f"{state} hidden"
    if flagged is None:
        return state
    when = f"{flagged:.1f} s" if flagged < _SOON else "≤ 1 s" if flagged == _SOON else "late"
    return f"{state} {when}"


def _badness(outcome: Outcome) -> tuple[bool, bool, float]:
    when = np.inf if outcome.flagged_s is None else outcome.flagged_s
    return not outcome.survived, outcome.tellable and when > _SOON, when
