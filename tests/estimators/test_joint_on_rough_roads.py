"""Grade on a road that shakes the car."""

from __future__ import annotations

import pytest
from benchmarks.rough_roads import of_grade, recorded


@pytest.mark.usefixtures("optimised")
def test_a_road_that_shakes_the_accelerometer_is_no_gain_of_it() -> None:
    """Average roads (class C): what shakes accelerometer and body alike must not pass for the car's lean."""
    found = of_grade("joint", recorded("family-car", "C", 1))
    assert found["RMSE"] < 0.42
    assert found["inside"] > 93
