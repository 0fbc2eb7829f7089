"""Wheel speed as a control unit gets it: from the times at which teeth pass a sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roadstate.core import InputError

Array = NDArray[np.floating[Any]]
_BEFORE = 2.0  # s of steady rolling before the log begins


@dataclass(frozen=True)
class ToothSensor:
    """Wheel speed from the edges of a toothed wheel or a magnetic encoder.

    At each instant the speed is the angle between the last edge and the last one of an earlier reading over
    the time between them. Without a new edge it is at most one tooth over the time since, and zero after
    ``timeout``.

    Attributes:
        rate: readings per second, Hz.
        teeth: edges per turn that count (cars 40 … 60, with 48 the usual).
        tooth_error: 1σ of the place of a tooth, as a share of the pitch, the same each turn.
        timer: step of the clock that times the edges, s.
        timeout: time without an edge after which the wheel is taken to stand, s.
        resolution: step of the readings, rad/s.
        delay: of the reading, s.
        is_signed: whether the sensor knows the direction (active sensors of cars with hill hold do).
    """

    rate: float = 100.0
    teeth: int = 48
    tooth_error: float = 0.01
    timer: float = 1e-6
    timeout: float = 0.3
    resolution: float = 0.0
    delay: float = 0.0
    is_signed: bool = False

    def __post_init__(self) -> None:
        good = 0.01 <= self.rate <= 10_000 and 1 <= self.teeth <= 10_000 and 0 <= self.tooth_error < 0.2
        if not (good and self.timer >= 0 and self.timeout > 0 and self.resolution >= 0 and self.delay >= 0):
            raise InputError(
                f"a tooth sensor with rate {self.rate:g} Hz, {self.teeth} teeth, tooth_error "
                f"{self.tooth_error:g}, timeout {self.timeout:g} s",
                mend="give rates and times above 0, and a tooth_error below 0.2",
            )

    def read(self, time: Array, values: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Time stamps (N,) in s and readings (N,) in rad/s.

        Args:
            time: (T,) of the truth, equidistant, s.
            values: (T,) wheel speed, rad/s.
            rng: of this sensor alone.
        """
        stamps = time[0] + np.arange(int((time[-1] - time[0]) * self.rate + 1e-9) + 1) / self.rate
        instants = stamps - self.delay
        pitch = 2 * np.pi / self.teeth
        edges = self._edges(time, np.abs(values), pitch, rng)
        last = np.searchsorted(edges, instants, side="right") - 1
        before = np.concatenate(
            [[np.searchsorted(edges, instants[0] - 1 / self.rate, side="right") - 1], last]
        )
        reading = np.zeros(len(stamps))
        held = 0.0
        for k, now in enumerate(instants):
            e, p = int(last[k]), int(before[k])
            if e < 1:
                held = 0.0
            elif e > p or k == 0:
                start = min(max(p, 0), e - 1)
                gap = edges[e] - edges[start]
                held = (e - start) * pitch / gap if gap > 0 else held
            since = now - edges[e] if e >= 0 else np.inf
            if since > self.timeout:
                held = 0.0
            elif held * since > pitch:
                held = pitch / since
            reading[k] = held
        if self.is_signed:
            reading = np.where(np.interp(instants, time, values) < 0, -reading, reading)
        if self.resolution > 0:
            reading = self.resolution * np.round(reading / self.resolution)
        return stamps, reading

    def _edges(self, time: Array, speed: Array, pitch: float, rng: np.random.Generator) -> Array:
        """Times of the edges, in s, from a while before the log on."""
        place = pitch * self.tooth_error * rng.standard_normal(self.teeth)
        start = rng.uniform(0, 2 * np.pi)
        step = np.diff(time)
        turned = start + np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * step)])
        clock = np.concatenate([[time[0] - _BEFORE], time])
        angle = np.concatenate([[start - _BEFORE * speed[0]], turned])
        number = np.arange(np.floor(angle[0] / pitch) - 1, np.ceil(angle[-1] / pitch) + 2)
        level = np.sort(number * pitch + place[number.astype(np.int64) % self.teeth])
        level = level[(level > angle[0]) & (level <= angle[-1])]
        # the first instant at which the angle is reached: while the wheel stands the angle stays
        after = np.searchsorted(angle, level, side="left")
        rise = angle[after] - angle[after - 1]
        share = (level - angle[after - 1]) / rise
        edges: Array = clock[after - 1] + share * (clock[after] - clock[after - 1])
        if self.timer > 0:
            edges = self.timer * np.floor(edges / self.timer)
        return edges
