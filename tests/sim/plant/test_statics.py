"""A car at rest: loads, geometry, and slopes it does not creep down."""

from __future__ import annotations

import equinox as eqx
import jax
import numpy as np
import pytest
from tests.sim.plant.conftest import Plane, drive, samples

from roadstate.core.constants import GRAVITY
from roadstate.sim.plant import Controls, multibody_plant
from roadstate.sim.plant.multibody import MultibodyPlant
from roadstate.sim.plant.rollout import start
from roadstate.sim.plant.vectors import rotation
from roadstate.sim.roads.centreline import Bend, make_road
from roadstate.sim.roads.friction import uniform
from roadstate.sim.roads.roughness import rough_surface
from roadstate.vehicles import load_vehicle, presets

_PARKED = Controls.make(brake=1.0)


def in_road_axes(truth: object, slope: float, bank: float) -> np.ndarray:
    """The specific force along the road (uphill), across it and normal to it."""
    R = np.asarray(rotation(truth.attitude))  # type: ignore[attr-defined]
    world = R @ np.asarray(truth.specific_force)  # type: ignore[attr-defined]
    along = np.array([1.0, 0.0, slope]) / np.hypot(1, slope)
    normal = np.array([-slope, -bank, 1.0]) / np.sqrt(1 + slope**2 + bank**2)
    return np.array([along @ world, np.cross(normal, along) @ world, normal @ world])


@pytest.mark.parametrize("name", sorted(presets()))
def test_stands_as_its_file_says(name: str) -> None:
    vehicle = load_vehicle(name)
    plant = multibody_plant(vehicle)
    road = Plane()
    truth = eqx.filter_jit(MultibodyPlant.truth)(plant, road, start(plant, road, 0.0), _PARKED)
    front, rear = vehicle.static_axle_loads
    expected = 0.5 * np.array([front, front, rear, rear])
    np.testing.assert_allclose(truth.load, expected, rtol=1e-6)
    np.testing.assert_allclose(truth.specific_force, [0, 0, GRAVITY], atol=1e-6)
    assert truth.position[2] == pytest.approx(vehicle.geometry.cg_height, abs=1e-6)
    np.testing.assert_allclose(truth.travel, 0, atol=1e-7)
    radius = plant.tires.effective_radius(plant.tires.nominal_deflection)
    np.testing.assert_allclose(radius, vehicle.wheels.radius, rtol=1e-12)


@pytest.mark.parametrize("name", sorted(presets()))
def test_has_the_mass_and_the_yaw_inertia_of_its_file(name: str) -> None:
    vehicle = load_vehicle(name)
    chassis = multibody_plant(vehicle).chassis
    masses, places = np.asarray(chassis.masses), np.asarray(chassis.places)
    assert masses.sum() == pytest.approx(vehicle.mass)
    np.testing.assert_allclose(places @ masses, 0, atol=1e-9)
    yaw = np.asarray(chassis.inertia)[2, 2] + masses @ (places[0] ** 2 + places[1] ** 2)
    assert yaw == pytest.approx(vehicle.yaw_inertia)


@pytest.mark.parametrize(("slope", "bank"), [(0.15, 0.0), (-0.1, 0.0), (0.0, 0.08), (0.1, -0.05)])
def test_parked_on_a_slope_it_feels_gravity_and_does_not_creep(
    car: MultibodyPlant, slope: float, bank: float
) -> None:
    road = Plane(slope, bank)
    state = start(car, road, 0.0)
    _, truth = drive(car, road, state, Controls.make(brake=np.ones(6000)))
    truth = jax.tree.map(lambda a: a[::10], truth)
    position = np.asarray(truth.position)
    # what the trim leaves has settled after 5 s; 55 s more move nothing
    assert np.abs(position[50] - position[0]).max() < 2e-3
    assert np.abs(position[-1] - position[50]).max() < 1e-5
    np.testing.assert_array_less(np.abs(np.asarray(truth.wheel_speed)[50:]), 1e-4)
    # held brakes chatter by 2e-3 m/s²: what counts is the mean
    last = jax.tree.map(lambda a: np.asarray(a)[-200:].mean(axis=0), truth)
    upright = 1 / np.sqrt(1 + slope**2 + bank**2)
    uphill = slope / np.hypot(1, slope)
    across = np.sqrt(max(1 - upright**2 - uphill**2, 0)) * np.sign(bank)
    expected = GRAVITY * np.array([uphill, across, upright])
    np.testing.assert_allclose(in_road_axes(last, slope, bank), expected, atol=1e-3)
    # the body leans a little more than the road: what its accelerometer reads is g times its own slope
    pitch = float(last.attitude[1])
    assert float(last.specific_force[0]) == pytest.approx(-GRAVITY * np.sin(pitch), abs=1e-3)
    assert float(last.grade) == pytest.approx(np.arctan(slope), abs=1e-3)
    assert float(last.bank) == pytest.approx(np.arcsin(across / np.cos(np.arctan(slope))), abs=1e-3)


def test_on_ice_the_brakes_do_not_hold_it(car: MultibodyPlant) -> None:
    road = Plane(0.15, 0.0, 0.1, 0.1)
    state = start(car, Plane(0.15), 0.0)
    _, truth = drive(car, road, state, Controls.make(brake=np.ones(300)))
    assert float(truth.velocity[-1, 0]) < -0.5  # g sin 8.5° is 1.45 m/s², friction takes less than 1 of it
    np.testing.assert_array_less(np.abs(np.asarray(truth.wheel_speed)[-1]), 1e-3)


def test_an_accelerometer_off_the_centre(car: MultibodyPlant) -> None:
    """Against the second difference of the place of a point of the body."""
    road, mounting, t = Plane(), np.array([0.6, -0.3, 0.2]), samples(1.5)
    controls = Controls.make(steering_wheel=np.full(t.shape, 1.5), throttle=0.3)
    _, truth = drive(car, road, start(car, road, 15.0), controls)
    turns = np.stack([np.asarray(rotation(a)) for a in np.asarray(truth.attitude)[99:132]])
    place = np.asarray(truth.position)[99:132] + turns @ mounting
    accel = (place[:-2] - 2 * place[1:-1] + place[2:]) / 0.01**2
    felt = np.einsum("tji,tj->ti", turns[1:-1], accel + np.array([0, 0, GRAVITY]))
    read = np.asarray(truth.specific_force_at(mounting))[100:131]
    assert np.abs(read[:, 1]).mean() > 1  # it turns
    np.testing.assert_allclose(read, felt, atol=0.03)


def test_starts_wherever_on_a_poor_road(car: MultibodyPlant) -> None:
    """Where all wheels can stand they carry the weight; where one hangs in the air it starts near that."""
    road = make_road([Bend(500.0)], friction=uniform(0.9), surface=rough_surface("D", 3, 200.0))

    @eqx.filter_jit
    def stood(plant: MultibodyPlant, place: float) -> object:
        return plant.truth(road, start(plant, road, 5.0, place), Controls.make()).load

    weight = GRAVITY * float(np.sum(car.chassis.masses))
    carried = np.array([np.sum(stood(car, place)) / weight for place in np.arange(0.0, 65.0, 5.0)])
    assert np.isfinite(carried).all()
    assert carried.min() > 0.5
    assert carried.max() < 3.5
    assert np.sum(np.abs(carried - 1) < 1e-3) > 5
