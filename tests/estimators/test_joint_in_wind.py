"""Grade on a motorway where a wind holds the car back, which torques alone cannot tell from a slope."""

from __future__ import annotations

import pytest
from benchmarks.winds import judged, recorded


@pytest.mark.usefixtures("optimised")
@pytest.mark.parametrize(("wind", "most"), [(0.0, 0.35), (3.1, 0.55)])
def test_a_usual_wind_is_within_what_is_said_of_the_grade(wind: float, most: float) -> None:
    found = judged("joint", recorded("family-car", wind, 4))
    assert found["grade inside"] > 92
    assert found["force_x_front inside"] > 92
    assert found["RMSE grade, %"] < most
