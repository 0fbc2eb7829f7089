"""Friction on a street full of potholes."""

from __future__ import annotations

import pytest
from benchmarks.bumps import FRICTION, recorded
from benchmarks.real_logs import of_friction


@pytest.mark.usefixtures("optimised")
def test_bumps_and_potholes_are_not_taken_for_ice() -> None:
    log, car = recorded("in-wheel-ev", 0, 1)[0]
    found = of_friction(log, car, "joint")
    assert found["used, at most"] < 0.5
    assert found["upper bound below 0.6"] == 0
    assert found["least peak"] > 0.4
    assert found["largest lower bound"] < FRICTION
