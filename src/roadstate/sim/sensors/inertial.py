"""An inertial unit somewhere on the body, not quite straight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roadstate.core.channels import RATES, SPECIFIC_FORCES
from roadstate.sim.sensors.probe import Probe

Array = NDArray[np.floating[Any]]
ACCELS = ("roll_accel", "pitch_accel", "yaw_accel")


@dataclass(frozen=True)
class InertialUnit:
    """Three accelerometers and three gyroscopes in one housing.

    At r from the centre of gravity a body feels f + ω̇×r + ω×(ω×r). The housing is turned by small angles
    against the body, so that its x and y axes see a part of gravity, on the level too. What the body itself
    sees of gravity as it pitches and rolls is in the truth already.

    Attributes:
        accel: each accelerometer, m/s².
        gyro: each gyroscope, rad/s.
        place: r along the body's axes, m.
        mounting: rotation of the housing about the body's x, y and z axes, rad, the values.
        mounting_std: 1σ of a rotation about each axis that is drawn once, rad.
        axes: channels to record, of ``accel_x`` … ``yaw_rate``.
    """

    accel: Probe = field(default_factory=Probe)
    gyro: Probe = field(default_factory=Probe)
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mounting: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mounting_std: float = 0.0
    axes: tuple[str, ...] = (*SPECIFIC_FORCES, *RATES)

    def seen(self, truth: Mapping[str, Array], rng: np.random.Generator) -> dict[str, Array]:
        """(T,) each: what ideal sensors in the turned housing would read, by channel.

        Args:
            truth: ``time``, ``accel_{x,y,z}`` at the centre of gravity along the body's axes (m/s²),
                ``{roll,pitch,yaw}_rate`` (rad/s) and, else differentiated from these, ``…_accel`` (rad/s²).
            rng: for the mounting.
        """
        omega = np.stack([truth[name] for name in RATES])
        force = np.stack([truth[name] for name in SPECIFIC_FORCES])
        if all(name in truth for name in ACCELS):
            alpha = np.stack([truth[name] for name in ACCELS])
        else:
            alpha = np.gradient(omega, truth["time"], axis=1)
        r = np.asarray(self.place, float)[:, None] * np.ones_like(omega)
        force = force + _cross(alpha, r) + _cross(omega, _cross(omega, r))
        angles = np.asarray(self.mounting) + self.mounting_std * rng.standard_normal(3)
        turn = rotation(*angles).T
        seen = dict(zip(SPECIFIC_FORCES, turn @ force, strict=True))
        return seen | dict(zip(RATES, turn @ omega, strict=True))


def rotation(roll: float, pitch: float, yaw: float) -> Array:
    """R_z(yaw) R_y(pitch) R_x(roll): from the turned axes to those they were turned from; angles in rad."""
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x)


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(np.cross(a, b, axis=0))
