"""The single-track model against the textbook's linear one."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.tires import Linear
from roadstate.vehicles import SingleTrack, Vehicle, load_vehicle, presets
from roadstate.vehicles.figures import tire_of

NO_DRAG = {"drag_area": 0.0, "rolling_resistance": 0.0, "rolling_resistance_speed": 0.0}


def linear_car(vehicle: Vehicle) -> SingleTrack:
    elastic = tire_of(vehicle)
    tire = Linear(
        slip_stiffness=elastic.slip_stiffness,
        cornering_stiffness=elastic.cornering_stiffness,
        nominal_load=elastic.nominal_load,
    )
    return SingleTrack.from_vehicle(vehicle, tire=tire).with_parameters(NO_DRAG)


@jax.jit
def steady(model: SingleTrack, speed: jax.Array, u: jax.Array) -> jax.Array:
    """(v_y, r) at which neither changes, the speed held."""

    def rates(y: jax.Array) -> jax.Array:
        return model.derivative(jnp.concatenate([speed[None], y]), u)[1:]

    def newton(_: int, y: jax.Array) -> jax.Array:
        return y - jnp.linalg.solve(jax.jacfwd(rates)(y), rates(y))

    return jax.lax.fori_loop(0, 8, newton, jnp.zeros(2))


@jax.jit
def linearised(model: SingleTrack, speed: jax.Array) -> tuple[jax.Array, jax.Array]:
    """∂(v̇_y, ṙ)/∂(v_y, r) and ∂(v̇_y, ṙ)/∂δ, straight ahead."""
    x, u = jnp.zeros(3).at[0].set(speed), jnp.zeros(4)
    A, B = jax.jacfwd(model.derivative, argnums=(0, 1))(x, u)
    return A[1:, 1:], B[1:, 0]


@pytest.mark.parametrize("name", list(presets()))
@pytest.mark.parametrize("speed", [3.0, 15.0, 35.0])
def test_steady_cornering_follows_the_understeer_gradient(name: str, speed: float) -> None:
    """r/δ = v/(L + K v²) (Gillespie, ch. 6), K from the vehicle file."""
    vehicle = load_vehicle(name)
    steer = 1e-4
    v_y, r = steady(linear_car(vehicle), jnp.asarray(speed), jnp.asarray([steer, 0.0, 0.0, 0.0]))
    gain = speed / (vehicle.wheelbase + vehicle.understeer_gradient * speed**2)
    np.testing.assert_allclose(r / steer, gain, rtol=1e-5)
    # the rear axle turns its share of the mass: F_yr = (F_zr/g) v r = c_r F_zr α_r
    slip_angle_rear = speed * r / 9.80665 / vehicle.tires.cornering_stiffness_rear
    np.testing.assert_allclose(v_y, vehicle.geometry.cg_to_rear_axle * r - speed * slip_angle_rear, rtol=1e-4)


def test_the_understeer_gradient_by_definition() -> None:
    """K = dδ/da_y − L/v² at a_y up to 0.05 g with the file's own (Dugoff) tire, still linear there."""
    vehicle = load_vehicle("suv")
    model = SingleTrack.from_vehicle(vehicle).with_parameters(NO_DRAG)
    speed = 25.0
    gain = speed / (vehicle.wheelbase + vehicle.understeer_gradient * speed**2)
    steer = 0.5 / (speed * gain)
    _, r = steady(model, jnp.asarray(speed), jnp.asarray([steer, 0.0, 0.0, 0.0]))
    K = (steer - vehicle.wheelbase * r / speed) / (speed * r)
    np.testing.assert_allclose(K, vehicle.understeer_gradient, rtol=0.01)


def test_rear_steer_takes_away_what_front_steer_gives() -> None:
    vehicle = load_vehicle("family-car")
    model, speed = linear_car(vehicle), jnp.asarray(20.0)
    _, front = steady(model, speed, jnp.asarray([1e-4, 0.0, 0.0, 0.0]))
    _, rear = steady(model, speed, jnp.asarray([0.0, 1e-4, 0.0, 0.0]))
    v_y, both = steady(model, speed, jnp.asarray([1e-4, 1e-4, 0.0, 0.0]))
    np.testing.assert_allclose(rear, -front, rtol=1e-4)
    assert abs(both) < 1e-4 * abs(front)
    np.testing.assert_allclose(v_y, 1e-4 * speed, rtol=1e-4)


@pytest.mark.parametrize("speed", [5.0, 20.0, 40.0])
def test_linearised_it_is_the_textbooks_bicycle(speed: float) -> None:
    vehicle = load_vehicle("compact-car")
    model = linear_car(vehicle)
    m, I_z = vehicle.mass, vehicle.yaw_inertia
    l_f, l_r = vehicle.geometry.cg_to_front_axle, vehicle.geometry.cg_to_rear_axle
    C_f, C_r = vehicle.axle_cornering_stiffness
    A, B = linearised(model, jnp.asarray(speed))
    np.testing.assert_allclose(
        A,
        [
            [-(C_f + C_r) / (m * speed), (C_r * l_r - C_f * l_f) / (m * speed) - speed],
            [(C_r * l_r - C_f * l_f) / (I_z * speed), -(C_f * l_f**2 + C_r * l_r**2) / (I_z * speed)],
        ],
        rtol=1e-9,
    )
    np.testing.assert_allclose(B, [C_f / m, C_f * l_f / I_z], rtol=1e-9)


def test_an_oversteering_car_is_unstable_above_its_critical_speed() -> None:
    """v_crit = √(−L/K)."""
    vehicle = load_vehicle("family-car")
    tires = vehicle.tires.model_copy(
        update={"cornering_stiffness_front": 17.0, "cornering_stiffness_rear": 12.0}
    )
    vehicle = vehicle.model_copy(update={"tires": tires})
    critical = np.sqrt(-vehicle.wheelbase / vehicle.understeer_gradient)
    model = linear_car(vehicle)
    for speed, stable in ((critical * 0.99, True), (critical * 1.01, False)):
        A, _ = linearised(model, jnp.asarray(speed))
        assert (np.max(np.linalg.eigvals(A).real) < 0) == stable


def test_a_bank_needs_the_sideslip_that_carries_it() -> None:
    """Straight ahead on a bank the axles carry m g sin φ: all of it to the left, where the road is higher."""
    bank = 0.03
    model = linear_car(load_vehicle("family-car")).with_parameters({"bank": bank})
    v_y, r = steady(model, jnp.asarray(20.0), jnp.zeros(4))
    seen = model.measure(jnp.asarray([20.0, v_y, r]), jnp.zeros(4))
    force = sum(seen[f"force_y_{w}"] for w in ("fl", "fr", "rl", "rr"))
    balance = model.mass * (9.80665 * np.sin(bank) + 20.0 * r)
    np.testing.assert_allclose(force, balance, rtol=1e-6)
    np.testing.assert_allclose(seen["kinematic_accel_y"], 20.0 * r, rtol=1e-6)
    np.testing.assert_allclose(seen["accel_y"], 9.80665 * np.sin(bank) + 20.0 * r, rtol=1e-6)


def test_left_and_right_carry_alike() -> None:
    model = SingleTrack.from_vehicle(load_vehicle("suv"))
    seen = model.measure(jnp.asarray([20.0, -0.3, 0.4]), jnp.asarray([0.05, 0.0, 0.01, -0.02]))
    for what in ("load", "force_x", "force_y", "slip", "slip_angle"):
        for axle in ("f", "r"):
            np.testing.assert_allclose(seen[f"{what}_{axle}l"], seen[f"{what}_{axle}r"], rtol=1e-12)
    assert seen["force_x_fl"] > 0 > seen["force_x_rl"]
