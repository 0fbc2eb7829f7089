"""The road surface: plan, heights, slopes and their agreement, against closed forms."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import ArrayLike

from roadstate.core import InputError
from roadstate.sim.roads import (
    Bend,
    GradeProfile,
    Road,
    half_cosine,
    interchange_ramp,
    interchange_road,
    make_road,
    rough_surface,
    split,
    uniform,
)
from roadstate.sim.roads.road import RoadPoint

DRY = uniform(0.8)
BENT = st.floats(-0.03, 0.03)


@pytest.fixture(scope="module")
def winding() -> Road:
    """Bends, hills, bank, roughness and two frictions at once."""
    return make_road(
        [Bend(40.0), Bend(30.0, 0.0, 0.02), Bend(60.0, 0.02), Bend(40.0, 0.02, -0.015), Bend(50.0, -0.015)],
        height=GradeProfile.in_plan([0.0, 80.0, 160.0], [0.0, 0.08, -0.05], 3.0).over_plan,
        bank=half_cosine([20.0, 90.0, 150.0], [0.0, 0.06, -0.03]),
        friction=split(0.3, 0.8),
        surface=rough_surface("C", 3, 100.0, 6.0),
    )


@eqx.filter_jit
def _point(road: Road, s: jax.Array, d: jax.Array) -> RoadPoint:
    return road.at(s, d)


def point(road: Road, s: ArrayLike, d: ArrayLike) -> RoadPoint:
    """``road.at`` as one program, not one for each of its operations."""
    return _point(road, jnp.asarray(s, float), jnp.asarray(d, float))


def points(road: Road, count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return rng.uniform(1.0, road.length - 1.0, count), rng.uniform(-2.9, 2.9, count)


def test_arc_of_a_quarter_circle_ends_where_it_should() -> None:
    R = 50.0
    road = make_road([Bend(20.0), Bend(R * np.pi / 2, 1 / R), Bend(30.0)], friction=DRY)
    end = point(road, 20.0 + R * np.pi / 2 + 10.0, 2.0)
    assert float(end.heading) == pytest.approx(np.pi / 2, abs=1e-12)
    assert float(end.x) == pytest.approx(20.0 + R - 2.0, abs=2e-3)
    assert float(end.y) == pytest.approx(R + 10.0, abs=2e-3)
    assert float(point(road, 60.0, 0.0).curvature) == pytest.approx(1 / R, rel=1e-12)


def test_clothoid_follows_fresnel_integrals() -> None:
    special = pytest.importorskip("scipy.special")
    length, end = 80.0, 0.02
    road = make_road([Bend(length, 0.0, end), Bend(10.0, end)], friction=DRY)
    scale = np.sqrt(np.pi * length / end)
    s = np.linspace(0, length - 1, 50)
    sine, cosine = special.fresnel(s / scale)
    p = point(road, s, np.zeros_like(s))
    assert np.asarray(p.x) == pytest.approx(scale * cosine, abs=4e-4)
    assert np.asarray(p.y) == pytest.approx(scale * sine, abs=4e-4)
    assert np.asarray(p.heading) == pytest.approx(end * s**2 / (2 * length), abs=5e-6)


def test_slopes_are_derivatives_of_the_height(winding: Road) -> None:
    s, d = points(winding)
    slopes = jax.jit(jax.vmap(jax.grad(lambda s, d: winding.at(s, d).z, (0, 1))))
    at, (along, across) = point(winding, s, d), slopes(s, d)
    assert np.asarray(at.dz_ds) == pytest.approx(np.asarray(along), abs=1e-9)
    assert np.asarray(at.dz_dd) == pytest.approx(np.asarray(across), abs=1e-9)
    h = 1e-6
    difference = (np.asarray(point(winding, s + h, d).z) - np.asarray(point(winding, s - h, d).z)) / (2 * h)
    assert np.asarray(at.dz_ds) == pytest.approx(difference, abs=3e-4)  # a knot may lie between


def test_place_curvature_and_heading_agree(winding: Road) -> None:
    s, d = points(winding)
    heading = np.asarray(point(winding, s, d).heading)
    slope = jax.jit(jax.vmap(jax.jacfwd(lambda s: winding.at(s, 0.0))))(jnp.asarray(s))
    dx, dy, turning = (np.asarray(a) for a in (slope.x, slope.y, slope.heading))
    assert np.hypot(dx, dy) == pytest.approx(1.0, abs=1e-6)
    assert np.arctan2(dy, dx) == pytest.approx(heading, abs=1e-5)
    assert turning == pytest.approx(np.asarray(point(winding, s, d).curvature), abs=1e-12)


def test_a_place_is_found_again(winding: Road) -> None:
    s, d = points(winding)
    p = point(winding, s, d)
    found_s, found_d = winding.locate(p.x, p.y, s + 0.8)
    # beyond the rounding of the place, the cubic's tangent differs from the heading by its order
    assert np.asarray(found_s) == pytest.approx(s, abs=1e-6)
    assert np.asarray(found_d) == pytest.approx(d, abs=1e-6)


def test_height_is_what_the_profile_says_at_the_distance_travelled() -> None:
    road, profile = interchange_road(), interchange_ramp()
    travelled = np.linspace(5.0, 1000.0, 300)
    grade = np.asarray(profile.grade(travelled))
    fine = np.linspace(0.0, 1000.0, 400_001)
    plan = np.concatenate([[0.0], np.cumsum(np.cos(np.asarray(profile.grade(fine[1:] - 0.00125))) * 0.0025)])
    at = point(road, np.interp(travelled, fine, plan), 0.0)
    assert np.asarray(at.z) == pytest.approx(np.asarray(profile.altitude(travelled)), abs=1e-4)
    assert np.arctan(np.asarray(at.dz_ds)) == pytest.approx(grade, abs=1e-5)


def test_knots_in_plan_lie_where_the_map_shows_them() -> None:
    places = [0.0, 100.0, 300.0, 700.0]
    profile = GradeProfile.in_plan(places, [0.0, 0.15, 0.15, -0.1])
    slope = np.tan([0.0, 0.15, 0.15, -0.1])
    assert profile.over_plan(np.array(places))[1] == pytest.approx(slope, abs=1e-6)
    at = np.linspace(0, 700, 70_001)
    height, slopes = profile.over_plan(at)
    risen = np.concatenate([[0.0], np.cumsum((slopes[1:] + slopes[:-1]) / 2 * 0.01)])
    assert height == pytest.approx(risen, abs=1e-4)


@pytest.mark.parametrize("curved", [False, True])
def test_ramp_has_the_sections_of_the_paper(curved: bool) -> None:
    road = interchange_road(curved=curved)
    for seconds, degrees in ((20.0, -1.8), (45.0, 3.4), (75.0, -3.9), (105.0, 0.0)):
        slope = float(point(road, 9.7 * seconds, 0.0).dz_ds)
        assert np.rad2deg(np.arctan(slope)) == pytest.approx(degrees, abs=0.02)


def test_beyond_its_ends_the_road_goes_straight_on(winding: Road) -> None:
    end = winding.length
    for s0, sign in ((0.0, -1.0), (end, 1.0)):
        here, there = point(winding, s0, 0.0), point(winding, s0 + sign * 25.0, 0.0)
        assert float(there.curvature) == 0.0
        assert float(there.heading) == pytest.approx(float(here.heading), abs=1e-12)
        gone = np.hypot(float(there.x - here.x), float(there.y - here.y))
        assert gone == pytest.approx(25.0, rel=1e-9)
        heights = np.asarray([point(winding, s0 + sign * u, 0.0) for u in (0.0, 1.0, 25.0)])
        smooth = heights[:, 2] - heights[:, 8]  # the unevenness repeats, and does not go straight on
        assert smooth[2] - smooth[0] == pytest.approx(25.0 * (smooth[1] - smooth[0]), abs=1e-9)


def test_bank_lifts_the_left_side() -> None:
    road = make_road([Bend(100.0)], bank=half_cosine([0.0], [0.05]), friction=DRY)
    p = point(road, [50.0, 50.0], [2.0, -2.0])
    assert np.asarray(p.z) == pytest.approx([0.1, -0.1])
    assert np.asarray(p.dz_dd) == pytest.approx([0.05, 0.05])


def test_single_precision_in_gives_single_precision_out(winding: Road) -> None:
    s, d = (jnp.asarray(v, jnp.float32) for v in points(winding, 50))
    low, high = _point(winding, s, d), point(winding, s, d)
    assert {str(v.dtype) for v in low} == {"float32"}
    for a, b in zip(low, high, strict=True):
        assert np.asarray(a) == pytest.approx(np.asarray(b), abs=2e-3)


def test_shapes_and_vmap(winding: Road) -> None:
    s, d = points(winding, 12)
    whole = point(winding, s.reshape(3, 4), d.reshape(3, 4))
    rows = jax.jit(jax.vmap(winding.at))(jnp.asarray(s.reshape(3, 4)), jnp.asarray(d.reshape(3, 4)))
    for a, b in zip(whole, rows, strict=True):
        assert a.shape == (3, 4)
        assert np.asarray(a) == pytest.approx(np.asarray(b), abs=1e-12)


@settings(max_examples=20, deadline=None)
@given(st.lists(st.tuples(st.floats(5, 80), BENT, BENT), min_size=1, max_size=5))
def test_heading_turns_by_the_integral_of_the_curvature(sections: list[tuple[float, float, float]]) -> None:
    road = make_road([Bend(*section) for section in sections], friction=DRY)
    turned = sum(length * (a + b) / 2 for length, a, b in sections)
    assert float(road.at(road.length + 1.0, 0.0).heading) == pytest.approx(turned, abs=1e-3)
    mirrored = make_road([Bend(n, -a, -b) for n, a, b in sections], friction=DRY)
    s = np.linspace(0, road.length, 30)
    left, right = road.at(s, 1.5), mirrored.at(s, -1.5)
    assert np.asarray(left.x) == pytest.approx(np.asarray(right.x), abs=1e-9)
    assert np.asarray(left.y) == pytest.approx(-np.asarray(right.y), abs=1e-9)


@pytest.mark.parametrize(
    ("bends", "what"),
    [([], "no length"), ([Bend(0.0)], "no length"), ([Bend(np.nan)], "no length"), ([Bend(3e5)], "300 km")],
)
def test_roads_that_cannot_be_are_refused(bends: list[Bend], what: str) -> None:
    with pytest.raises(InputError, match=what):
        make_road(bends, friction=DRY)


def test_bank_knots_must_increase() -> None:
    with pytest.raises(InputError, match="do not increase"):
        half_cosine([0.0, 0.0], [0.0, 0.1])
