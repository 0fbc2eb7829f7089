"""Friction on a street full of potholes."""

from __future__ import annotations

import pytest
from benchmarks.bumps import FRICTION, recorded
from benchmarks.real_logs import of_friction


@pytest.mark.usefixtures("optimised")
def test_bumps_and_potholes_are_not_taken_for_ice() -> None:
    """Nor at a wheel's turning points between its swings, after which the car lifts off: nothing that comes
    later would tell that the road has stayed."""
    log, car = recorded("family-car", 2, 1)[0]
    found = of_friction(log, car, "joint")
    assert found["used, at most"] < 0.6
    assert found["upper bound below 0.6"] == 0
    assert found["least peak"] > 0.7
    assert found["largest lower bound"] < FRICTION
