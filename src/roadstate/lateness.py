"""Which channels of a log come late throughout: those that others, which tell of the same motion, precede."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.core.signals import Signal, interpolate
from roadstate.time_shift import LEAST_TIME, RATE, rate_of, smooth, time_shift

if TYPE_CHECKING:
    from roadstate.core import Log
    from roadstate.vehicles import Vehicle

Array = NDArray[np.float64]
_Two = tuple[Array, Array]

_SPEED = 4.0  # m/s from which on two signals are compared
_ALIKE = 0.7  # correlation below which they tell of different things
_MODEL = 0.3  # 1σ, as a share, of what tires and place have one motion precede another by
_FLOOR = 0.015  # s: 1σ of what else does
_BANKED = 0.05  # s: the same where roads are banked as they bend
_PENALTY = 9.0  # squared deviations that one channel more to be late has to explain
_OUTLIER = 25.0  # squared deviations that one comparison counts for at most
_TOGETHER = 3  # channels that may be late at once
_LEAST, _SURE = 0.06, 3.5  # s, and 1σ, from which on a channel is called late
_SPINS = tuple(f"wheel_speed_{w}" for w in WHEELS)
_TORQUES = tuple(f"{kind}_torque_{w}" for kind in ("drive", "brake") for w in WHEELS)
_CHANNELS = {"wheels": _SPINS, "torques": _TORQUES}


class Late(NamedTuple):
    """How late channels are.

    Attributes:
        channels: that are late together.
        seconds: by which they are later than the earliest, s.
        std: 1σ of that, s.
    """

    channels: tuple[str, ...]
    seconds: float
    std: float


class _Pair(NamedTuple):
    """Two tellings of one motion: by how much the second is later than the first, s, and 1σ of that."""

    first: str
    second: str
    seconds: float
    std: float


def lateness(log: Log, vehicle: Vehicle) -> list[Late]:
    """Channels that come late by one time throughout, the latest first; empty where none is found.

    Compares what accelerometer, wheel speeds, torques at the wheels and a measured speed tell of the
    longitudinal acceleration, and what gyroscope, wheel speeds, lateral accelerometer and steering tell of
    the yaw rate; the latter two by the single-track model (Rajamani, *Vehicle Dynamics and Control*, ch. 2),
    with the file's stiffnesses, since tires have a_y precede or follow r by up to .1 s. No signal is early,
    and as few as possible are taken to be late. A log of smooth driving says nothing of this.

    Args:
        log: some minutes of driving tell most; less than 20 s nothing.
        vehicle: the car.
    """
    if log.duration < LEAST_TIME:
        return []
    compared = _Compared(log, vehicle)
    late = _blamed([*compared.along(), *compared.across()])
    found = [Late(_CHANNELS.get(name, (name,)), *of) for name, of in late.items()]
    told = [one for one in found if one.seconds > max(_LEAST, _SURE * one.std)]
    return sorted(told, key=lambda one: -one.seconds)


class _Compared:
    """A log's channels on one grid, and what comparing them says."""

    def __init__(self, log: Log, vehicle: Vehicle) -> None:
        self.log, self.vehicle = log, vehicle
        self.grid = np.arange(log.time[0], log.time[-1], 1 / RATE)
        self.wheels = {
            w: self._get(f"wheel_speed_{w}") for w in WHEELS if f"wheel_speed_{w}" in log.available
        }
        self.speed = self._speed()
        self.moves = smooth(self.speed) > _SPEED

    def _get(self, name: str) -> Array:
        return interpolate(Signal(self.log.time, self.log[name]), self.grid)

    def _speed(self) -> Array:
        """Of the wheels, on the average, or else as measured, m/s."""
        if self.wheels:
            return np.asarray(self.vehicle.wheels.radius * np.mean([*self.wheels.values()], axis=0))
        return self._get("speed") if "speed" in self.log.available else np.full(len(self.grid), np.nan)

    def along(self) -> Iterator[_Pair]:
        """Of what tells the longitudinal acceleration.

        The slip of all wheels on the average is κ = a_x/(g·c) with c the slip stiffness over load, whichever
        axle drives, so that v = ωR(1 − κ): at 20 m/s wheels precede the car by some .1 s.
        """
        told, crude = {}, {}
        if self.wheels:
            crude["wheels"] = rate_of(self.speed)
            slip = smooth(crude["wheels"]) / (GRAVITY * self.vehicle.tires.slip_stiffness)
            told["wheels"] = rate_of(self.speed * (1 - slip))
        if "speed" in self.log.available:
            told["speed"] = rate_of(self._get("speed"))
        if "accel_x" in self.log.available:
            told["accel_x"] = self._get("accel_x")
        if self.log.available.issuperset(_TORQUES):
            half = len(_TORQUES) // 2
            drive, brake = ([self._get(t) for t in part] for part in (_TORQUES[:half], _TORQUES[half:]))
            told["torques"] = np.sum(drive, axis=0) - np.sum(brake, axis=0)
        for (first, x), (second, y) in combinations(told.items(), 2):
            crudely = (crude[first], y) if first in crude else None
            yield from self._pair(first, second, (x, y), crudely, _FLOOR)

    def across(self) -> Iterator[_Pair]:
        """Of what tells the yaw rate r.

        With F_f + F_r = m a_y, l_f F_f − l_r F_r = I_z ṙ, slip angles F/C and v̇_y = a_y − v r,
        a_y + d/dt(v k a_y) = v r + l_r ṙ + d/dt(v i ṙ) where k = m l_f/(L C_r) and i = I_z/(L C_r). The front
        wheels' angle is δ = L r/v − F_r/C_r + F_f/C_f, in which a_y is replaced by r in the same way.
        """
        if "yaw_rate" not in self.log.available:
            return
        car, v, r = self.vehicle, np.maximum(self.speed, 1.0), self._get("yaw_rate")
        if {"rl", "rr"} <= set(self.wheels):
            apart = self.wheels["rr"] - self.wheels["rl"]
            yield from self._pair("yaw_rate", "wheels", (r, apart), None, _FLOOR)
        l_f, l_r = car.geometry.cg_to_front_axle, car.geometry.cg_to_rear_axle
        stiff_f, stiff_r = car.axle_cornering_stiffness
        turns, swing = rate_of(r), smooth(v) / ((l_f + l_r) * stiff_r)
        lag = car.mass * l_f * swing
        lateral = v * r + l_r * turns + rate_of(car.yaw_inertia * swing * turns)
        if "accel_y" in self.log.available:
            told = self._get("accel_y")
            finely = lateral, told + rate_of(lag * told)
            yield from self._pair("yaw_rate", "accel_y", finely, (v * r, told), _BANKED)
        steering = [name for name in ("steer", "steering_wheel") if name in self.log.available]
        if steering:
            told = self._get(steering[0])
            kinematic = (l_f + l_r) * r / v
            swung = swing * (1 + stiff_r / stiff_f) * car.yaw_inertia * turns / v
            understeer = car.mass * (l_r / stiff_f - l_f / stiff_r) / (l_f + l_r)
            x = kinematic + swung + understeer * lateral + rate_of(lag * (kinematic + swung))
            finely, crudely = (x, told + rate_of(lag * told)), (kinematic + understeer * v * r, told)
            yield from self._pair("yaw_rate", steering[0], finely, crudely, _FLOOR)

    def _pair(
        self, first: str, second: str, finely: _Two, crudely: _Two | None, floor: float
    ) -> Iterator[_Pair]:
        """Of two that agree: what they make of one motion, by this model and the crudest, if another."""
        found = time_shift(*finely, self.moves)
        if found is None or found.correlation < _ALIKE:
            return
        otherwise = None if crudely is None else time_shift(*crudely, self.moves)
        worth = 0.0 if otherwise is None else abs(otherwise.seconds - found.seconds)
        std = float(np.sqrt(found.std**2 + (_MODEL * worth) ** 2 + floor**2))
        yield _Pair(first, second, found.seconds, std)


def _blamed(pairs: list[_Pair]) -> dict[str, tuple[float, float]]:
    """The fewest that have to be late to explain what was compared: by how much each, and 1σ, s."""
    names = sorted({name for pair in pairs for name in (pair.first, pair.second)})
    gaps = np.array([pair.seconds for pair in pairs])
    weights = 1 / np.array([pair.std for pair in pairs])
    least, best = np.inf, {}
    for count in range(min(_TOGETHER, len(names) - 1) + 1):
        for late in combinations(names, count):
            rows = [[(p.second == n) - (p.first == n) for n in late] for p in pairs]
            A = weights[:, None] * np.array(rows, float).reshape(len(pairs), count)
            # of no column at all, NumPy before 2.4 knows no rank
            if count and np.linalg.matrix_rank(A) < count:
                continue
            seconds = np.linalg.lstsq(A, weights * gaps)[0]
            misfit = np.minimum((weights * gaps - A @ seconds) ** 2, _OUTLIER)
            cost = float(np.sum(misfit)) + _PENALTY * count
            if np.all(seconds >= 0) and cost < least:
                std = np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
                each = zip(seconds.tolist(), std.tolist(), strict=True)
                least, best = cost, dict(zip(late, each, strict=True))
    return best
