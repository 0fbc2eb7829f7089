"""How the slope along a car changes as it turns on ground that does not turn with it."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from tests.estimators.along_case import given

from roadstate.calibration.parameters import with_value
from roadstate.core.constants import GRAVITY
from roadstate.estimators.along import SLOPE, SLOPE_RATE, AlongModel
from roadstate.estimators.sideways import Sideways
from roadstate.estimators.tilted_plane import tilting, wander
from roadstate.vehicles import Vehicle

OFFSET = jnp.asarray(0.1)  # m/s², 1σ


@pytest.mark.parametrize("heading", np.linspace(-3.0, 3.0, 7))
@pytest.mark.parametrize("turning", [0.5, -0.3])
def test_a_plane_and_a_road_are_both_within_one_sigma(heading: float, turning: float) -> None:
    """On a plane, by the chain rule; on a road, not at all. As far as the slope to the left is no offset."""
    left, step = -0.15 * np.sin(heading), 1e-6
    exact = 0.15 * (np.cos(heading + turning * step) - np.cos(heading)) / step
    told = tilting(jnp.asarray(2.0), jnp.asarray(turning), jnp.asarray([GRAVITY * left, 0.0]), OFFSET)
    mean, std = np.asarray(told) / GRAVITY
    either = 1.96 * 0.1 / GRAVITY
    is_offset = either**4 / (left**4 + either**4)
    assert mean + np.sign(exact) * std == pytest.approx((1 - is_offset / 2) * exact, abs=1e-6)
    assert mean - np.sign(exact) * std == pytest.approx(-is_offset / 2 * exact, abs=1e-6)


def test_an_offset_of_the_accelerometer_is_no_tilt() -> None:
    """Town streets are level: what seems to lean there by 1 % moves their slope by a 34th of a plane's,
    and errs by as much as if it were one."""
    turns, left = 0.5, GRAVITY * 0.01
    mean, std = np.asarray(tilting(jnp.asarray(2.0), jnp.asarray(turns), jnp.asarray([left, left]), OFFSET))
    assert mean == pytest.approx(0.03 * turns * left, rel=0.02)
    assert std == pytest.approx(0.5 * turns * np.hypot(left, left))


def test_of_an_accelerometer_without_offset_every_tilt_is_believed(vehicle: Vehicle) -> None:
    """And of one that may lie by the weight of a tenth of the car, as a phone in a holder, hardly any."""
    turns, left = 0.5, GRAVITY * 0.03
    told = {}
    for bias in (0.0, 1.0):
        offset = Sideways(with_value(vehicle, ("sensors", "accel", "bias"), bias), ()).offset
        bank = jnp.asarray([left, 0.0])
        told[bias] = float(tilting(jnp.asarray(2.0), jnp.asarray(turns), bank, offset)[0])
    assert told[0.0] == pytest.approx(0.5 * turns * left, rel=1e-3)
    assert abs(told[1.0]) < 1e-3 * told[0.0]


def test_on_the_road_slopes_go_along() -> None:
    for speed in (6.0, -6.0, 30.0):
        assert not tilting(jnp.asarray(speed), jnp.asarray(0.5), jnp.asarray([0.5, 0.1]), OFFSET).any()


def test_a_turn_s_error_is_as_wide_as_its_steps() -> None:
    """Over T = 2 s steps add up to √2 times an error that lasts: white noise like one that fades with T."""
    tilt, dt = jnp.asarray([0.0, 0.3]), jnp.asarray(0.01)
    assert 200 * float(wander(tilt, dt)) ** 2 == pytest.approx(2 * (0.3 * 2.0) ** 2, rel=1e-3)


def test_the_slope_errs_by_the_road_and_by_the_tilt(vehicle: Vehicle) -> None:
    """Variances add; how the slope's rate goes with the road is as it was."""
    model = AlongModel(vehicle, ("accel_x", "wheel_speed_rl", "wheel_speed_rr"), torque_of=None)
    u, dt = given(3.0, 0.0, 0.0), jnp.asarray(0.01)
    both = []
    for tilt in ((0.0, 0.0), (0.1, 0.3)):
        u = u._replace(tilting=jnp.asarray(tilt))
        factor = np.asarray(model.sqrt_Q(u, dt))[SLOPE : SLOPE_RATE + 1]
        both.append(factor @ factor.T)
    level, tilted = both
    assert tilted[0, 0] == pytest.approx(level[0, 0] + float(wander(u.tilting, dt)) ** 2, rel=1e-5)
    np.testing.assert_allclose(tilted[1], level[1], rtol=1e-4)
