"""The seven-DOF models: energy, drive, brakes, slopes, and the forces variant."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.vehicles.drive import held, rolling, simulate

from roadstate.core.channels import WHEELS
from roadstate.vehicles import (
    LinearlyImplicit,
    SevenDof,
    SevenDofForces,
    load_vehicle,
    split_torque,
    wheel_steer,
    wheel_velocities,
)

G = 9.80665
CAR = load_vehicle("family-car")
MODEL = SevenDof.from_vehicle(CAR)
R = CAR.wheels.radius
measure = eqx.filter_jit(lambda model, x, u: model.measure(x, u))


def wheels(seen: dict[str, jax.Array], what: str) -> np.ndarray:
    return np.array([seen[f"{what}_{w}"] for w in WHEELS])


def random_point(seed: int) -> tuple[jax.Array, jax.Array]:
    rng = np.random.default_rng(seed)
    v = rng.uniform(2, 40)
    x = [v, rng.uniform(-2, 2), rng.uniform(-0.6, 0.6), *(v / R * rng.uniform(0.5, 1.5, 4))]
    torque, brake = rng.uniform(-300, 800, 4), rng.uniform(0, 1500, 4)
    return jnp.asarray(x), jnp.asarray([rng.uniform(-0.4, 0.4), rng.uniform(-0.1, 0.1), *torque, *brake])


@pytest.mark.parametrize("seed", range(8))
def test_energy_balance(seed: float) -> None:
    """dE/dt = torques in − brakes and rolling − sliding in the contacts − drag − climbing."""
    model = MODEL.with_parameters({"grade": 0.07, "bank": -0.05})
    x, u = random_point(seed)
    rate = model.derivative(x, u)
    seen = measure(model, x, u)
    F_x, F_y, load = (wheels(seen, what) for what in ("force_x", "force_y", "load"))
    omega = x[3:]
    stored = (
        CAR.mass * (x[0] * rate[0] + x[1] * rate[1])
        + CAR.yaw_inertia * x[2] * rate[2]
        + np.sum(CAR.wheels.inertia * omega * rate[3:])
    )
    velocity = wheel_velocities(x[0], x[1], x[2], model.wheel_positions, wheel_steer(u[0], u[1]))
    sliding = np.sum(F_x * (R * omega - velocity.x) - F_y * velocity.y)
    coefficient = CAR.rolling_resistance.coefficient + CAR.rolling_resistance.speed_coefficient * x[0] ** 2
    braked = np.sum((u[6:] + coefficient * load * R) * omega)
    drag = 0.5 * CAR.aerodynamics.air_density * CAR.drag_area * x[0] ** 3
    climbing = CAR.mass * G * (np.sin(0.07) * x[0] + np.cos(0.07) * np.sin(-0.05) * x[1])
    np.testing.assert_allclose(stored, np.sum(u[2:6] * omega) - braked - sliding - drag - climbing, rtol=1e-9)
    assert sliding > 0


def test_coasting_slows_the_rotating_mass_too() -> None:
    """v̇ = −(F_drag + F_roll)/(m + 4 I_w/R²), the figure the vehicle file gives for the effective mass."""
    states = simulate(MODEL, LinearlyImplicit(), rolling(25.0, R), held(MODEL, 200, {}), 0.01)
    v = float(states[99, 0])
    coefficient = CAR.rolling_resistance.coefficient + CAR.rolling_resistance.speed_coefficient * v**2
    resisting = 0.5 * CAR.aerodynamics.air_density * CAR.drag_area * v**2 + coefficient * CAR.mass * G
    deceleration = (states[90, 0] - states[108, 0]) / 0.18
    np.testing.assert_allclose(deceleration, resisting / CAR.effective_mass(), rtol=1e-3)


@pytest.mark.parametrize(
    ("driven", "expected"), [("front", [1, 1, 0, 0]), ("rear", [0, 0, 1, 1]), ("all", [1, 1, 1, 1])]
)
def test_front_rear_and_all_drive(driven: str, expected: list[int]) -> None:
    """Only driven wheels push; the car gains (ΣT/R − resistance)/effective mass either way."""
    driveline = CAR.driveline.model_copy(update={"driven": driven})
    model = SevenDof.from_vehicle(CAR.model_copy(update={"driveline": driveline}))
    torque = split_torque(800.0, model.drive_split)
    np.testing.assert_allclose(torque, 800 * np.array(expected) / sum(expected))
    u = held(model, 200, {f"drive_torque_{w}": float(t) for w, t in zip(WHEELS, torque, strict=True)})
    states = simulate(model, LinearlyImplicit(), rolling(10.0, R), u, 0.01)
    v = float(states[99, 0])
    F_x = wheels(measure(model, states[99], u[0]), "force_x")
    assert np.all((F_x > 100) == np.array(expected, bool))
    coefficient = CAR.rolling_resistance.coefficient + CAR.rolling_resistance.speed_coefficient * v**2
    resisting = 0.5 * CAR.aerodynamics.air_density * CAR.drag_area * v**2 + coefficient * CAR.mass * G
    gained = (states[108, 0] - states[90, 0]) / 0.18
    np.testing.assert_allclose(gained, (800 / R - resisting) / CAR.effective_mass(), rtol=5e-3)


def test_braking_in_a_straight_line() -> None:
    """The brakes' torque over the radius, less what stops the wheels themselves, is what the road takes."""
    u = held(MODEL, 200, {"brake_torque": 300.0})
    states = simulate(MODEL, LinearlyImplicit(), rolling(25.0, R), u, 0.01)
    seen = measure(MODEL, states[99], u[0])
    spin = MODEL.derivative(states[99], u[0])[3:]
    coefficient = 0.011 + 2.0e-6 * states[99, 0] ** 2
    taken = (300 + coefficient * wheels(seen, "load") * R + CAR.wheels.inertia * spin) / R
    np.testing.assert_allclose(wheels(seen, "force_x"), -taken, rtol=1e-9)
    drag = 0.5 * CAR.aerodynamics.air_density * CAR.drag_area * states[99, 0] ** 2
    np.testing.assert_allclose(seen["accel_x"], -(np.sum(taken) + drag) / CAR.mass, rtol=1e-9)
    np.testing.assert_allclose(states[:, 1:3], 0, atol=1e-9)


def test_a_parked_car_reads_its_slope_and_stays() -> None:
    grade, bank = 0.12, -0.05
    model = MODEL.with_parameters({"grade": grade, "bank": bank})
    u = held(model, 200, {"brake_torque": 1500.0})
    states = simulate(model, LinearlyImplicit(), jnp.zeros(7), u, 0.01)
    seen = measure(model, states[-1], u[0])
    np.testing.assert_allclose(seen["accel_x"], G * np.sin(grade), rtol=1e-3)
    np.testing.assert_allclose(seen["accel_y"], G * np.cos(grade) * np.sin(bank), rtol=1e-3)
    assert np.all(states[:, 3:] == 0)
    # what is left is the creep of a regularised slip, below 2 mm/s
    assert np.max(np.abs(states[-1, :2])) < 2e-3


def test_a_slope_in_equilibrium() -> None:
    """The torque that carries the weight and the resistances holds the speed."""
    grade, v = 0.06, 15.0
    model = MODEL.with_parameters({"grade": grade})
    coefficient = CAR.rolling_resistance.coefficient + CAR.rolling_resistance.speed_coefficient * v**2
    pull = CAR.mass * G * (np.sin(grade) + coefficient * np.cos(grade))
    pull += 0.5 * CAR.aerodynamics.air_density * CAR.drag_area * v**2
    u = held(model, 200, {"drive_torque_fl": pull * R / 2, "drive_torque_fr": pull * R / 2})
    states = simulate(model, LinearlyImplicit(), rolling(v, R), u, 0.01)
    np.testing.assert_allclose(np.diff(states[50:, 0]) / 0.01, 0, atol=2e-3)
    seen = measure(model, states[-1], u[0])
    np.testing.assert_allclose(seen["accel_x"], G * np.sin(grade), rtol=5e-3)
    np.testing.assert_allclose(seen["kinematic_accel_x"], 0, atol=2e-3)


def test_a_gentle_turn_follows_the_understeer_gradient() -> None:
    v, steer = 20.0, 0.003
    states = simulate(MODEL, LinearlyImplicit(), rolling(v, R), held(MODEL, 200, {"steer": steer}), 0.01)
    v, r = float(states[-1, 0]), float(states[-1, 2])
    gain = v / (CAR.wheelbase + CAR.understeer_gradient * v**2)
    np.testing.assert_allclose(r / steer, gain, rtol=0.01)
    seen = measure(MODEL, states[-1], held(MODEL, 1, {"steer": steer})[0])
    np.testing.assert_allclose(seen["accel_y"], v * r, rtol=0.01)


def test_low_friction_on_one_side_turns_the_braking_car_to_the_other() -> None:
    model = MODEL.with_parameters({"friction": [0.8, 0.1, 0.8, 0.1]})
    u = held(model, 200, {"brake_torque": 450.0})
    states = simulate(model, LinearlyImplicit(), rolling(20.0, R), u, 0.01)
    assert np.all(states[5:50, 2] > 0)
    assert np.all(states[60, jnp.array([4, 6])] == 0)
    assert np.all(states[60, jnp.array([3, 5])] > 20)


def test_rear_steering_with_the_front_moves_the_car_aside() -> None:
    both = held(MODEL, 200, {"steer": 0.01, "steer_rear": 0.01})
    front = held(MODEL, 200, {"steer": 0.01})
    crab = simulate(MODEL, LinearlyImplicit(), rolling(20.0, R), both, 0.01)
    turn = simulate(MODEL, LinearlyImplicit(), rolling(20.0, R), front, 0.01)
    assert abs(crab[-1, 2]) < 0.03 * turn[-1, 2]
    np.testing.assert_allclose(crab[-1, 1] / crab[-1, 0], 0.01, rtol=0.05)


@pytest.mark.parametrize("seed", range(4))
def test_with_the_forces_given_the_same_motion_follows(seed: int) -> None:
    forces = SevenDofForces.from_vehicle(CAR, grade=0.02)
    model = MODEL.with_parameters({"grade": 0.02})
    x, u = random_point(seed)
    seen = measure(model, x, u)
    given = jnp.asarray([*u, *wheels(seen, "force_x"), *wheels(seen, "force_y")])
    np.testing.assert_allclose(forces.derivative(x, given), model.derivative(x, u), rtol=1e-6)
    same = forces.measure(x, given)
    for name in ("accel_x", "accel_y", "yaw_accel", "kinematic_accel_y", "wheel_speed_rl"):
        np.testing.assert_allclose(same[name], seen[name], rtol=1e-9)


def test_dual_rear_wheels_have_twice_the_inertia() -> None:
    truck = load_vehicle("truck")
    model = SevenDof.from_vehicle(truck)
    np.testing.assert_allclose(model.wheel_inertia, truck.wheels.inertia * np.array([1, 1, 2, 2]))
    effective = truck.mass + np.sum(model.wheel_inertia) / truck.wheels.radius**2
    np.testing.assert_allclose(effective, truck.effective_mass())
