"""Friction by place: levels, edges and their smoothness."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.core import InputError
from roadstate.sim.roads import FrictionMap, chessboard, joint, patches, split, uniform


def test_uniform_is_the_same_everywhere() -> None:
    s = jnp.asarray([[-1e4, 0.0], [3.0, 1e5]])
    assert np.asarray(uniform(0.35).at(s, 2 * s)) == pytest.approx(0.35)


def test_joint_changes_within_its_edge_and_nowhere_else() -> None:
    road, s = (
        joint([25.0, 60.0], [0.2, 0.8, 0.4], edge=0.2),
        np.array([0.0, 24.89, 25.0, 25.11, 59.8, 60.2, 1e4]),
    )
    found = np.asarray(road.at(s, np.zeros_like(s)))
    assert found == pytest.approx([0.2, 0.2, 0.5, 0.8, 0.8, 0.4, 0.4])


def test_edge_has_no_kink() -> None:
    road = joint([25.0], [0.2, 0.8], edge=0.5)
    slope = jax.vmap(jax.grad(lambda s: road.at(s, jnp.zeros(()))))
    for end in (24.75, 25.25):
        assert np.asarray(slope(end + jnp.array([-1e-6, 1e-6]))) == pytest.approx([0, 0], abs=1e-4)
    assert float(slope(jnp.array([25.0]))[0]) == pytest.approx(1.5 * 0.6 / 0.5)


def test_split_is_left_and_right() -> None:
    road, d = split(0.2, 0.8), np.array([1.5, 0.101, 0.0, -0.101, -1.5])
    found = np.asarray(road.at(np.zeros(5), d))
    assert found == pytest.approx([0.2, 0.2, 0.5, 0.8, 0.8])


def test_chessboard_changes_sides() -> None:
    board = chessboard(0.8, 0.3, 100.0, 160.0, 20.0)
    s = np.array([50.0, 50.0, 110.0, 110.0, 130.0, 130.0, 150.0, 150.0, 200.0])
    d = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, -1.0])
    assert np.asarray(board.at(s, d)) == pytest.approx([0.8, 0.8, 0.8, 0.3, 0.3, 0.8, 0.8, 0.3, 0.8])


def test_later_patches_cover_earlier_ones_as_a_brute_force_painter_does() -> None:
    rng = np.random.default_rng(1)
    rectangles = []
    for _ in range(12):
        s0, d0 = rng.integers(0, 90), rng.integers(-8, 6)
        bounds = (s0, s0 + rng.integers(2, 30), d0, d0 + rng.integers(1, 5))
        rectangles.append((*(float(b) for b in bounds), float(rng.uniform(0.1, 1.0))))
    road = patches(0.9, rectangles, edge=0.1)
    s, d = rng.integers(-5, 125, 500) + 0.5, rng.integers(-12, 12, 500) + 0.5
    expected = np.full(500, 0.9)
    for start, stop, right, left, friction in rectangles:
        expected[(s > start) & (s < stop) & (d > right) & (d < left)] = friction
    assert np.asarray(road.at(s, d)) == pytest.approx(expected)


def test_patches_may_have_no_bounds() -> None:
    road = patches(0.8, [(-np.inf, 25.0, -np.inf, np.inf, 0.2)])
    assert np.asarray(road.at(np.array([-1e3, 30.0]), np.array([50.0, -50.0]))) == pytest.approx([0.2, 0.8])


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: uniform(0.0), "between 0 and 3"),
        (lambda: joint([1.0, 1.1], [0.2, 0.3, 0.4]), "nearer than their width"),
        (lambda: joint([1.0], [0.2, 0.3, 0.4]), "give one more than edges"),
        (lambda: FrictionMap([[0.5]], edge=0.0), "width above 0"),
        (lambda: patches(0.8, [(5.0, 5.0, -1.0, 1.0, 0.2)]), "is empty"),
        (lambda: chessboard(0.8, 0.3, 0.0, 1e9, 1.0), "squares"),
    ],
)
def test_maps_that_cannot_be_are_refused(make: object, what: str) -> None:
    with pytest.raises(InputError, match=what):
        make()  # type: ignore[operator]
