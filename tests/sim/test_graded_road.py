"""The graded road: continuity, height, and the figures of paper 002."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadstate.core import InputError
from roadstate.sim.roads.grade import RAMP_SPEED, GradeProfile, interchange_ramp

profiles = st.lists(st.tuples(st.floats(1.0, 500.0), st.floats(-0.3, 0.3)), min_size=1, max_size=8).map(
    lambda rows: GradeProfile(np.cumsum([r[0] for r in rows]), [r[1] for r in rows], 100.0)
)


@settings(max_examples=25, deadline=None)
@given(profiles)
def test_altitude_is_the_integral_of_the_sine_of_the_grade(road: GradeProfile) -> None:
    s = np.linspace(-50.0, 4100.0, 20_001)
    sine, altitude = np.sin(np.asarray(road.grade(s))), np.asarray(road.altitude(s))
    integral = np.concatenate([[0.0], np.cumsum((sine[1:] + sine[:-1]) / 2 * np.diff(s))])
    # the trapezoidal rule errs by a panel's h²/8 times the largest slope of the sine, per panel
    assert np.allclose(altitude - altitude[0], integral, atol=0.05)


def test_grade_has_no_kink_at_the_knots() -> None:
    road = interchange_ramp()
    for knot in RAMP_SPEED * np.array([27.0, 35.7, 57.0, 69.0, 88.0, 98.0]):
        near = np.asarray(road.grade(knot + np.array([-2e-3, -1e-3, 0.0, 1e-3, 2e-3])))
        slope = np.diff(near) / 1e-3
        assert np.abs(np.diff(slope)).max() < 1e-7


@pytest.mark.parametrize(
    ("seconds", "degrees"),
    [(0, -1.8), (26.9, -1.8), (40, 3.4), (56.9, 3.4), (75, -3.9), (87.9, -3.9), (105, 0)],
)
def test_ramp_has_the_sections_of_the_paper(seconds: float, degrees: float) -> None:
    assert np.rad2deg(float(interchange_ramp().grade(RAMP_SPEED * seconds))) == pytest.approx(
        degrees, abs=1e-4
    )


def test_grade_stays_beyond_the_ends_and_altitude_goes_on() -> None:
    road = GradeProfile([10.0, 20.0], [0.05, -0.02], 7.0)
    assert float(road.grade(-100.0)) == pytest.approx(0.05)
    assert float(road.grade(500.0)) == pytest.approx(-0.02)
    assert float(road.altitude(0.0)) == pytest.approx(7.0 - 10 * np.sin(0.05))
    assert float(road.altitude(120.0)) == pytest.approx(float(road.altitude(20.0)) + 100 * np.sin(-0.02))


def test_one_knot_is_a_constant_grade() -> None:
    road = GradeProfile([0.0], [0.1])
    assert np.asarray(road.grade([-5.0, 0.0, 5.0])) == pytest.approx(0.1)
    assert np.asarray(road.altitude([-5.0, 0.0, 5.0])) == pytest.approx(np.array([-5, 0, 5]) * np.sin(0.1))


@pytest.mark.parametrize(
    ("distance", "grade", "what"),
    [
        ([0.0, 0.0], [0.0, 0.1], "do not increase"),
        ([0.0, 1.0], [0.0, 0.9], "45°"),
        ([0.0, 1.0], [0.0], "give as many"),
        ([0.0, np.nan], [0.0, 0.1], "do not increase"),
        ([], [], "give as many"),
    ],
)
def test_bad_roads_are_refused(distance: list[float], grade: list[float], what: str) -> None:
    with pytest.raises(InputError, match=what):
        GradeProfile(distance, grade)
