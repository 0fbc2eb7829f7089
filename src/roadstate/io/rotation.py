"""From the axes of an inertial sensor to the car's."""

from __future__ import annotations

import math
import re
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from roadstate.core import InputError
from roadstate.core.quantity import Quantity

Matrix = NDArray[np.float64]

_TOLERANCE = 1e-3
_CAR_AXES = ("forward", "left", "up")
_NAMED = re.compile("[+-]?[XYZxyz]")
_EXAMPLE = "name axes like 'forward: -Y' and 'up: X'"

Angle = Annotated[float, Quantity("rad", -math.pi, math.pi)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Row = tuple[Number, Number, Number]


class Rotation(BaseModel):
    """How a sensor sits in the car: its axes by name or as a matrix, then small angles of its mounting.

    ``v_car = R_z(yaw) R_y(pitch) R_x(roll) N v_sensor``, with N the named axes or the matrix. The angles are
    the attitude of the sensor's axes N in the car, positive as in ISO 8855: yaw turned to the left, pitch
    with the nose down, roll with the right side down.

    Attributes:
        forward: the sensor's axis that points forward, such as ``-Y``.
        left: the one that points left.
        up: the one that points up. Two are enough; the third follows by the right-hand rule.
        matrix: 3×3, rows are the car's forward, left and up in the sensor's axes.
        roll: in rad, or with a unit.
        pitch: in rad, or with a unit.
        yaw: in rad, or with a unit.

    Raises:
        InputError: the axes or the matrix are no proper rotation (orthonormal, determinant +1).
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    forward: str | None = None
    left: str | None = None
    up: str | None = None
    matrix: tuple[Row, Row, Row] | None = None
    roll: Angle = 0.0
    pitch: Angle = 0.0
    yaw: Angle = 0.0

    @model_validator(mode="before")
    @classmethod
    def _matrix_alone(cls, value: Any) -> Any:
        return {"matrix": value} if isinstance(value, list) else value

    @field_validator("forward", "left", "up")
    @classmethod
    def _named_axis(cls, text: str | None) -> str | None:
        if text is not None and not _NAMED.fullmatch(text):
            raise InputError(f"'{text[:20]}' is no axis", mend=_EXAMPLE)
        return text

    @field_validator("matrix", mode="before")
    @classmethod
    def _three_by_three(cls, value: Any) -> Any:
        if not isinstance(value, list | tuple) or [_length(row) for row in value] != [3, 3, 3]:
            raise InputError("is no 3x3 matrix", mend="write [[x, y, z], [x, y, z], [x, y, z]]")
        return value

    @model_validator(mode="after")
    def _proper(self) -> Rotation:
        self._axes()
        return self

    def to_matrix(self) -> Matrix:
        """(3, 3) R with ``v_car = R v_sensor``."""
        return mounting_matrix(self.roll, self.pitch, self.yaw) @ self._axes()

    def _axes(self) -> Matrix:
        named = {a: t for a in _CAR_AXES if (t := getattr(self, a)) is not None}
        if self.matrix is not None:
            if named:
                raise InputError("both a matrix and named axes are given", mend="keep one of them")
            axes = np.array(self.matrix, dtype=np.float64)
            if np.abs(axes @ axes.T - np.eye(3)).max() > _TOLERANCE:
                raise InputError(
                    f"the matrix is not orthonormal within {_TOLERANCE:g}",
                    mend="its rows must be unit vectors at right angles: forward, left, up in sensor axes",
                )
            if np.linalg.det(axes) < 0:
                raise InputError(
                    "the matrix mirrors (its determinant is -1)",
                    mend="one of its rows has the wrong sign",
                )
            return axes
        if not named and (self.roll or self.pitch or self.yaw):
            return np.eye(3)  # already the car's axes, but for the mounting
        if len(named) < 2:
            raise InputError(f"{len(named)} of the car's axes are named, two are needed", mend=_EXAMPLE)
        rows = {axis: _unit_vector(text) for axis, text in named.items()}
        (first, a), (second, b) = list(rows.items())[:2]
        if a @ b != 0:
            raise InputError(f"{first} and {second} lie on one axis of the sensor", mend=_EXAMPLE)
        forward = rows.get("forward", np.cross(rows.get("left", a), rows.get("up", b)))
        left = rows.get("left", np.cross(rows.get("up", b), forward))
        up = np.cross(forward, left)
        if "up" in rows and not np.array_equal(up, rows["up"]):
            raise InputError(
                f"forward {self.forward}, left {self.left}, up {self.up} is no right-handed set of axes",
                mend="leave one out: it follows from the other two",
            )
        return np.stack([forward, left, up])


def mounting_matrix(roll: float, pitch: float, yaw: float) -> Matrix:
    """(3, 3) ``R_z(yaw) R_y(pitch) R_x(roll)``: from a body's axes to those of the frame it is in.

    Args:
        roll: rad about x.
        pitch: rad about y.
        yaw: rad about z.
    """
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _length(row: Any) -> int:
    return len(row) if isinstance(row, list | tuple) else 0


def _unit_vector(text: str) -> Matrix:
    vector = np.zeros(3)
    vector["XYZ".index(text[-1].upper())] = -1.0 if text[0] == "-" else 1.0
    return vector
