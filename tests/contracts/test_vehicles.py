"""What every vehicle model owes its users; models are found, not listed."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.core import InputError
from roadstate.core.channels import CHANNELS
from roadstate.tires import MagicFormulaSimple
from roadstate.vehicles import LinearlyImplicit, VehicleModel, load_vehicle, vehicle_models

CAR = load_vehicle("family-car")
MODELS: dict[str, VehicleModel] = {
    name: cls.from_vehicle(CAR, grade=0.03, bank=-0.02) for name, cls in vehicle_models().items()
}
SIDES = {"fl": "fr", "fr": "fl", "rl": "rr", "rr": "rl"}
# what a mirror turns round
ODD = ("velocity_y", "yaw", "steer", "force_y", "normalized_force_y", "slip_angle", "accel_y", "bank")
SCALE = {
    "steer": 0.05,
    "slip": 0.1,
    "slip_angle": 0.1,
    "load": 1500.0,
    "drive_torque": 400.0,
    "brake_torque": 400.0,
    "force": 2000.0,
    "normalized_force": 2000.0,
}


@pytest.fixture(params=list(MODELS))
def model(request: pytest.FixtureRequest) -> VehicleModel:
    return MODELS[str(request.param)]


def scale_of(name: str) -> float:
    return next(v for k, v in sorted(SCALE.items(), key=lambda kv: -len(kv[0])) if name.startswith(k))


def random_inputs(model: VehicleModel, rng: np.random.Generator) -> np.ndarray:
    u = np.array([rng.normal() * scale_of(n) for n in model.inputs])
    positive = [n.startswith(("load", "brake")) for n in model.inputs]
    return np.where(positive, np.abs(u) + 1000.0, u)


def random_state(model: VehicleModel, rng: np.random.Generator) -> np.ndarray:
    v = rng.uniform(3, 40)
    wheels = v / CAR.wheels.radius * rng.uniform(0.9, 1.1, 4)
    return np.array([v, rng.normal(), 0.3 * rng.normal(), *wheels])[: len(model.states)]


def points(model: VehicleModel, count: int = 20) -> tuple[jax.Array, jax.Array]:
    rng = np.random.default_rng(0)
    x = [random_state(model, rng) for _ in range(count)]
    return jnp.asarray(x), jnp.asarray([random_inputs(model, rng) for _ in range(count)])


def corners(model: VehicleModel) -> tuple[jax.Array, jax.Array]:
    """Standstill, locked, spinning, sideways, reverse, about to tip, nothing on."""
    states = np.array(
        [
            [0, 0, 0, 0, 0, 0, 0],
            [15, 0, 0, 0, 0, 0, 0],
            [0, 0, 0, 90, 90, -5, 0],
            [0, 8, 0, 0, 0, 0, 0],
            [-5, 0.1, 0, -16, -16, -16, -16],
            [40, 3, 3, 120, 130, 120, 130],
            [1e-9, -1e-9, 1e-9, 1e-9, 0, 0, 0],
            [20, 0, 0, 20 / CAR.wheels.radius, 0, 0, 0],
        ],
        float,
    )[:, : len(model.states)]
    rng = np.random.default_rng(1)
    u = np.array([random_inputs(model, rng) for _ in states])
    u[::2] = 0
    return jnp.asarray(states), jnp.asarray(u)


@eqx.filter_jit
def everything(model: VehicleModel, x: jax.Array, u: jax.Array) -> tuple[jax.Array, ...]:
    return jax.vmap(lambda x, u: (model.derivative(x, u), model.output(x, u)))(x, u)


def test_the_models_are_found_each_with_a_name_and_a_line() -> None:
    assert {"single_track", "three_dof", "seven_dof", "three_dof_forces", "seven_dof_forces"} <= set(MODELS)
    for name, cls in vehicle_models().items():
        assert cls.name == name
        assert cls.summary
        assert "\n" not in cls.summary


def test_shapes_and_names(model: VehicleModel) -> None:
    (x, *_), (u, *_) = points(model, 1)
    assert model.derivative(x, u).shape == x.shape == (len(model.states),)
    assert model.output(x, u).shape == (len(model.outputs),)
    assert u.shape == (len(model.inputs),)
    assert set(model.optional_inputs) <= set(model.inputs)
    for names in (model.states, model.inputs, model.outputs):
        assert len(set(names)) == len(names)
    assert set(model.states) <= set(model.outputs)
    for name, value in zip(model.states, x, strict=True):
        assert model.measure(x, u)[name] == value
    assert set(model.measure(x, u)) == set(model.outputs)


def test_sensors_have_their_channels_names(model: VehicleModel) -> None:
    for name in ("accel_x", "accel_y", "yaw_rate", "speed", "kinematic_accel_x", "kinematic_accel_y"):
        assert name in CHANNELS
        assert name in model.outputs
    for name in model.inputs:
        assert (
            name in CHANNELS
            or f"ref_{name}" in CHANNELS
            or name.startswith(("steer_rear", "slip", "normalized_force"))
        ), name


def test_values_and_gradients_are_finite_where_models_break(model: VehicleModel) -> None:
    x, u = corners(model)

    params, static = eqx.partition(model, eqx.is_array)

    def total(params: Any, x: jax.Array, u: jax.Array) -> jax.Array:
        """A sum of all there is: what is not finite anywhere is not finite in it."""
        whole = eqx.combine(params, static)
        return jnp.sum(whole.derivative(x, u)) + jnp.sum(whole.output(x, u))

    slope = jax.grad(total, argnums=(0, 1, 2))
    for leaf in jax.tree.leaves(jax.jit(lambda p: jax.lax.map(lambda xu: slope(p, *xu), (x, u)))(params)):
        assert np.all(np.isfinite(leaf))
    step = eqx.filter_jit(jax.vmap(lambda x, u: LinearlyImplicit().step(model, x, u, jnp.asarray(0.01))))
    assert np.all(np.isfinite(step(x, u)))


def test_float32_stays_float32_and_agrees(model: VehicleModel) -> None:
    x, u = points(model)
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), model)
    for a, b in zip(
        everything(single, x.astype(jnp.float32), u.astype(jnp.float32)), everything(model, x, u), strict=True
    ):
        assert a.dtype == jnp.float32
        np.testing.assert_allclose(a, b, rtol=2e-3, atol=2e-3 * np.max(np.abs(b)))


def test_pure_and_the_same_with_jit_and_vmap(model: VehicleModel) -> None:
    before = [np.asarray(leaf).copy() for leaf in jax.tree.leaves(model)]
    x, u = points(model, 3)
    for i, (rate, seen) in enumerate(zip(*everything(model, x, u), strict=True)):
        np.testing.assert_allclose(model.derivative(x[i], u[i]), rate, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(model.output(x[i], u[i]), seen, rtol=1e-9, atol=1e-9)
    assert all(np.array_equal(a, b) for a, b in zip(before, jax.tree.leaves(model), strict=True))


def test_parameters_by_name_batch_and_do_not_recompile(model: VehicleModel) -> None:
    traces = 0

    @eqx.filter_jit
    def rate(model: VehicleModel, x: jax.Array, u: jax.Array) -> jax.Array:
        nonlocal traces
        traces += 1
        return model.derivative(x, u)

    (x, *_), (u, *_) = points(model, 1)
    heavier = model.with_parameters({"mass": 1.2 * model.mass, "grade": 0.1})
    one, two = rate(model, x, u), rate(heavier, x, u)
    assert traces == 1
    assert not np.allclose(one, two)
    assert model.mass != heavier.mass
    pair = jax.tree.map(lambda a, b: jnp.stack([a, b]), model, heavier)
    np.testing.assert_allclose(eqx.filter_vmap(lambda m: m.derivative(x, u))(pair), [one, two], rtol=1e-9)
    assert {"mass", "yaw_inertia", "cg_height", "grade", "bank"} <= set(model.parameters)
    for name, leaf in model.parameters.items():
        changed = model.with_parameters({name: leaf + 1.0}).parameters
        assert {k for k in changed if not np.array_equal(changed[k], model.parameters[k])} == {name}


def mirror(names: tuple[str, ...], values: jax.Array) -> jax.Array:
    swapped = [f"{n[:-2]}{SIDES[n[-2:]]}" if n[-3:-2] == "_" and n[-2:] in SIDES else n for n in names]
    sign = [-1.0 if n.removeprefix("kinematic_").startswith(ODD) else 1.0 for n in names]
    return values[..., jnp.array([names.index(n) for n in swapped])] * jnp.asarray(sign)


def test_a_mirrored_car_does_the_mirror_image(model: VehicleModel) -> None:
    x, u = points(model)
    uneven = {"friction": jnp.asarray([0.4, 0.9, 0.6, 0.8])} if "friction" in model.parameters else {}
    here = model.with_parameters(uneven)
    turned = {k: v[jnp.array([1, 0, 3, 2])] for k, v in uneven.items()}
    there = model.with_parameters({"bank": -model.bank, **turned})
    rate, seen = everything(here, x, u)
    image = everything(there, mirror(model.states, x), mirror(model.inputs, u))
    for value, names, mirrored in zip((rate, seen), (model.states, model.outputs), image, strict=True):
        expected = mirror(names, value)
        np.testing.assert_allclose(mirrored, expected, rtol=1e-7, atol=1e-9 * np.max(np.abs(value)))


def test_kinematic_and_specific_acceleration_differ_by_gravity(model: VehicleModel) -> None:
    x, u = points(model, 5)
    for i in range(5):
        seen, rate = model.measure(x[i], u[i]), model.derivative(x[i], u[i])
        np.testing.assert_allclose(seen["kinematic_accel_x"], rate[0] - x[i, 1] * x[i, 2], atol=1e-9)
        np.testing.assert_allclose(seen["kinematic_accel_y"], rate[1] + x[i, 0] * x[i, 2], atol=1e-9)
        np.testing.assert_allclose(seen["yaw_accel"], rate[2], atol=1e-9)
        along, across = 9.80665 * np.sin(0.03), 9.80665 * np.cos(0.03) * np.sin(-0.02)
        np.testing.assert_allclose(seen["accel_x"] - seen["kinematic_accel_x"], along, atol=1e-9)
        np.testing.assert_allclose(seen["accel_y"] - seen["kinematic_accel_y"], across, atol=1e-9)


def test_names_that_do_not_fit_are_refused(model: VehicleModel) -> None:
    with pytest.raises(InputError, match=r"no parameter 'masss'.*did you mean 'mass'"):
        model.with_parameters({"masss": 1.0})
    with pytest.raises(InputError, match="no input 'steering'"):
        model.input_vector({"steering": 0.0})
    with pytest.raises(InputError, match=f"lacks its input '{model.inputs[0]}'"):
        model.input_vector({})


def test_a_value_for_three_wheels_is_refused() -> None:
    with pytest.raises(InputError, match=r"friction: a value of shape \(3,\).*shape \(4,\)"):
        MODELS["seven_dof"].with_parameters({"friction": jnp.ones(3)})


def test_a_tire_is_taken_where_there_is_one(model: VehicleModel) -> None:
    tire = MagicFormulaSimple()
    if "tire.slip_stiffness" in model.parameters:
        changed = type(model).from_vehicle(CAR, tire=tire)
        assert "tire.B_x" in changed.parameters
    else:
        with pytest.raises(InputError, match="has no tire"):
            type(model).from_vehicle(CAR, tire=tire)
