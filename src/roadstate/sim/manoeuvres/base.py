"""What a manoeuvre is: a road, a path on it, a script, and a name to find it by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from roadstate.core import InputError
from roadstate.core.constants import GRAVITY
from roadstate.sim.manoeuvres.path import Path
from roadstate.sim.manoeuvres.script import OPEN, STEP, Script
from roadstate.sim.roads.friction import FrictionMap
from roadstate.sim.roads.road import Road

if TYPE_CHECKING:
    from roadstate.sim.plant.base import Controls
    from roadstate.vehicles import Vehicle

KMH = 1 / 3.6
"""m/s per km/h."""


def full_throttle(vehicle: Vehicle) -> tuple[float, float]:
    """What full throttle is good for: acceleration at low speed (m/s²), power per mass (W/kg).

    A rough guess by the plants' usual figures: half the weight as drive force in first gear, and full torque
    at 45 % of the largest engine speed (650 rad/s, heavy vehicles 280); in-wheel motors weaken from 12 m/s.
    """
    launch = 0.5 * GRAVITY
    ratios = vehicle.driveline.total_ratios
    fastest = 280.0 if vehicle.mass > 3500 else 650.0
    return launch, launch * (0.45 * fastest * vehicle.wheels.radius / ratios[0] if ratios else 12.0)


@dataclass(frozen=True)
class Setting:
    """What a manoeuvre is set up for.

    Attributes:
        vehicle: whose size and steering the manoeuvre asks for.
        speed: m/s.
        friction: peak friction coefficient; of the better surface where there are two.
    """

    vehicle: Vehicle
    speed: float
    friction: float


@dataclass(frozen=True)
class Manoeuvre:
    """Something to drive, for any plant.

    Attributes:
        name: in kebab-case.
        description: one line.
        road: with its friction.
        speed: at the start, m/s.
        script: speed, pedals and steering over time.
        path: to follow while the driver steers.
        s, d: where the car starts, m.
    """

    name: str
    description: str
    road: Road
    speed: float
    script: Script
    path: Path
    s: float = 0.0
    d: float = 0.0

    @property
    def duration(self) -> float:
        """s."""
        return self.script.duration

    def on(self, road: Road) -> Manoeuvre:
        """The same on another road."""
        return replace(self, road=road)

    def with_friction(self, friction: FrictionMap) -> Manoeuvre:
        """The same with another friction by place."""
        return self.on(eqx.tree_at(lambda r: r.friction, self.road, friction))

    def replayed(self, controls: Controls, dt: float) -> Manoeuvre:
        """The same open loop: steering wheel, pedals and gears as they were once moved.

        Args:
            controls: (T,) from a drive, a row every ``dt`` from the start on.
            dt: s.

        Raises:
            InputError: fewer than two rows.
        """
        moved = np.asarray(controls.steering_wheel)
        if moved.ndim != 1 or len(moved) < 2:
            raise InputError("a replay needs the controls of a drive", mend="give (T,) of them, T over 1")
        table = np.array(self.script.table)
        time, given = np.arange(len(table)) * STEP, np.arange(len(moved)) * dt
        for row, signal in ((2, moved), (3, controls.throttle), (4, controls.brake)):
            table[:, row] = np.interp(time, given, np.asarray(signal))
        index = np.clip(np.searchsorted(given, time + 1e-9, side="right") - 1, 0, len(given) - 1)
        table[:, 5] = np.asarray(controls.gear)[index]
        table[:, 6:] = OPEN
        return replace(self, name=f"{self.name}-open-loop", script=Script(jnp.asarray(table)))


@dataclass(frozen=True)
class ManoeuvreKind:
    """A manoeuvre by name, to be set up for a vehicle. One stands at the top level of its family's module.

    Attributes:
        name: in kebab-case.
        summary: one line.
        source: the standard or paper that describes it, or that it is chosen.
        speed: usual speed, m/s.
        friction: usual friction.
        build: the manoeuvre, for a setting.
    """

    name: str
    summary: str
    source: str
    speed: float
    friction: float
    build: Callable[[Setting], Manoeuvre]

    def prepare(
        self, vehicle: Vehicle, *, speed: float | None = None, friction: float | None = None
    ) -> Manoeuvre:
        """The manoeuvre for a vehicle.

        Args:
            vehicle: the car.
            speed: m/s; the usual one where ``None``.
            friction: of the (better) surface; the usual one where ``None``.

        Raises:
            InputError: a speed or friction that is none.
        """
        speed = self.speed if speed is None else float(speed)
        friction = self.friction if friction is None else float(friction)
        if not 0.5 <= speed <= 100:
            raise InputError(f"a manoeuvre at {speed * 3.6:g} km/h", mend="choose 2 to 360 km/h")
        if not 0.02 <= friction <= 3:
            raise InputError(f"a friction of {friction:g}", mend="choose 0.02 to 3")
        return self.build(Setting(vehicle, speed, friction))

    def make(self, setting: Setting, **parts: Any) -> Manoeuvre:
        """A manoeuvre of this name: road, script, path and, where they differ, speed, s and d."""
        return Manoeuvre(self.name, self.summary, **{"speed": setting.speed, **parts})
