"""The point-mass plant against closed forms."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.core.constants import GRAVITY
from roadstate.sim import GradeProfile, LongitudinalPlant
from roadstate.sim.longitudinal import Motion, Push, rk4
from roadstate.vehicles import load_vehicle

LEVEL = GradeProfile([0.0], [0.0])


@pytest.fixture(scope="module")
def plant() -> LongitudinalPlant:
    return LongitudinalPlant.from_vehicle(load_vehicle("family-car"))


def run(
    plant: LongitudinalPlant, road: GradeProfile, push: Push, speed: float, dt: float, count: int
) -> Motion:
    start = Motion(jnp.zeros(()), jnp.asarray(speed))

    @eqx.filter_jit
    def go(plant: LongitudinalPlant, road: GradeProfile, push: Push, start: Motion) -> Motion:
        def body(x: Motion, _: None) -> tuple[Motion, Motion]:
            after = plant.step(x, road, push, dt)
            return after, after

        return jax.lax.scan(body, start, None, length=count)[1]

    return go(plant, road, push, start)


def test_steady_speed_on_a_grade_needs_weight_rolling_and_drag(plant: LongitudinalPlant) -> None:
    vehicle, theta, v = load_vehicle("family-car"), 0.06, 20.0
    rolling = vehicle.rolling_resistance.coefficient + vehicle.rolling_resistance.speed_coefficient * v**2
    force = vehicle.mass * GRAVITY * (np.sin(theta) + rolling * np.cos(theta))
    force += 0.5 * vehicle.aerodynamics.air_density * vehicle.drag_area * v**2
    push = Push(force * vehicle.wheels.radius)
    motion = run(plant, GradeProfile([0.0], [theta]), push, v, 0.01, 3000)
    assert float(motion.velocity[-1]) == pytest.approx(v, abs=1e-9)
    assert float(motion.distance[-1]) == pytest.approx(30 * v, rel=1e-9)


def test_coast_down_follows_the_tangent(plant: LongitudinalPlant) -> None:
    """m_e v̇ = −(c + k v²) has v = √(c/k) tan(atan(v₀ √(k/c)) − t √(ck)/m_e)."""
    v0, times = 30.0, 0.01 * np.arange(1, 3001)
    c = float(plant.mass * GRAVITY * plant.rolling)
    k = float(plant.drag + plant.mass * GRAVITY * plant.rolling_growth)
    motion = run(plant, LEVEL, Push(0.0), v0, 0.01, 3000)
    angle = np.arctan(v0 * np.sqrt(k / c)) - times * np.sqrt(c * k) / float(plant.open_mass)
    assert np.asarray(motion.velocity) == pytest.approx(np.sqrt(c / k) * np.tan(angle), abs=1e-9)


def test_approach_to_the_final_speed_follows_the_hyperbolic_tangent(plant: LongitudinalPlant) -> None:
    """m_e v̇ = F − k v² from rest has v = √(F/k) tanh(t √(Fk)/m_e)."""
    ratio = 5.0
    plant = eqx.tree_at(
        lambda p: (p.rolling_growth, p.engine_inertia), plant, (jnp.zeros(()), jnp.asarray(0.2))
    )
    mass = float(plant.open_mass + 0.2 * ratio**2 / plant.radius**2)
    torque = 900.0
    net = torque / float(plant.radius) - float(plant.mass * GRAVITY * plant.rolling)
    k, times = float(plant.drag), 0.01 * np.arange(1, 6001)
    motion = run(plant, LEVEL, Push(torque, 0.0, ratio), 0.0, 0.01, 6000)
    expected = np.sqrt(net / k) * np.tanh(times * np.sqrt(net * k) / mass)
    assert np.asarray(motion.velocity) == pytest.approx(expected, abs=1e-9)


def test_integrator_is_of_fourth_order(plant: LongitudinalPlant) -> None:
    hill = GradeProfile([0.0, 60.0, 120.0], [0.0, 0.15, -0.1])
    strong = eqx.tree_at(lambda p: p.drag, plant, 60 * plant.drag)
    ends = [float(run(strong, hill, Push(800.0), 12.0, 4.0 / n, n).velocity[-1]) for n in (4, 8, 16, 512)]
    errors = np.abs(np.array(ends[:3]) - ends[3])
    order = np.log2(errors[:-1] / errors[1:])
    assert (order > 3.6).all()
    assert (order < 4.9).all()


def test_rk4_matches_the_exponential_to_its_own_taylor_polynomial() -> None:
    h = 0.3
    taylor = 1 - h + h**2 / 2 - h**3 / 6 + h**4 / 24
    assert float(rk4(lambda x: -x, jnp.asarray(2.0), h)) == pytest.approx(2 * taylor, rel=1e-15)


def test_held_car_stands_and_a_released_one_rolls_back(plant: LongitudinalPlant) -> None:
    slope = GradeProfile([0.0], [0.1])
    weight = float(plant.mass * GRAVITY)
    enough = (
        1.001 * (weight * np.sin(0.1) - weight * float(plant.rolling) * np.cos(0.1)) * float(plant.radius)
    )
    held = run(plant, slope, Push(0.0, enough), 0.0, 0.01, 200)
    assert (np.asarray(held.velocity) == 0).all()
    assert (np.asarray(held.distance) == 0).all()
    assert float(plant.acceleration(0.0, 0.1, Push(0.0, enough))) == 0.0
    rolling = run(plant, slope, Push(0.0, 0.99 * enough), 0.0, 0.01, 200)
    assert (np.asarray(rolling.velocity) < 0).all()


def test_brakes_stop_the_car_and_do_not_turn_it_round(plant: LongitudinalPlant) -> None:
    torque = 3000.0
    motion = run(plant, LEVEL, Push(0.0, torque), 10.0, 0.001, 5000)
    velocity = np.asarray(motion.velocity)
    stopped = int(np.argmax(velocity == 0))
    assert (velocity >= 0).all()
    assert (velocity[stopped:] == 0).all()
    force = torque / float(plant.radius) + float(plant.mass * GRAVITY * plant.rolling)
    plain = 10.0**2 / (2 * force / float(plant.open_mass))
    assert 0.97 * plain < float(motion.distance[-1]) < plain  # drag helps a little


def test_uphill_coasting_loses_what_height_and_friction_take(plant: LongitudinalPlant) -> None:
    """½ m_e v² + m g z + ∫(drag + rolling) ds stays."""
    hill = GradeProfile([0.0, 100.0, 250.0], [0.0, 0.08, -0.03])
    dt = 0.001
    motion = run(plant, hill, Push(0.0), 25.0, dt, 12_000)
    v = np.concatenate([[25.0], np.asarray(motion.velocity)])
    s = np.concatenate([[0.0], np.asarray(motion.distance)])
    rolling = float(plant.rolling) + float(plant.rolling_growth) * v**2
    weight = float(plant.mass) * GRAVITY
    loss = float(plant.drag) * v**2 + weight * rolling * np.cos(np.asarray(hill.grade(s)))
    power = loss * v
    spent = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * dt)])
    energy = 0.5 * float(plant.open_mass) * v**2 + weight * np.asarray(hill.altitude(s)) + spent
    assert np.abs(energy / energy[0] - 1).max() < 1e-9


def test_backward_motion_mirrors_forward_motion(plant: LongitudinalPlant) -> None:
    forward = run(plant, LEVEL, Push(200.0, 50.0), 5.0, 0.01, 100)
    backward = run(plant, LEVEL, Push(-200.0, 50.0), -5.0, 0.01, 100)
    assert np.asarray(backward.velocity) == pytest.approx(-np.asarray(forward.velocity), rel=1e-12)
