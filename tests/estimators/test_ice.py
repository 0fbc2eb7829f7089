"""Ice on which wheels spin and lock all the time, and none of the sensors is to blame."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.accuracy.measures import inside, rmse
from benchmarks.by_bus import Runs, driven
from benchmarks.ice import DRIVES

from roadstate.core import Validity


@pytest.fixture(scope="module")
def straight() -> Runs:
    """A car with front-wheel drive that speeds up and slows down."""
    return driven("family-car", DRIVES["wet ice, 0.07"][0], 3)


@pytest.fixture(scope="module")
def bent() -> Runs:
    """The same in a bend."""
    return driven("family-car", DRIVES["bend of 60 m, 0.15"][0], 3)


def test_the_speed_does_not_follow_a_wheel_that_slips_evenly(straight: Runs) -> None:
    for log, said in straight:
        slips = log["wheel_speed_fl"] - log["wheel_speed_rl"]
        assert np.ptp(slips) > 5  # rad/s: it does spin
        assert rmse(said, log, "speed") < 0.12
        assert inside(said, log, "speed", settle=5.0) > 90
        assert rmse(said, log, "grade", settle=5.0) < 0.5  # %


@pytest.mark.parametrize("drive", ["straight", "bent"])
def test_no_sensor_is_to_blame(drive: str, request: pytest.FixtureRequest) -> None:
    for _, said in request.getfixturevalue(drive):
        assert not said.metadata.get("faults")
        assert np.mean(said.validity == Validity.SENSOR_FAULT) < 0.01


def test_the_bend_tells_of_the_ice(bent: Runs) -> None:
    for log, said in bent:
        late = log.time - log.time[0] > 25
        assert np.mean(said.values["friction_peak_lower"][late] <= 0.15) > 0.95
        assert np.mean(np.abs(np.log(said.values["friction_peak"][late] / 0.15)) < 0.25) > 0.8
        assert inside(said, log, "velocity_y", settle=5.0) > 90
