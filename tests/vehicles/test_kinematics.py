"""Wheel kinematics against plane geometry."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.vehicles.kinematics import (
    sliding_jacobian,
    to_body,
    wheel_positions,
    wheel_slips,
    wheel_steer,
    wheel_velocities,
)

PLACES = wheel_positions(1.2, 1.5, 1.6, 1.5)


def test_wheels_stand_at_half_tracks_left_positive() -> None:
    np.testing.assert_allclose(PLACES.x, [1.2, 1.2, -1.5, -1.5])
    np.testing.assert_allclose(PLACES.y, [0.8, -0.8, 0.75, -0.75])


def test_velocities_by_hand() -> None:
    velocity = wheel_velocities(10.0, 0.3, 0.5, PLACES, jnp.zeros(4))
    np.testing.assert_allclose(velocity.x, [9.6, 10.4, 9.625, 10.375])
    np.testing.assert_allclose(velocity.y, [0.9, 0.9, -0.45, -0.45])


def test_steer_turns_the_frame_and_keeps_the_speed() -> None:
    steer = jnp.asarray([0.7, 0.6, -0.2, -0.3])
    straight = wheel_velocities(7.0, -2.0, 0.9, PLACES, jnp.zeros(4))
    turned = wheel_velocities(7.0, -2.0, 0.9, PLACES, steer)
    np.testing.assert_allclose(np.hypot(*turned), np.hypot(*straight))
    angle = np.arctan2(straight.y, straight.x) - np.arctan2(turned.y, turned.x)
    np.testing.assert_allclose(angle, steer, atol=1e-12)


@pytest.mark.parametrize("radius", [2.5, 6.0, -6.0])
def test_wheels_that_point_around_the_turning_centre_have_no_slip_angle(radius: float) -> None:
    """The body turns about a point abreast of the rear axle; angles up to 60°."""
    r = 1.3
    speed, velocity_y = r * radius, r * 1.5
    steer = np.arctan2(PLACES.x + 1.5, (radius - PLACES.y) * np.sign(radius)) * np.sign(radius)
    velocity = wheel_velocities(speed, velocity_y, r, PLACES, steer)
    distance = np.hypot(PLACES.x + 1.5, radius - PLACES.y)
    slips = wheel_slips(velocity, np.sign(radius) * r * distance / 0.3, 0.3)
    np.testing.assert_allclose(slips.slip_angle, 0, atol=1e-12)
    np.testing.assert_allclose(slips.slip, 0, atol=1e-12)
    assert np.max(np.abs(steer)) > (1.0 if radius == 2.5 else 0.4)


def test_locked_and_driven_wheels() -> None:
    velocity = wheel_velocities(10.0, 0.0, 0.0, PLACES, jnp.zeros(4))
    slips = wheel_slips(velocity, jnp.asarray([0.0, 40.0, 20.0, 10 / 0.3]), 0.3)
    np.testing.assert_allclose(slips.slip, [-1, 0.2, -0.4, 0], atol=1e-12)


def test_slip_angle_is_positive_where_the_road_pushes_left() -> None:
    steered = wheel_velocities(20.0, 0.0, 0.0, PLACES, wheel_steer(0.02))
    np.testing.assert_allclose(wheel_slips(steered, 0.0, 0.3).slip_angle, [0.02, 0.02, 0, 0], atol=1e-12)
    drifting = wheel_velocities(20.0, -1.0, 0.0, PLACES, wheel_steer(0.0))
    np.testing.assert_allclose(wheel_slips(drifting, 0.0, 0.3).slip_angle, np.arctan(0.05), rtol=1e-12)


def test_sliding_jacobian_is_the_derivative_and_the_dual_of_the_forces() -> None:
    rng = np.random.default_rng(1)
    steer = rng.uniform(-1, 1, 4)
    body = rng.normal(size=3) * [20, 3, 1]
    along, across = sliding_jacobian(PLACES, steer)
    velocity = wheel_velocities(*body, PLACES, steer)
    np.testing.assert_allclose(along @ body, -velocity.x)
    np.testing.assert_allclose(across @ body, -velocity.y)

    F_x, F_y = rng.normal(size=(2, 4)) * 1e3
    force = to_body(F_x, F_y, steer)
    moment = np.sum(PLACES.x * force.y - PLACES.y * force.x)
    expected = [np.sum(force.x), np.sum(force.y), moment]
    np.testing.assert_allclose(-(along.T @ F_x + across.T @ F_y), expected)


def test_a_whole_log_at_once() -> None:
    rng = np.random.default_rng(2)
    speed, velocity_y, yaw_rate, front, rear = rng.normal(size=(5, 50))
    velocity = wheel_velocities(speed, velocity_y, yaw_rate, PLACES, wheel_steer(front, rear))
    assert velocity.x.shape == velocity.y.shape == (50, 4)
    one = wheel_velocities(speed[7], velocity_y[7], yaw_rate[7], PLACES, wheel_steer(front[7], rear[7]))
    np.testing.assert_allclose(velocity.x[7], one.x)
    np.testing.assert_allclose(velocity.y[7], one.y)
