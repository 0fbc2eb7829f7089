"""Vertical loads against the balance of moments."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.vehicles import ThreeDofForces, load_vehicle
from roadstate.vehicles.loads import gravity_part, load_slope, vertical_loads

G = 9.80665
CAR = load_vehicle("suv")
MODEL = ThreeDofForces.from_vehicle(CAR)
M, H = CAR.mass, CAR.geometry.cg_height
L_F, L_R = CAR.geometry.cg_to_front_axle, CAR.geometry.cg_to_rear_axle
T_F, T_R = CAR.geometry.track_front, CAR.geometry.track_rear


def roll_moment(loads: np.ndarray) -> np.ndarray:
    fl, fr, rl, rr = np.moveaxis(np.asarray(loads), -1, 0)
    return (fr - fl) * T_F / 2 + (rr - rl) * T_R / 2


def pitch_moment(loads: np.ndarray) -> np.ndarray:
    fl, fr, rl, rr = np.moveaxis(np.asarray(loads), -1, 0)
    return (rl + rr) * L_R - (fl + fr) * L_F


def test_standing_level() -> None:
    loads = vertical_loads(MODEL, 0.0, 0.0)
    front, rear = CAR.static_axle_loads
    np.testing.assert_allclose(loads, [front / 2, front / 2, rear / 2, rear / 2])


def test_by_hand() -> None:
    car = MODEL.with_parameters(
        {
            "mass": 1500.0,
            "cg_to_front_axle": 1.2,
            "cg_to_rear_axle": 1.5,
            "cg_height": 0.5,
            "track_front": 1.6,
            "track_rear": 1.5,
            "front_roll_share": 1.5 / 2.7,
        }
    )
    # standing 4086.1042 and 3268.8833 a wheel; pitch 416.6667; roll 520.8333 and 444.4444
    loads = vertical_loads(car, -3.0, 2.0)
    np.testing.assert_allclose(loads, [3981.9375, 5023.6042, 2407.7722, 3296.6611], atol=1e-4)


def test_braking_loads_the_front_and_a_left_turn_the_right() -> None:
    rest = vertical_loads(MODEL, 0.0, 0.0)
    assert np.all(np.sign(vertical_loads(MODEL, -3.0, 0.0) - rest) == [1, 1, -1, -1])
    assert np.all(np.sign(vertical_loads(MODEL, 0.0, 3.0) - rest) == [-1, 1, -1, 1])


@pytest.mark.parametrize("grade", [0.1, -0.15])
def test_parked_on_a_slope(grade: float) -> None:
    """Moments about the rear contact: N_f L = m g (l_r cos θ − h sin θ)."""
    car = MODEL.with_parameters({"grade": grade})
    along, across, _ = gravity_part(grade, 0.0)
    loads = vertical_loads(car, along, across)
    front = M * G * (L_R * np.cos(grade) - H * np.sin(grade)) / (L_F + L_R)
    np.testing.assert_allclose(loads[0] + loads[1], front)
    np.testing.assert_allclose(jnp.sum(loads), M * G * np.cos(grade))


def test_parked_on_a_bank_the_lower_side_carries_more() -> None:
    bank = 0.2  # the left side is higher
    car = MODEL.with_parameters({"bank": bank})
    loads = vertical_loads(car, 0.0, gravity_part(0.0, bank)[1])
    np.testing.assert_allclose(roll_moment(loads), M * G * np.sin(bank) * H)
    assert loads[1] > loads[0]


def test_gravity_part_is_gravity_seen_from_the_turned_axes() -> None:
    theta, phi = 0.11, -0.07
    nose_up = np.array([[np.cos(theta), 0, -np.sin(theta)], [0, 1, 0], [np.sin(theta), 0, np.cos(theta)]])
    left_up = np.array([[1, 0, 0], [0, np.cos(phi), -np.sin(phi)], [0, np.sin(phi), np.cos(phi)]])
    up_in_car = (nose_up @ left_up).T @ [0, 0, 1]
    np.testing.assert_allclose(gravity_part(theta, phi), G * up_in_car, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(gravity_part(theta, phi)), G)
    assert gravity_part(0.1, 0.0)[0] > 0
    assert gravity_part(0.0, 0.1)[1] > 0


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
def test_total_and_moments_are_kept_as_wheels_lift(share: float) -> None:
    car = MODEL.with_parameters({"front_roll_share": share})
    a_x, a_y = np.meshgrid(np.linspace(-9, 9, 19), np.linspace(-16, 16, 41))
    loads = np.asarray(vertical_loads(car, a_x, a_y))
    np.testing.assert_allclose(np.sum(loads, -1), M * G)
    assert np.all(loads >= 0)
    np.testing.assert_allclose(pitch_moment(loads), M * H * a_x, atol=1e-6)
    tips = (np.minimum(loads[..., 0], loads[..., 1]) == 0) & (np.minimum(loads[..., 2], loads[..., 3]) == 0)
    np.testing.assert_allclose(roll_moment(loads)[~tips], (M * H * a_y)[~tips], atol=1e-6)
    one_lifts = (np.min(loads, -1) == 0) & ~tips
    assert np.sum(one_lifts) > 20
    assert np.sum(tips) > 20
    # a car that tips stands on one side
    assert np.all(np.abs(roll_moment(loads)[tips]) <= np.abs(M * H * a_y)[tips] + 1e-6)


def test_a_wheelie_puts_everything_on_the_rear() -> None:
    loads = vertical_loads(MODEL, 60.0, 0.0)
    np.testing.assert_allclose(loads, [0, 0, M * G / 2, M * G / 2], atol=1e-9)
    assert np.all(np.isfinite(vertical_loads(MODEL, 60.0, 5.0)))


def test_the_inner_front_wheel_lifts_where_its_load_is_used_up() -> None:
    """m g l_r/(2L) = ε m h a_y/T_f."""
    car = MODEL.with_parameters({"front_roll_share": 0.9})
    limit = G * L_R * T_F / (2 * (L_F + L_R) * 0.9 * H)
    below, above = vertical_loads(car, 0.0, limit * 0.999), vertical_loads(car, 0.0, limit * 1.01)
    assert 0 < below[0] < 0.01 * below[1]
    assert above[0] == 0
    # from there on the rear pair takes the rest
    assert above[3] - above[2] > (below[3] - below[2]) * 1.05


@jax.jit
def slopes(car: ThreeDofForces, point: jax.Array) -> tuple[jax.Array, jax.Array]:
    """(4, 2) load per acceleration, by reverse and by forward differentiation."""

    def load(a: jax.Array) -> jax.Array:
        return vertical_loads(car, a[0], a[1])

    return jax.jacrev(load)(point), jax.jacfwd(load)(point)


@pytest.mark.parametrize(("a_x", "a_y"), [(0.0, 0.0), (-4.0, 3.0), (2.0, 11.0), (0.0, -30.0), (60.0, 3.0)])
def test_gradients_are_right_and_conserve_the_total(a_x: float, a_y: float) -> None:
    car = MODEL.with_parameters({"front_roll_share": 0.8})
    point = jnp.asarray([a_x, a_y])
    J, forward = slopes(car, point)
    step = 1e-5
    for i in range(2):
        there, back = (vertical_loads(car, *(point.at[i].add(s))) for s in (step, -step))
        np.testing.assert_allclose(J[:, i], (there - back) / (2 * step), atol=1e-3)
    np.testing.assert_allclose(jnp.sum(J, 0), 0, atol=1e-9)
    np.testing.assert_allclose(J, forward, atol=1e-9)


def test_slope_while_all_wheels_stand() -> None:
    car = MODEL.with_parameters({"grade": 0.05, "bank": -0.03})
    J, _ = slopes(car, jnp.asarray([-2.0, 1.5]))
    np.testing.assert_allclose(load_slope(car), J.T)
