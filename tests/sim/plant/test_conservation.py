"""Momentum and energy of a car that is driven hard: what goes in is what is there or lost."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.sim.plant.conftest import Plane

from roadstate.core.constants import GRAVITY
from roadstate.sim.plant import Controls, multibody_plant
from roadstate.sim.plant.chassis import Loads
from roadstate.sim.plant.multibody import MultibodyPlant, State
from roadstate.sim.plant.rollout import start
from roadstate.sim.plant.truth import energy_of
from roadstate.sim.plant.vectors import rotation
from roadstate.vehicles import load_vehicle

_DT = 0.001


@eqx.filter_jit
def record(plant: MultibodyPlant, road: Plane, state: State, controls: Controls) -> Any:
    """State, instant and energy at each millisecond."""

    def one(now: State, held: Controls) -> tuple[State, Any]:
        instant = plant.now(road, now, held)
        books = energy_of(plant, now, instant, held)
        return plant.step(road, now, held, _DT), (now.motion, instant, books)

    return jax.lax.scan(one, state, controls)[1]


def hard_drive(plant: MultibodyPlant, seconds: float = 4.0) -> Any:
    """Throttle and shifting while turning, then braking, on a road that climbs."""
    t = np.arange(round(seconds / _DT)) * _DT
    controls = Controls.make(
        steering_wheel=np.full(t.shape, 0.7),
        throttle=np.where((t > 0.2) & (t < 0.55 * seconds), 0.7, 0.0),
        brake=np.where(t > 0.65 * seconds, 0.35, 0.0),
    )
    road = Plane(0.05, 0.02)
    return record(plant, road, start(plant, road, 14.0), controls)


@pytest.mark.parametrize("name", ["family-car", "in-wheel-ev", "truck"])
def test_energy(name: str) -> None:
    _, _, books = hard_drive(multibody_plant(load_vehicle(name)))
    flow = {name: np.asarray(values) for name, values in books._asdict().items()}
    there = flow["kinetic"] + flow["potential"]
    lost = flow["aerodynamic"] + flow["damping"] + flow["friction"] + flow["tires"]
    balance = flow["engine"] - lost
    # trapezoidal rule between the samples
    supplied = np.concatenate([[0.0], np.cumsum(0.5 * (balance[1:] + balance[:-1])) * _DT])
    turned_over = float(np.trapezoid(np.abs(flow["engine"]) + np.abs(lost), dx=_DT))
    assert turned_over > 0.5 * float(there.max() - there.min())
    np.testing.assert_allclose(there - there[0], supplied, atol=0.005 * turned_over)
    for name in ("aerodynamic", "damping", "friction"):
        assert flow[name].min() > -1e-3 * np.abs(lost).max(), name


@pytest.mark.parametrize("name", ["family-car", "in-wheel-ev", "truck"])
def test_momentum(name: str) -> None:
    """Second differences of the masses' places against the forces: nothing of Kane's equations is used."""
    plant = multibody_plant(load_vehicle(name))
    motion, now, _ = jax.tree.map(np.asarray, hard_drive(plant))
    chassis = jax.tree.map(np.asarray, plant.chassis)
    R = np.asarray(jax.vmap(rotation)(motion.attitude))
    centres = np.asarray(jax.vmap(plant.chassis.wheel_centres)(motion.travel))
    sprung = np.broadcast_to(chassis.places[:, :1], (len(R), 3, 1))
    places = motion.position[:, :, None] + R @ np.concatenate([sprung, centres], axis=2)
    force = np.einsum("tij,tjw->tiw", R, now.wheel_force)
    drag = np.einsum("tij,tj->ti", R, now.drag)
    weight = np.array([0, 0, -GRAVITY])

    n = 5  # half width of the differences, in samples
    accel = (places[: -2 * n] - 2 * places[n:-n] + places[2 * n :]) / (n * _DT) ** 2
    momentum_rate = accel @ chassis.masses
    impressed = (force.sum(axis=2) + drag + chassis.masses.sum() * weight)[n:-n]
    scale = np.abs(impressed[:, :2]).max()
    assert scale > 3000
    # a second difference smooths over 10 ms: compare away from switching by medians and everywhere by RMS
    difference = momentum_rate - impressed
    assert np.sqrt((difference**2).mean()) < 0.01 * scale
    assert np.median(np.abs(difference)) < 0.001 * scale

    # angular momentum about the CG's own place at each instant
    axis = now.frame.axis[:, :, [plant.tires.wheel.index(i) for i in range(4)]]
    spun = np.einsum("tij,tjw->ti", R, axis * (chassis.spin_inertia * motion.spin)[:, None, :])
    body = np.einsum("tij,jk,tk->ti", R, chassis.inertia, motion.rate)
    own = (body + spun)[2 * n :] - (body + spun)[: -2 * n]
    arms = places[n:-n] - motion.position[n:-n, :, None]
    orbit = np.einsum("k,tki->ti", chassis.masses, np.cross(arms.swapaxes(1, 2), accel.swapaxes(1, 2)))
    moment = np.einsum("tij,tjw->tiw", R, now.wheel_moment)[n:-n].sum(axis=2)
    hubs = arms[:, :, 1:].swapaxes(1, 2)
    moment = moment + np.cross(hubs, force[n:-n].swapaxes(1, 2)).sum(axis=1)
    moment = moment + np.einsum("tij,tj->ti", R, now.drag_torque)[n:-n]
    moment = moment + np.cross(arms.swapaxes(1, 2), weight).transpose(0, 2, 1) @ chassis.masses
    residual = own / (2 * n * _DT) + orbit - moment
    scale = np.abs(np.cross(hubs, force[n:-n].swapaxes(1, 2))).sum(axis=1).max()
    assert np.sqrt((residual**2).mean()) < 0.01 * scale
    assert np.median(np.abs(residual)) < 0.001 * scale


@pytest.mark.parametrize("name", ["suv", "truck"])
def test_the_equations_of_motion_against_naive_ones(name: str) -> None:
    """Mν̇ = Q − JᵀWb − (0, ω × Iω, 0), formed naively, mass by mass; the truck's axles are rigid."""
    chassis = multibody_plant(load_vehicle(name)).chassis
    rng = np.random.default_rng(3)
    velocity, rate, gravity = rng.normal(size=3), rng.normal(size=3), 9.81 * rng.normal(size=3)
    travel, travel_rate = 0.05 * rng.normal(size=4), rng.normal(size=4)
    centres = np.asarray(chassis.wheel_centres(jnp.asarray(travel)))
    force, torque = 3e3 * rng.normal(size=(3, 4)), 3e2 * rng.normal(size=(3, 4))
    along, on_body, about = 1e3 * rng.normal(size=4), 1e3 * rng.normal(size=3), 1e3 * rng.normal(size=3)
    found = chassis.accelerate(
        velocity, rate, travel_rate, centres, gravity, Loads(force, torque, along, on_body, about)
    )

    masses, inertia = np.asarray(chassis.masses), np.asarray(chassis.inertia)
    # (3, 4 wheels, 4 travels)
    path, turn = (np.asarray(jax.jacobian(f)(jnp.zeros(4))) for f in (chassis.moved, chassis.turned))
    places = np.concatenate([np.asarray(chassis.places)[:, :1], centres], axis=1)
    M, Q = np.zeros((10, 10)), np.zeros(10)
    M[3:6, 3:6] = inertia
    Q[:3], Q[3:6] = on_body, about - np.cross(rate, inertia @ rate)
    for k in range(5):
        p = places[:, k]
        J = np.zeros((3, 10))
        J[:, :3] = np.eye(3)
        J[:, 3:6] = np.stack([np.cross(e, p) for e in np.eye(3)], axis=1)
        slide = np.zeros(3)
        if k:
            J[:, 6:] = path[:, k - 1]
            slide = path[:, k - 1] @ travel_rate
            W = np.zeros((3, 10))
            W[:, 3:6], W[:, 6:] = np.eye(3), turn[:, k - 1]
            Q += J.T @ force[:, k - 1] + W.T @ torque[:, k - 1]
            Q[5 + k] += along[k - 1]
        b = np.cross(rate, velocity) + np.cross(rate, np.cross(rate, p)) + 2 * np.cross(rate, slide) - gravity
        M += masses[k] * J.T @ J
        Q -= masses[k] * J.T @ b
    expected = np.linalg.solve(M, Q)
    np.testing.assert_allclose(np.concatenate(found), expected, rtol=1e-9, atol=1e-9)
    # and ½νᵀMν is the sum over the bodies
    speeds = np.concatenate([velocity, rate, travel_rate])
    naive = chassis.kinetic_energy(velocity, rate, travel_rate, jnp.asarray(centres), jnp.zeros(4))
    assert 0.5 * speeds @ M @ speeds == pytest.approx(float(naive))
