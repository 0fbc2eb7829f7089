"""Assembling state-space models by name: wiring, noise, and what is refused."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.assembly import AssembledModel, assemble
from roadstate.core import InputError
from roadstate.core.channels import WHEELS
from roadstate.tires import Brush
from roadstate.vehicles import (
    LinearlyImplicit,
    SevenDof,
    SevenDofForces,
    SingleTrack,
    ThreeDof,
    ThreeDofForces,
    load_vehicle,
)

CAR = load_vehicle("family-car")
G = 9.80665


def bicycle(**changes: Any) -> AssembledModel:
    """v_y, r and the front and rear friction of a single-track car at a known speed."""
    options: dict[str, Any] = {
        "states": ["velocity_y", "yaw_rate"],
        "parameters": ["friction"],
        "groupings": {"friction": "front_rear"},
        "sensors": ["accel_y", "yaw_rate"],
        "noise": {"velocity_y": 0.1, "yaw_rate": 0.02, "friction": 0.05},
        "sensor_noise": {"accel_y": 0.1, "yaw_rate": 0.01},
        "prior": {"velocity_y": (0.0, 0.5), "yaw_rate": (0.0, 0.2), "friction": (0.8, 0.3)},
    }
    return assemble(SingleTrack.from_vehicle(CAR), **(options | changes))


U = {"speed": 20.0, "steer": 0.03}
X = jnp.asarray([-0.2, 0.3, 0.7, 0.9])


def test_rows_and_inputs_by_name() -> None:
    model = bicycle()
    assert model.states == ("velocity_y", "yaw_rate", "friction_front", "friction_rear")
    assert model.sensors == ("accel_y", "yaw_rate")
    assert model.inputs == ("speed", "steer")
    assert model.index("friction_rear") == 3
    prior = model.prior()
    np.testing.assert_allclose(prior.mean, [0, 0, 0.8, 0.8])
    np.testing.assert_allclose(prior.std, [0.5, 0.2, 0.3, 0.3])
    np.testing.assert_allclose(model.sqrt_R(U), np.diag([0.1, 0.01]))


def test_it_is_the_vehicle_with_those_states_and_parameters() -> None:
    model = bicycle()
    car = SingleTrack.from_vehicle(CAR, friction=jnp.asarray([0.7, 0.7, 0.9, 0.9]))
    whole, u = jnp.asarray([20.0, -0.2, 0.3]), jnp.asarray([0.03, 0.0, 0.0, 0.0])
    seen = car.measure(whole, u)
    np.testing.assert_allclose(model.h(X, U), [seen["accel_y"], 0.3], rtol=1e-12)
    expected = X + 0.01 * jnp.asarray([*car.derivative(whole, u)[1:], 0, 0])
    np.testing.assert_allclose(model.f(X, U, jnp.asarray(0.01)), expected, rtol=1e-12)


@pytest.mark.parametrize("order", [[1, 0, 2], [2, 1, 0], [1, 2, 0], [0, 1, 2]])
def test_states_in_any_order_are_the_same_car(order: list[int]) -> None:
    names, start = ("speed", "velocity_y", "yaw_rate"), np.array([20.0, -1.0, 0.4])
    car = ThreeDof.from_vehicle(CAR)
    model = assemble(
        car,
        states=[names[i] for i in order],
        sensors=["accel_y"],
        noise=dict.fromkeys(names, 0.1),
        sensor_noise={"accel_y": 0.1},
        prior=dict.fromkeys(names, (0.0, 1.0)),
        integrator=LinearlyImplicit(),
    )
    u = jnp.asarray([0.05, 0.0, 0.03, -0.05, 0.02, 0.01])
    known, dt = dict(zip(model.inputs, [u[0], *u[2:]], strict=True)), jnp.asarray(0.01)
    expected = LinearlyImplicit().step(car, jnp.asarray(start), u, dt)
    np.testing.assert_allclose(
        model.f(jnp.asarray(start[order]), known, dt), expected[jnp.asarray(order)], rtol=1e-12
    )
    np.testing.assert_allclose(
        model.h(jnp.asarray(start[order]), known), [car.measure(jnp.asarray(start), u)["accel_y"]], rtol=1e-12
    )


def test_a_tire_parameter_of_one_number_may_become_one_an_axle() -> None:
    car = ThreeDof.from_vehicle(CAR, tire=Brush())
    name = "tire.cornering_stiffness"
    model = assemble(
        car,
        parameters=[name],
        groupings={name: "front_rear"},
        sensors=["accel_y"],
        noise={name: 0.0},
        sensor_noise={"accel_y": 0.1},
        prior={name: (5e4, 1e4)},
    )
    x, u = jnp.asarray([20.0, -1.0, 0.4]), jnp.asarray([0.05, 0.0, 0.03, -0.05, 0.02, 0.01])
    known = dict(zip(model.inputs, [*x, u[0], *u[2:]], strict=True))
    seen = car.with_parameters({name: [4e4, 4e4, 6e4, 6e4]}).measure(x, u)
    np.testing.assert_allclose(model.h(jnp.asarray([4e4, 6e4]), known), [seen["accel_y"]], rtol=1e-12)


def test_inputs_come_as_a_mapping_or_as_an_array() -> None:
    model, dt = bicycle(), jnp.asarray(0.01)
    as_array = jnp.asarray([20.0, 0.03])
    np.testing.assert_array_equal(model.f(X, U, dt), model.f(X, as_array, dt))
    np.testing.assert_array_equal(model.h(X, U | {"not_read": 1.0}), model.h(X, as_array))
    with pytest.raises(InputError, match=r"u lacks 'speed'; add it to u, .*fixed="):
        model.f(X, {"steer": 0.03}, dt)
    with pytest.raises(InputError, match=r"shape \(3,\).*2 inputs.*speed, steer"):
        model.h(X, jnp.zeros(3))


@pytest.mark.parametrize(
    ("grouping", "rows", "wheels"),
    [
        ("one", ["friction"], [0, 0, 0, 0]),
        ("front_rear", ["friction_front", "friction_rear"], [0, 0, 1, 1]),
        ("left_right", ["friction_left", "friction_right"], [0, 1, 0, 1]),
        ("four", [f"friction_{w}" for w in WHEELS], [0, 1, 2, 3]),
    ],
)
def test_groupings(grouping: str, rows: list[str], wheels: list[int]) -> None:
    car = ThreeDof.from_vehicle(CAR)
    model = assemble(
        car,
        parameters=["friction"],
        groupings={"friction": grouping},
        sensors=["accel_x", "accel_y", "yaw_accel"],
        noise={"friction": 0.1},
        sensor_noise={"accel_x": 0.1, "accel_y": 0.1, "yaw_accel": 0.1},
        prior={"friction": (0.8, 0.3)},
    )
    assert list(model.states) == rows
    mu = jnp.linspace(0.2, 0.8, len(rows))
    x, u = jnp.asarray([20.0, -1.0, 0.4]), jnp.asarray([0.05, 0.0, 0.03, -0.05, 0.02, 0.01])
    seen = car.with_parameters({"friction": mu[jnp.asarray(wheels)]}).measure(x, u)
    known = dict(zip(model.inputs, [*x, u[0], *u[2:]], strict=True))
    expected = [seen["accel_x"], seen["accel_y"], seen["yaw_accel"]]
    np.testing.assert_allclose(model.h(mu, known), expected, rtol=1e-12)
    np.testing.assert_array_equal(model.f(mu, known, jnp.asarray(1.0)), mu)


def test_factors_biases_and_known_parameters() -> None:
    model = bicycle(
        parameters=["friction", "mass", "scale.tire.cornering_stiffness", "bias.accel_y"],
        groupings={"friction": "one"},
        known=["grade", "slip_front"],
        noise={
            "velocity_y": 0.1,
            "yaw_rate": 0.02,
            "friction": 0,
            "mass": 0,
            "scale.tire.cornering_stiffness": 0,
            "bias.accel_y": 0.01,
        },
        prior={
            "velocity_y": (0, 1),
            "yaw_rate": (0, 1),
            "friction": (0.8, 0.3),
            "mass": (1500, 100),
            "scale.tire.cornering_stiffness": (1, 0.2),
            "bias.accel_y": (0, 0.2),
        },
    )
    assert model.states[2:] == ("friction", "mass", "scale.tire.cornering_stiffness", "bias.accel_y")
    assert set(model.inputs) == {"speed", "steer", "slip_front", "grade"}
    x = jnp.asarray([-0.2, 0.3, 0.6, 1800.0, 0.9, 0.15])
    nominal = SingleTrack.from_vehicle(CAR)
    stiffness = nominal.parameters["tire.cornering_stiffness"]
    car = nominal.with_parameters(
        {"friction": 0.6, "mass": 1800.0, "tire.cornering_stiffness": 0.9 * stiffness, "grade": 0.05}
    )
    seen = car.measure(jnp.asarray([20.0, -0.2, 0.3]), jnp.asarray([0.03, 0.0, 0.02, 0.0]))
    known = U | {"slip_front": 0.02, "grade": 0.05}
    np.testing.assert_allclose(model.h(x, known), [seen["accel_y"] + 0.15, 0.3], rtol=1e-12)


def test_fixed_states_and_inputs() -> None:
    held = bicycle(fixed={"speed": 20.0})
    assert held.inputs == ("steer",)
    np.testing.assert_array_equal(held.h(X, {"steer": 0.03}), bicycle().h(X, U))


def test_a_bias_for_each_wheel_and_a_bias_for_all() -> None:
    def build(grouping: str) -> AssembledModel:
        return assemble(
            SevenDofForces.from_vehicle(CAR),
            states=["wheel_speed"],
            parameters=["bias.wheel_speed"],
            groupings={"bias.wheel_speed": grouping},
            sensors=["wheel_speed"],
            noise={"wheel_speed": 1.0, "bias.wheel_speed": 0.0},
            sensor_noise={"wheel_speed": 0.1},
            prior={"wheel_speed": (60.0, 5.0), "bias.wheel_speed": (0.0, 1.0)},
        )

    x = jnp.arange(4.0)
    four, one = build("four"), build("one")
    u = dict.fromkeys(four.inputs, 0.0)
    np.testing.assert_allclose(four.h(jnp.concatenate([x, 10 + x]), u), 10 + 2 * x)
    np.testing.assert_allclose(one.h(jnp.append(x, 5.0), u), 5 + x)


# ---- transformations ----


def test_jit_vmap_grad_float32_and_one_compilation() -> None:
    traces = 0

    @eqx.filter_jit
    def both(model: AssembledModel, x: jax.Array, u: Any, dt: jax.Array) -> jax.Array:
        nonlocal traces
        traces += 1
        return jnp.concatenate([model.f(x, u, dt), model.h(x, u)])

    model, dt = bicycle(), jnp.asarray(0.01)
    u = {k: jnp.asarray(v) for k, v in U.items()}
    first = both(model, X, u, dt)
    other = bicycle(
        noise={"velocity_y": 1, "yaw_rate": 1, "friction": 1},
        prior={"velocity_y": (1, 1), "yaw_rate": (1, 1), "friction": (1, 1)},
    )
    both(other, 2 * X, u, 2 * dt)
    assert traces == 1
    steer = {"steer": u["steer"]}
    for speed in (20.0, 25.0):  # held values are data too
        both(bicycle(fixed={"speed": speed}), X, steer, dt)
    assert traces == 2
    many = eqx.filter_vmap(both, in_axes=(None, 0, None, None))(model, jnp.stack([X, 2 * X]), u, dt)
    np.testing.assert_allclose(many[0], first, rtol=1e-12)

    def spread(density: jax.Array, dt: jax.Array) -> jax.Array:
        return jnp.sum(eqx.tree_at(lambda m: m.density, model, density).sqrt_Q(u, dt))

    for value in (0.0, 0.01):
        assert np.all(np.isfinite(jax.grad(spread)(model.density, jnp.asarray(value))))
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), model)
    low = both(
        single,
        X.astype(jnp.float32),
        {k: v.astype(jnp.float32) for k, v in u.items()},
        dt.astype(jnp.float32),
    )
    assert low.dtype == jnp.float32
    np.testing.assert_allclose(low, first, rtol=1e-3)


def test_an_implicit_integrator_moves_a_part_of_the_states() -> None:
    """The wheels alone, the body's motion known: stable at walking pace with steps of 10 ms."""
    model = assemble(
        SevenDof.from_vehicle(CAR),
        states=["wheel_speed"],
        sensors=["wheel_speed"],
        noise={"wheel_speed": 1.0},
        sensor_noise={"wheel_speed": 0.1},
        prior={"wheel_speed": (0.0, 5.0)},
        integrator=LinearlyImplicit(),
        fixed={"velocity_y": 0, "yaw_rate": 0, "steer": 0, "drive_torque": 0, "brake_torque": 0},
    )
    assert model.inputs == ("speed",)
    step = jax.jit(lambda x: model.f(x, {"speed": 1.0}, jnp.asarray(0.01)))
    x = jnp.asarray([0.0, 10.0, 3.0, -5.0])
    for _ in range(30):
        x = step(x)
    np.testing.assert_allclose(x, 1.0 / CAR.wheels.radius, rtol=0.01)


# ---- refusals ----


OWN_NOISE = {"velocity_y": 1.0, "yaw_rate": 1.0}
OWN_PRIOR = {"velocity_y": (0.0, 1.0), "yaw_rate": (0.0, 1.0)}
NO_SLOW: dict[str, Any] = {"groupings": {}, "noise": OWN_NOISE, "prior": OWN_PRIOR}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"states": ["velocity_y", "yaw"]}, "states: unknown 'yaw'; did you mean 'yaw_rate'"),
        ({"states": ["yaw_rate", "yaw_rate"]}, "states: 'yaw_rate' comes twice"),
        ({"sensors": ["acel_y"]}, "sensors: unknown 'acel_y'; did you mean .*'accel_y'"),
        ({"sensors": ["speed"], "sensor_noise": {"speed": 1}}, "'speed' would only read the input"),
        ({"sensors": []}, "sensors: nothing is chosen"),
        (
            {**NO_SLOW, "parameters": ["frictoin"]},
            "no parameter, input or sensor 'frictoin'; did you mean 'f",
        ),
        ({**NO_SLOW, "parameters": ["scale.masss"]}, "did you mean 'scale.mass'"),
        ({**NO_SLOW, "parameters": ["bias.accel_x"]}, "'accel_x' is not a sensor chosen; .*'accel_y'"),
        ({"parameters": ["mass"], "groupings": {"mass": "one"}}, "groupings: mass: is one number"),
        ({"groupings": {"friction": "both"}}, "'both' is no grouping.*front_rear"),
        ({"groupings": {"mass": "one"}}, "groupings: 'mass' is not among the parameters"),
        ({"parameters": ["friction", "scale.friction"]}, "'friction' is chosen twice"),
        ({"noise": OWN_NOISE}, "noise: nothing is said of 'friction_front'; add 'friction'"),
        ({"noise": OWN_NOISE | {"friction": 1, "sped": 1}}, "noise: 'sped' is not a row"),
        ({"noise": OWN_NOISE | {"friction": -1}}, "noise: friction_front: -1 is out of range"),
        ({"noise": OWN_NOISE | {"friction": "much"}}, "noise: friction_front: 'much' is not a number"),
        ({"sensor_noise": {"accel_y": 0, "yaw_rate": 1}}, "sensor_noise: accel_y: 0 is out .*more than zero"),
        ({"sensor_noise": {"accel_y": 1}}, "sensor_noise: nothing is said of 'yaw_rate'"),
        ({"prior": OWN_PRIOR}, "prior: nothing is said of 'friction_front'"),
        ({"prior": OWN_PRIOR | {"friction": 1}}, r"prior: friction_front: is not \(mean, std\)"),
        ({"prior": OWN_PRIOR | {"friction": (0, float("nan"))}}, "prior: friction_front: nan is out"),
        ({"time_constants": {"yaw_rate": 1.0}}, "time_constants: 'yaw_rate' is not a row"),
        ({"time_constants": {"friction": 0.0}}, "time_constants: friction_front: 0 is out of range"),
        ({"known": ["slip_fornt"]}, "known: unknown 'slip_fornt'; did you mean 'slip_front'"),
        ({"known": ["friction"]}, "'friction' is estimated; drop it"),
        ({"fixed": {"mass": 1500}}, r"'mass' is a parameter; set it by vehicle.with_parameters"),
        ({"fixed": {"velocity_y": 0}}, "fixed: unknown 'velocity_y'"),
        ({"fixed": {"speed": 20}, "known": ["speed"]}, "'speed' is both known and fixed"),
        ({"states": [], "parameters": [], "groupings": {}, "noise": {}, "prior": {}}, "nothing is chosen"),
    ],
)
def test_what_does_not_fit_is_named(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        bicycle(**changes)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"parameters": ["force_x_fl", "force_x"], "groupings": {"force_x": "one"}},
            "'force_x_fl' comes twice",
        ),
        ({"sensors": ["force_y_fl"], "sensor_noise": {"force_y_fl": 1}}, "'force_y_fl' would only read"),
    ],
)
def test_an_input_is_estimated_once_and_not_read_where_it_is_known(
    changes: dict[str, Any], message: str
) -> None:
    options: dict[str, Any] = {
        "parameters": ["force_x"],
        "sensors": ["accel_x"],
        "noise": {"force_x": 1.0},
        "sensor_noise": {"accel_x": 0.1},
        "prior": {"force_x": (0.0, 100.0)},
    }
    with pytest.raises(InputError, match=message):
        assemble(ThreeDofForces.from_vehicle(CAR), **(options | changes))
    one = assemble(
        ThreeDofForces.from_vehicle(CAR),
        **(
            options
            | {"groupings": {"force_x": "one"}, "sensors": ["force_x_rl"], "sensor_noise": {"force_x_rl": 1}}
        ),
    )
    u = dict.fromkeys(one.inputs, 0.0)
    np.testing.assert_allclose(one.h(jnp.asarray([123.0]), u), [123.0])


def test_an_unknown_row_is_named() -> None:
    with pytest.raises(InputError, match="no state 'speed'; states: velocity_y"):
        bicycle().index("speed")


def test_a_force_input_cannot_be_state_and_fixed() -> None:
    with pytest.raises(InputError, match="unknown 'force_x'"):
        assemble(
            ThreeDofForces.from_vehicle(CAR),
            parameters=["force_x"],
            sensors=["accel_x"],
            noise={"force_x": 1.0},
            sensor_noise={"accel_x": 0.1},
            prior={"force_x": (0.0, 100.0)},
            fixed={"force_x": 0.0},
        )
