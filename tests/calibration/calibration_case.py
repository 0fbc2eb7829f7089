"""What the tests of the calibration share."""

from __future__ import annotations

from roadstate.vehicles import Vehicle

SPEED_NOISE = 0.4
"""m/s, 1σ of a sample of the log ``level``."""


def with_mass(car: Vehicle, factor: float) -> Vehicle:
    """The car as a file would have it whose mass is off."""
    return car.model_copy(update={"mass": car.mass * factor})
