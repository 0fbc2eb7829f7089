"""Sensor axes to the car's."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from roadstate.io.rotation import Rotation, mounting_matrix

NAMES = [s + a for s in "+-" for a in "XYZ"]
angles = st.floats(-3.1, 3.1)


def vector(name: str) -> np.ndarray:
    out = np.zeros(3)
    out["XYZ".index(name[-1])] = -1.0 if name[0] == "-" else 1.0
    return out


@pytest.mark.parametrize(("forward", "up"), [p for p in product(NAMES, NAMES) if p[0][-1] != p[1][-1]])
def test_two_named_axes_make_the_third_by_the_right_hand_rule(forward: str, up: str) -> None:
    matrix = Rotation(forward=forward, up=up).to_matrix()
    left = np.cross(vector(up), vector(forward))
    np.testing.assert_array_equal(matrix, [vector(forward), left, vector(up)])
    assert np.linalg.det(matrix) == pytest.approx(1.0)


@pytest.mark.parametrize("given_axes", [("forward", "left"), ("forward", "up"), ("left", "up")])
def test_any_two_axes_say_the_same(given_axes: tuple[str, str]) -> None:
    axes = {"forward": "-y", "left": "-Z", "up": "+x"}
    some = {k: axes[k] for k in given_axes}
    np.testing.assert_array_equal(Rotation(**some).to_matrix(), Rotation(**axes).to_matrix())


def test_of_all_triples_of_axes_the_right_handed_ones_pass() -> None:
    passed = 0
    for names in permutations("XYZ"):
        for signs in product("+-", repeat=3):
            forward, left, up = (s + n for s, n in zip(signs, names, strict=True))
            is_right = np.dot(np.cross(vector(forward), vector(left)), vector(up)) > 0
            if is_right:
                Rotation(forward=forward, left=left, up=up)
                passed += 1
            else:
                with pytest.raises(ValidationError, match="no right-handed set"):
                    Rotation(forward=forward, left=left, up=up)
    assert passed == 24


@given(angles, st.floats(-1.5, 1.5), angles)
def test_mounting_angles_make_a_proper_rotation(roll: float, pitch: float, yaw: float) -> None:
    matrix = mounting_matrix(roll, pitch, yaw)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1.0)


@given(angles, st.floats(-1.5, 1.5), angles)
def test_mounting_angles_are_three_turns_one_after_the_other(roll: float, pitch: float, yaw: float) -> None:
    one_by_one = mounting_matrix(0, 0, yaw) @ mounting_matrix(0, pitch, 0) @ mounting_matrix(roll, 0, 0)
    np.testing.assert_allclose(mounting_matrix(roll, pitch, yaw), one_by_one, atol=1e-12)


@pytest.mark.parametrize(
    ("angle", "sensor", "car"),
    [
        # nose down: gravity's reaction, upward, has a part along the sensor's backward axis
        ({"pitch": 0.1}, [-9.81 * np.sin(0.1), 0, 9.81 * np.cos(0.1)], [0, 0, 9.81]),
        # right side down: the sensor's left axis points up a little
        ({"roll": 0.1}, [0, 9.81 * np.sin(0.1), 9.81 * np.cos(0.1)], [0, 0, 9.81]),
        # turned to the left: accelerating shows to the sensor's right
        ({"yaw": 0.1}, [2 * np.cos(0.1), -2 * np.sin(0.1), 0], [2, 0, 0]),
    ],
)
def test_the_signs_of_the_mounting_angles(
    angle: dict[str, float], sensor: list[float], car: list[float]
) -> None:
    np.testing.assert_allclose(Rotation(**angle).to_matrix() @ np.array(sensor), car, atol=1e-12)


def test_a_matrix_and_named_axes_agree_and_take_the_same_angles() -> None:
    named = Rotation(forward="-Y", up="X", roll="-4.5 deg", yaw="-8 deg")
    matrix = Rotation(matrix=((0, -1, 0), (0, 0, -1), (1, 0, 0)), roll="-4.5 deg", yaw="-8 deg")
    np.testing.assert_allclose(named.to_matrix(), matrix.to_matrix())
    assert named.yaw == pytest.approx(np.radians(-8))


@given(angles, st.floats(-1.5, 1.5), angles, st.integers(0, 2), st.floats(0.003, 3))
def test_a_matrix_that_stretches_or_mirrors_is_refused(
    roll: float, pitch: float, yaw: float, row: int, excess: float
) -> None:
    good = mounting_matrix(roll, pitch, yaw)
    np.testing.assert_allclose(Rotation(matrix=good.tolist()).to_matrix(), good)
    stretched, mirrored = good.copy(), good.copy()
    stretched[row] *= 1 + excess
    mirrored[row] *= -1
    with pytest.raises(ValidationError, match="not orthonormal"):
        Rotation(matrix=stretched.tolist())
    with pytest.raises(ValidationError, match="mirrors"):
        Rotation(matrix=mirrored.tolist())
