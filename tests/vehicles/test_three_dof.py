"""The three planar models: closed forms, and that they agree with one another."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.tires import MagicFormula, NormalizedDugoff
from roadstate.vehicles import (
    RK4,
    ThreeDof,
    ThreeDofContact,
    ThreeDofForces,
    ThreeDofNormalized,
    VehicleModel,
    load_vehicle,
)

G = 9.80665
CAR = load_vehicle("family-car")
WHEELS = ("fl", "fr", "rl", "rr")
measure = eqx.filter_jit(lambda model, x, u: model.measure(x, u))


def wheels(seen: dict[str, jax.Array], what: str) -> np.ndarray:
    return np.array([seen[f"{what}_{w}"] for w in WHEELS])


@eqx.filter_jit
def simulate(model: VehicleModel, x: jax.Array, u: jax.Array, dt: float, steps: int) -> jax.Array:
    """(steps, n) states, the first after one step; u is held."""

    def advance(x: jax.Array, _: None) -> tuple[jax.Array, jax.Array]:
        x = RK4().step(model, x, u, jnp.asarray(dt))
        return x, x

    return jax.lax.scan(advance, x, None, length=steps)[1]


@pytest.mark.parametrize(("grade", "bank"), [(0.1, 0.0), (-0.2, 0.0), (0.0, 0.15), (0.12, -0.1)])
def test_parked_on_a_slope(grade: float, bank: float) -> None:
    """Held by its tires, the car does not move and its accelerometers read +g sin θ and +g cos θ sin φ."""
    model = ThreeDofForces.from_vehicle(CAR, grade=grade, bank=bank)
    weight = CAR.mass * G
    hold_x, hold_y = weight * np.sin(grade), weight * np.cos(grade) * np.sin(bank)
    l_f, l_r = CAR.geometry.cg_to_front_axle, CAR.geometry.cg_to_rear_axle
    front, rear = l_r / (l_f + l_r) / 2, l_f / (l_f + l_r) / 2
    u = model.input_vector(
        {
            "steer": 0.0,
            **{f"force_x_{w}": hold_x / 4 for w in WHEELS},
            **{f"force_y_{w}": hold_y * s for w, s in zip(WHEELS, (front, front, rear, rear), strict=True)},
        }
    )
    np.testing.assert_allclose(model.derivative(jnp.zeros(3), u), 0, atol=1e-10)
    seen = model.measure(jnp.zeros(3), u)
    np.testing.assert_allclose(seen["accel_x"], G * np.sin(grade))
    np.testing.assert_allclose(seen["accel_y"], G * np.cos(grade) * np.sin(bank), atol=1e-12)
    np.testing.assert_allclose([seen["kinematic_accel_x"], seen["kinematic_accel_y"]], 0, atol=1e-12)
    np.testing.assert_allclose(np.sum(wheels(seen, "load")), weight * np.cos(grade) * np.cos(bank))


def test_rolling_freely_down_a_slope_feels_nothing() -> None:
    model = ThreeDofForces.from_vehicle(CAR, grade=-0.1, drag_area=0.0)
    seen = model.measure(jnp.asarray([20.0, 0.0, 0.0]), jnp.zeros(10))
    assert seen["accel_x"] == 0
    np.testing.assert_allclose(seen["kinematic_accel_x"], G * np.sin(0.1))


def test_without_forces_a_spinning_body_goes_straight_on() -> None:
    """Momentum in the inertial frame: (v_x, v_y) turned by the heading does not change."""
    model = ThreeDofForces.from_vehicle(CAR, drag_area=0.0)
    start, dt, steps = jnp.asarray([12.0, -3.0, 1.5]), 0.005, 400
    states = np.asarray(simulate(model, start, jnp.zeros(10), dt, steps))
    heading = 1.5 * dt * np.arange(1, steps + 1)
    inertial = (states[:, 0] + 1j * states[:, 1]) * np.exp(1j * heading)
    np.testing.assert_allclose(states[:, 2], 1.5, rtol=1e-12)
    np.testing.assert_allclose(inertial, 12 - 3j, rtol=1e-7)
    assert np.ptp(states[:, 0]) > 10


def test_momentum_and_spin_balance() -> None:
    """m a = ΣF and I_z ṙ = ΣM, with the forces laid out anew in the body frame."""
    rng = np.random.default_rng(0)
    steer, rear = 0.3, -0.1
    F_x, F_y = rng.normal(size=(2, 4)) * 2e3
    model = ThreeDofForces.from_vehicle(CAR)
    x = jnp.asarray([15.0, 1.0, 0.4])
    rate = model.derivative(x, jnp.asarray([steer, rear, *F_x, *F_y]))
    angle = np.array([steer, steer, rear, rear])
    body = (F_x + 1j * F_y) * np.exp(1j * angle)
    g = CAR.geometry
    place = np.array(
        [
            g.cg_to_front_axle + 0.5j * g.track_front,
            g.cg_to_front_axle - 0.5j * g.track_front,
            -g.cg_to_rear_axle + 0.5j * g.track_rear,
            -g.cg_to_rear_axle - 0.5j * g.track_rear,
        ]
    )
    drag = 0.5 * CAR.aerodynamics.air_density * CAR.drag_area * 15.0**2
    force = np.sum(body) - drag
    np.testing.assert_allclose(CAR.mass * (rate[0] - 1.0 * 0.4), force.real)
    np.testing.assert_allclose(CAR.mass * (rate[1] + 15.0 * 0.4), force.imag)
    np.testing.assert_allclose(CAR.yaw_inertia * rate[2], np.sum((np.conj(place) * body).imag))


def test_coast_down_in_closed_form() -> None:
    """v̇ = −a v² − b gives v = √(b/a) tan(atan(v₀√(a/b)) − √(ab) t)."""
    model = ThreeDof.from_vehicle(CAR, rolling_resistance_speed=0.0)
    states = simulate(model, jnp.asarray([30.0, 0.0, 0.0]), jnp.zeros(6), 0.1, 600)
    a = 0.5 * CAR.aerodynamics.air_density * CAR.drag_area / CAR.mass
    b = CAR.rolling_resistance.coefficient * G
    t = 0.1 * np.arange(1, 601)
    exact = np.sqrt(b / a) * np.tan(np.arctan(30 * np.sqrt(a / b)) - np.sqrt(a * b) * t)
    np.testing.assert_allclose(states[:, 0], exact, rtol=1e-7)
    np.testing.assert_allclose(states[:, 1:], 0, atol=1e-12)


def test_braking_in_a_straight_line() -> None:
    """Stiffness in proportion to load: every wheel at κ brakes by c σ g, wherever the load goes."""
    model = ThreeDof.from_vehicle(CAR, drag_area=0.0, rolling_resistance=0.0, rolling_resistance_speed=0.0)
    kappa = -0.01
    seen = measure(model, jnp.asarray([20.0, 0.0, 0.0]), jnp.asarray([0.0, 0.0] + [kappa] * 4))
    expected = CAR.tires.slip_stiffness * kappa / (1 + kappa) * G
    np.testing.assert_allclose(seen["accel_x"], expected, rtol=1e-10)
    transfer = CAR.mass * CAR.geometry.cg_height * -expected / CAR.wheelbase
    front, rear = CAR.static_axle_loads
    load = wheels(seen, "load")
    np.testing.assert_allclose([load[:2].sum(), load[2:].sum()], [front + transfer, rear - transfer])
    np.testing.assert_allclose(wheels(seen, "force_x") / load, expected / G, rtol=1e-10)


def test_sliding_with_locked_wheels_stops_at_the_friction_limit() -> None:
    model = ThreeDof.from_vehicle(CAR, drag_area=0.0, rolling_resistance=0.0, rolling_resistance_speed=0.0)
    model = model.with_parameters({"friction": 0.6})
    seen = measure(model, jnp.asarray([20.0, 0.0, 0.0]), jnp.asarray([0.0, 0.0] + [-1.0] * 4))
    np.testing.assert_allclose(seen["accel_x"], -0.6 * G, rtol=1e-4)


def random_motion(seed: int) -> tuple[jax.Array, jax.Array]:
    rng = np.random.default_rng(seed)
    x = [rng.uniform(3, 40), rng.uniform(-2, 2), rng.uniform(-0.5, 0.5)]
    u = [rng.uniform(-0.1, 0.1), rng.uniform(-0.03, 0.03), *rng.uniform(-0.1, 0.1, 4)]
    return jnp.asarray(x), jnp.asarray(u)


@eqx.filter_jit
def misfit(model: ThreeDof, x: jax.Array, u: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """(N,) how far the loads are from those that the accelerations imply, smallest load, acceleration."""

    def one(x: jax.Array, u: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        motion = model.motion(x, u)
        implied = model.wheel_loads(motion.accel_x, motion.accel_y)
        error = jnp.max(jnp.abs(motion.load - implied))
        return error, jnp.min(motion.load), jnp.hypot(motion.accel_x, motion.accel_y)

    return jax.vmap(one)(x, u)


def test_loads_and_accelerations_agree() -> None:
    """The loop forces → accelerations → loads → forces is closed, up to the limit."""
    x, u = (jnp.stack(rows) for rows in zip(*(random_motion(seed) for seed in range(200)), strict=True))
    low = ThreeDof.from_vehicle(CAR, grade=0.05, bank=-0.04)
    error, lightest, accel = misfit(low, x, u)
    assert np.sum(accel > 6) > 40
    assert np.all(lightest > 0)
    assert np.max(error) < 1e-6
    degressive = ThreeDof.from_vehicle(CAR, tire=MagicFormula.default(), grade=0.05, bank=-0.04)
    error, _, accel = misfit(degressive, x, u)
    assert np.sum(accel > 6) > 40
    assert np.max(error) < 50
    assert np.median(error) < 5


def test_beside_a_lifted_wheel_more_rounds_bring_agreement() -> None:
    x, u = (jnp.stack(rows) for rows in zip(*(random_motion(seed) for seed in range(200)), strict=True))
    high = ThreeDof.from_vehicle(CAR, cg_height=1.1, front_roll_share=0.75)
    errors = []
    for rounds in (1, 2, 4, 8):
        error, lightest, _ = misfit(dataclasses.replace(high, load_rounds=rounds), x, u)
        assert np.sum(lightest == 0) > 30
        assert np.max(error[lightest > 0]) < 1e-6
        errors.append(np.mean(error[lightest == 0]))
    assert np.all(np.diff(errors) < 0)
    assert errors[-1] < 0.2 * errors[0]


def test_given_the_same_contacts_the_same_motion_follows() -> None:
    whole = ThreeDof.from_vehicle(CAR, grade=0.03)
    contact = ThreeDofContact.from_vehicle(CAR, grade=0.03)
    forces = ThreeDofForces.from_vehicle(CAR, grade=0.03)
    for seed in range(5):
        x, u = random_motion(seed)
        seen = measure(whole, x, u)
        given = [*u, *wheels(seen, "slip_angle"), *wheels(seen, "load")]
        np.testing.assert_allclose(
            contact.derivative(x, jnp.asarray(given)), whole.derivative(x, u), rtol=1e-9
        )
        # the forces of the contacts, less the rolling resistance that the other two put on the body
        rolling = CAR.rolling_resistance.coefficient + CAR.rolling_resistance.speed_coefficient * x[0] ** 2
        resisting = rolling * G * np.cos(0.03)
        given = [*u[:2], *wheels(seen, "force_x"), *wheels(seen, "force_y")]
        rate = forces.derivative(x, jnp.asarray(given))
        np.testing.assert_allclose(rate - whole.derivative(x, u), [resisting, 0, 0], atol=1e-9)


def test_normalised_forces_are_scaled_by_friction_and_linear_in_it() -> None:
    tire = NormalizedDugoff()
    slip, angle = np.array([0.02, -0.03, 0.01, 0.0]), np.array([0.01, 0.02, -0.01, 0.03])
    load = np.array([3000.0, 4000.0, 3500.0, 4500.0])
    F0 = tire.normalized_forces(slip, angle, load)
    mu = jnp.asarray([0.3, 0.5, 0.7, 0.9])
    x = jnp.asarray([20.0, 0.5, 0.1])
    normalized = ThreeDofNormalized.from_vehicle(CAR, friction=mu)
    u = jnp.asarray([0.05, 0.0, *F0.F_x, *F0.F_y])
    forces = ThreeDofForces.from_vehicle(CAR)
    scaled = jnp.asarray([0.05, 0.0, *(mu * F0.F_x), *(mu * F0.F_y)])
    np.testing.assert_allclose(normalized.derivative(x, u), forces.derivative(x, scaled))

    def rate(friction: jax.Array) -> jax.Array:
        return normalized.with_parameters({"friction": friction}).derivative(x, u)

    np.testing.assert_allclose(rate(2 * mu) - rate(mu), rate(mu) - rate(0 * mu), rtol=1e-9)


def test_yaw_moment_of_one_braked_side() -> None:
    """Friction on the left only, brakes on: the car is pulled to the left about its half track."""
    model = ThreeDof.from_vehicle(CAR, friction=[0.8, 0.0, 0.8, 0.0])
    seen = measure(model, jnp.asarray([20.0, 0.0, 0.0]), jnp.asarray([0.0, 0.0] + [-1.0] * 4))
    assert seen["yaw_accel"] > 0
    F_x = wheels(seen, "force_x")
    assert np.all(F_x[[1, 3]] == 0)
    g = CAR.geometry
    moment = -0.5 * (g.track_front * F_x[0] + g.track_rear * F_x[2])
    np.testing.assert_allclose(seen["yaw_accel"], moment / CAR.yaw_inertia)
