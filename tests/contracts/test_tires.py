"""What every tire model owes its users; models are found, not listed."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.tires import (
    MagicFormulaSimple,
    NormalizedDugoff,
    TireModel,
    all_tires,
    linear_stiffness,
    load_tir,
)
from roadstate.tires.mf_build import PASSENGER

MODELS: dict[str, TireModel] = {
    **{name: cls.default() for name, cls in all_tires().items()},
    "normalized_dugoff, as printed": NormalizedDugoff(as_printed=True),
    "magic_formula_simple, as printed": MagicFormulaSimple(as_printed=True),
    "magic_formula_simple, stiffness by friction": MagicFormulaSimple(stiffness_scales_with_friction=True),
    "magic_formula, ellipse": load_tir(PASSENGER, symmetric=True, combination="ellipse"),
    "magic_formula, stiffness by friction": load_tir(
        PASSENGER, symmetric=True, stiffness_follows_friction=True
    ),
}
# The printed similarity form has a direction-dependent slope at zero slip, so only a bounded one.
NO_SLOPE_AT_ZERO = {"magic_formula_simple, as printed"}

# slip, slip angle, load, friction, speed: where formulas like to break
CORNERS = np.array(
    [
        (0, 0, 4000, 0.9, 20),
        (0, 0, 0, 0.9, 20),
        (0.1, 0.05, 0, 0.9, 20),
        (0.1, 0.05, -500, 0.9, 20),
        (0, 0, 4000, 0.9, 0),
        (0, 0, 4000, 0, 20),
        (0.1, 0.1, 4000, 0, 20),
        (0.1, 0, 4000, 0.9, 20),
        (0, 0.1, 4000, 0.9, 20),
        (-1, 0, 4000, 0.9, 20),
        (-1, 0.3, 4000, 0.9, 20),
        (-1, np.pi / 2, 4000, 0.9, 0),
        (0, -np.pi / 2, 4000, 0.9, 0),
        (0, 2.0, 4000, 0.9, 10),
        (-2, 0.1, 4000, 0.9, 20),
        (1e3, 0.1, 4000, 0.9, 0),
        (-1e3, -0.1, 4000, 0.9, 0),
        (1e-12, -1e-12, 4000, 0.9, 20),
        (1, 0.1, 4000, 0.9, -20),
        (0, 0, 4000, 0.9, -20),
        (0.05, 0.05, 40000, 1.5, 70),
        (0.05, 0.05, 1e-3, 0.01, 70),
    ],
    dtype=float,
)


@pytest.fixture(params=list(MODELS))
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def tire(name: str) -> TireModel:
    return MODELS[name]


def random_points(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack(
        [
            rng.choice([-1, 1], count) * 10 ** rng.uniform(-4, 1, count),
            rng.uniform(-1.5, 1.5, count),
            rng.uniform(0, 12000, count),
            rng.uniform(0.05, 1.3, count),
            rng.uniform(-20, 60, count),
        ]
    )


def test_every_model_is_found_with_a_name_a_line_and_a_default() -> None:
    found = all_tires()
    assert {
        "linear",
        "dugoff",
        "modified_dugoff",
        "normalized_dugoff",
        "brush",
        "magic_formula_simple",
    } < set(found)
    for name, cls in found.items():
        assert cls.name == name
        assert cls.summary
        assert "\n" not in cls.summary
        assert all(hasattr(cls.default(), p) for p in cls.fitted)


def test_inputs_broadcast(tire: TireModel) -> None:
    slip, load = np.linspace(-0.2, 0.2, 3)[:, None], np.linspace(0, 6000, 4)
    force = tire.forces(slip, 0.05, load, 0.8, 20.0)
    assert force.F_x.shape == force.F_y.shape == (3, 4)
    for i in range(3):
        for j in range(4):
            one = tire.forces(slip[i, 0], 0.05, load[j], 0.8, 20.0)
            assert one.F_x.shape == ()
            np.testing.assert_allclose((one.F_x, one.F_y), (force.F_x[i, j], force.F_y[i, j]), rtol=1e-12)


def test_jit_and_vmap_change_nothing(tire: TireModel) -> None:
    points = jnp.asarray(random_points(64))
    plain = np.stack(tire.forces(*points.T))
    jitted = np.stack(eqx.filter_jit(lambda m, p: m.forces(*p.T))(tire, points))
    mapped = np.stack(jax.vmap(lambda p: tire.forces(*p))(points))
    np.testing.assert_allclose(jitted, plain, rtol=1e-9, atol=1e-8)
    np.testing.assert_allclose(mapped, plain, rtol=1e-9, atol=1e-8)


def test_parameters_are_leaves_that_batch_and_do_not_recompile(tire: TireModel) -> None:
    traces = 0

    @eqx.filter_jit
    def force(model: TireModel, slip: jax.Array) -> jax.Array:
        nonlocal traces
        traces += 1
        return model.forces(slip, 0.02, 4000.0, 0.9, 20.0).F_x

    slip = jnp.asarray(0.02)
    first = force(tire, slip)
    changed = jax.tree.map(lambda leaf: leaf * 1.01, tire)
    second = force(changed, slip)
    assert traces == 1
    assert first != second

    pair = jax.tree.map(lambda a, b: jnp.stack([a, b]), tire, changed)
    batched = eqx.filter_vmap(lambda m: m.forces(slip, 0.02, 4000.0, 0.9, 20.0).F_x)(pair)
    np.testing.assert_allclose(batched, [first, second], rtol=1e-12)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_values_and_gradients_are_finite_where_formulas_break(tire: TireModel, dtype: type) -> None:
    points = jnp.asarray(CORNERS, dtype)

    def both(model: TireModel, point: jax.Array) -> jax.Array:
        return jnp.stack(model.forces(*point))

    value = jax.vmap(lambda p: both(tire, p))(points)
    assert value.dtype == dtype
    assert np.all(np.isfinite(value))
    reverse = jax.vmap(jax.jacrev(both, argnums=1), (None, 0))(tire, points)
    forward = jax.vmap(jax.jacfwd(both, argnums=1), (None, 0))(tire, points)
    assert np.all(np.isfinite(reverse)), CORNERS[~np.isfinite(reverse).all((1, 2))]
    assert np.all(np.isfinite(forward)), CORNERS[~np.isfinite(forward).all((1, 2))]
    by_parameter = jax.vmap(jax.jacrev(both), (None, 0))(tire, points)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(by_parameter))


def test_float32_gives_float32_and_agrees(tire: TireModel) -> None:
    points = random_points(500)
    single = tire.forces(*jnp.asarray(points, jnp.float32).T)
    double = tire.forces(*points.T)
    scale = 1.0 + points[:, 2] * max(1.0, float(np.max(np.abs(double)) / 12000))
    for a, b in zip(single, double, strict=True):
        assert a.dtype == jnp.float32
        assert np.max(np.abs(a - b) / scale) < 2e-4


def test_left_is_the_mirror_image_of_right(tire: TireModel) -> None:
    slip, angle, *rest = random_points(500).T
    right, left = tire.forces(slip, angle, *rest), tire.forces(slip, -angle, *rest)
    np.testing.assert_allclose(left.F_x, right.F_x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(left.F_y, -right.F_y, rtol=1e-9, atol=1e-9)


def test_reverse_is_forwards_seen_from_behind(tire: TireModel) -> None:
    slip, angle, load, friction, speed = random_points(500).T
    ahead = tire.forces(slip, angle, load, friction, np.abs(speed))
    behind = tire.forces(-slip, angle, load, friction, -np.abs(speed))
    np.testing.assert_allclose(behind.F_x, -ahead.F_x, rtol=1e-12)
    np.testing.assert_allclose(behind.F_y, ahead.F_y, rtol=1e-12)


def test_nothing_is_carried_without_load(tire: TireModel) -> None:
    slip, angle, _, friction, speed = random_points(100).T
    for load in (0.0, -1.0, -1e4):
        assert np.all(np.abs(np.stack(tire.forces(slip, angle, load, friction, speed))) == 0)


def test_no_slip_no_force(tire: TireModel) -> None:
    _, _, load, friction, speed = random_points(100).T
    np.testing.assert_allclose(np.stack(tire.forces(0.0, 0.0, load, friction, speed)), 0, atol=1e-9)


def test_a_locked_wheel_is_braked_in_both_directions(tire: TireModel) -> None:
    # κ = (R_w ω − v_x)/|v_x| is −1 forwards and +1 in reverse
    assert tire.forces(-1.0, 0.0, 4000.0, 0.9, 20.0).F_x < -2000
    assert tire.forces(1.0, 0.0, 4000.0, 0.9, -20.0).F_x > 2000


def test_slip_causes_force_in_its_own_direction(name: str, tire: TireModel) -> None:
    along, across = linear_stiffness(tire, 4000.0, 0.9)
    if name in NO_SLOPE_AT_ZERO:
        force = tire.forces(np.array([1e-3, 0.0]), np.array([0.0, 1e-3]), 4000.0, 0.9, 20.0)
        along, across = force.F_x[0] / 1e-3, force.F_y[1] / 1e-3
    assert 1e4 < along < 2e5
    assert 1e4 < across < 2e5


def test_the_road_never_feeds_energy_into_the_sliding_contact(tire: TireModel) -> None:
    slip, angle, *rest = random_points(3000).T
    force = tire.forces(slip, angle, *rest)
    power = np.asarray(force.F_x * slip + force.F_y * np.tan(angle))
    assert np.all(power >= -1e-9)


@pytest.mark.parametrize("name", [name for name, tire in MODELS.items() if tire.within_friction_circle])
def test_force_stays_within_the_friction_circle_where_promised(name: str) -> None:
    tire = MODELS[name]
    points = np.concatenate([random_points(3000), CORNERS])
    force = np.hypot(*tire.forces(*points.T))
    capacity = points[:, 3] * np.maximum(points[:, 2], 0)
    assert np.all(force <= capacity * (1 + 1e-9))
    assert np.max(force / np.maximum(capacity, 1)) > 0.9


def test_forces_are_continuous(tire: TireModel) -> None:
    fine = 4001
    paths = {
        "slip": (np.linspace(-1.5, 1.5, fine), np.full(fine, 0.03)),
        "slip angle": (np.full(fine, 0.02), np.linspace(-1.5, 1.5, fine)),
        "both": (np.linspace(-0.4, 0.4, fine), np.linspace(0.5, -0.5, fine)),
    }
    for what, (slip, angle) in paths.items():
        for row in tire.forces(slip, angle, 4000.0, 0.9, 20.0):
            steps = np.abs(np.diff(row))
            scale = np.max(np.abs(np.gradient(np.asarray(row)[::8]))) / 8
            assert np.max(steps) < 4 * scale + 1e-6, what
    load = np.linspace(-10, 9000, fine)
    for row in tire.forces(0.03, 0.03, load, 0.9, 20.0):
        assert np.max(np.abs(np.diff(row))) < 10 * 0.9 * (load[1] - load[0]) + 1e-6


def test_pure_functions_leave_the_model_alone(tire: TireModel) -> None:
    before = [np.asarray(leaf).copy() for leaf in jax.tree.leaves(tire)]
    a = tire.forces(0.1, 0.1, 4000.0, 0.9, 20.0)
    b = tire.forces(0.1, 0.1, 4000.0, 0.9, 20.0)
    assert a == b
    assert all(np.array_equal(x, y) for x, y in zip(before, jax.tree.leaves(tire), strict=True))
    with pytest.raises(AttributeError):
        tire.something = 1  # type: ignore[attr-defined]
