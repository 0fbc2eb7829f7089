"""Friction on a street full of potholes."""

from __future__ import annotations

import pytest
from benchmarks.bumps import FRICTION, recorded
from benchmarks.real_logs import of_friction


@pytest.mark.parametrize(
    ("vehicle", "street", "used", "least"), [("in-wheel-ev", 0, 0.5, 0.4), ("family-car", 2, 0.6, 0.7)]
)
@pytest.mark.usefixtures("optimised")
def test_bumps_and_potholes_are_not_taken_for_ice(
    vehicle: str, street: int, used: float, least: float
) -> None:
    """Nor at a wheel's turning points between its swings, after which the car of the second street lifts
    off: nothing that comes later would tell that the road has stayed."""
    log, car = recorded(vehicle, street, 1)[0]
    found = of_friction(log, car, "joint")
    assert found["used, at most"] < used
    assert found["upper bound below 0.6"] == 0
    assert found["least peak"] > least
    assert found["largest lower bound"] < FRICTION
