"""A satellite receiver: position, height and velocity, a few times a second."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roadstate.core.constants import EARTH_RADIUS
from roadstate.sim.sensors.probe import Probe

Array = NDArray[np.floating[Any]]
ORIGIN = (29.54, 106.52)
"""Latitude and longitude in deg of the world's origin: about where the authors of paper 002 drive."""


@dataclass(frozen=True)
class SatelliteReceiver:
    """GNSS. All its signals are to have one rate.

    Attributes:
        position: east and north each, m.
        altitude: height, m.
        velocity: speed over ground and rate of climb, m/s.
        origin: latitude and longitude of the place x = y = 0 of the world, deg.
        gives_speed: whether the speed over ground is recorded as ``speed``.
    """

    position: Probe = field(default_factory=lambda: Probe(rate=10.0))
    altitude: Probe = field(default_factory=lambda: Probe(rate=10.0))
    velocity: Probe = field(default_factory=lambda: Probe(rate=10.0))
    origin: tuple[float, float] = ORIGIN
    gives_speed: bool = True

    def read(
        self, truth: Mapping[str, Array], generator: Callable[[str], np.random.Generator]
    ) -> dict[str, tuple[Array, Array]]:
        """Time stamps and readings by channel.

        Args:
            truth: ``time``, ``east``, ``north`` and ``altitude`` (m); rates of these are differences.
            generator: random numbers by channel.
        """
        time = truth["time"]
        stamps, north = self.position.read(time, truth["north"], generator("latitude"))
        _, east = self.position.read(time, truth["east"], generator("longitude"))
        latitude = self.origin[0] + np.rad2deg(north / EARTH_RADIUS)
        parallel = EARTH_RADIUS * np.cos(np.deg2rad(self.origin[0]))
        out = {
            "latitude": (stamps, latitude),
            "longitude": (stamps, self.origin[1] + np.rad2deg(east / parallel)),
            "altitude": self.altitude.read(time, truth["altitude"], generator("altitude")),
        }
        climb = np.gradient(truth["altitude"], time)
        out["vertical_speed"] = self.velocity.read(time, climb, generator("vertical_speed"))
        if self.gives_speed:
            ground = np.hypot(np.gradient(truth["east"], time), np.gradient(truth["north"], time))
            out["speed"] = self.velocity.read(time, ground, generator("speed"))
        return out
