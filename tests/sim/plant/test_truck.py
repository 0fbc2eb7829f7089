"""The truck: rigid axles on leaf springs, two tires beside each other, and the drives it is there for."""

from __future__ import annotations

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.sim.plant.conftest import Plane, circle, drive, samples

from roadstate.core import InputError
from roadstate.sim import run
from roadstate.sim.manoeuvres import manoeuvre
from roadstate.sim.plant import Controls, PlantFigures, multibody_plant
from roadstate.sim.plant.figures import Suspension, usual_figures
from roadstate.sim.plant.multibody import MultibodyPlant
from roadstate.sim.plant.rollout import start
from roadstate.sim.plant.tire_figures import TRUCK, plant_tire
from roadstate.tires.tir import read_tir
from roadstate.vehicles import load_vehicle

_TRUCK = load_vehicle("truck")
_SPACING = usual_figures(_TRUCK).tires.dual_spacing


@pytest.fixture(scope="module")
def truck() -> MultibodyPlant:
    return multibody_plant(_TRUCK)


def test_dual_tires_stand_beside_each_other(truck: MultibodyPlant) -> None:
    assert truck.tires.wheel == (0, 1, 2, 2, 3, 3)
    np.testing.assert_allclose(truck.tires.beside, _SPACING * np.array([0, 0, 0.5, -0.5, 0.5, -0.5]))
    values = jnp.asarray([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    np.testing.assert_array_equal(truck.tires.summed(values), [1, 2, 7, 11])
    np.testing.assert_array_equal(truck.tires.mean(values), [1, 2, 3.5, 5.5])
    np.testing.assert_array_equal(truck.tires.of_wheels(values[:4]), [1, 2, 3, 3, 4, 4])


def test_a_rigid_axle_leans_as_one_body(truck: MultibodyPlant) -> None:
    rng = np.random.default_rng(0)
    travel = 0.05 * rng.normal(size=4)
    leaning = np.asarray(truck.chassis.turned(jnp.asarray(travel)))[0]
    slopes = np.array([travel[0] - travel[1], travel[2] - travel[3]]) / _TRUCK.geometry.track_rear
    np.testing.assert_allclose(leaning, np.repeat(slopes, 2), rtol=1e-12)
    aside = np.asarray(truck.chassis.moved(jnp.asarray(travel)))[1]
    assert aside[0] == pytest.approx(aside[1])
    assert aside[2] == pytest.approx(aside[3])
    # bounce moves and leans no wheel
    both = jnp.asarray([0.05, 0.05, -0.03, -0.03])
    np.testing.assert_allclose(truck.chassis.turned(both)[0], 0, atol=1e-15)
    np.testing.assert_allclose(truck.chassis.moved(both)[1], 0, atol=1e-15)
    # the axle turns about the roll centre: with the body rolled by φ the contact stays where it was
    roll, track = 0.01, _TRUCK.geometry.track_rear
    rolled = 0.5 * roll * track * jnp.asarray([1.0, -1.0, 1.0, -1.0])
    height = usual_figures(_TRUCK).rear.roll_centre_height
    hub = _TRUCK.geometry.cg_height + float(truck.chassis.places[2, 3])
    assert float(truck.chassis.moved(rolled)[1, 2]) == pytest.approx(roll * (height - hub), rel=1e-9)


def test_the_axle_shares_its_load_by_its_lean(truck: MultibodyPlant) -> None:
    """Parked on a bank: the two tires of a side differ by stiffness × spacing × lean of axle to road."""
    road = Plane(0.0, 0.08)
    now = eqx.filter_jit(MultibodyPlant.now)(truck, road, start(truck, road, 0.0), Controls.make(brake=1.0))
    load = np.asarray(now.contact.load)
    k, track = float(truck.tires.stiffness[2]), _TRUCK.geometry.track_rear
    left, right = load[2:4].sum(), load[4:6].sum()
    assert right - left > 2000
    lean = (right - left) / (2 * k * track) / (1 + (_SPACING / track) ** 2)  # all four tires' own stiffness
    np.testing.assert_allclose(load[[3, 5]] - load[[2, 4]], k * _SPACING * lean, rtol=0.05)
    assert load.sum() == pytest.approx(_TRUCK.mass * 9.80665 / np.hypot(1, 0.08), rel=1e-3)


def test_dual_tires_resist_turning(truck: MultibodyPlant) -> None:
    """On a circle of radius R one tire of a pair drives, the other brakes, with C_κ·(spacing/2)/R each."""
    radius, t = 25.0, samples(8.0)
    road = circle(radius)
    wheel = _TRUCK.steering.ratio * _TRUCK.wheelbase / radius
    controls = Controls.make(steering_wheel=np.minimum(t, 1.0) * wheel, gear=0.0)
    state, truth = drive(truck, road, start(truck, road, 3.0), controls)
    now = eqx.filter_jit(MultibodyPlant.now)(truck, road, state, jax.tree.map(lambda a: a[-1], controls))
    turned = float(truth.velocity[-1, 0] / truth.angular_rate[-1, 2])
    along, load = np.asarray(now.contact.force_x), now.contact.load
    C = np.asarray(truck.tires.model.stiffnesses(load)[0])
    halves = 0.5 * (along[[2, 4]] - along[[3, 5]])
    expected = 0.5 * (C[[2, 4]] + C[[3, 5]]) * 0.5 * _SPACING / turned
    # the inner (left) tire of each pair is the slower one over ground: it is driven by the other
    np.testing.assert_allclose(halves, expected, rtol=0.08)
    assert halves.min() > 150


def test_its_tire_has_the_figures_of_its_source(shared_data: Path) -> None:
    source, own = read_tir(shared_data / "tires" / "truck_335_65R22.5_mf5.tir"), read_tir(TRUCK)
    theirs, ours = source.numbers(), own.numbers()
    chosen = {"QSY1", "PTX1", "PTY1", "PTY2"}
    for key in ours.keys() - chosen:
        assert ours[key] == pytest.approx(theirs[key], rel=1e-6), key
    assert own.text("MODEL", "FE_METHOD") == source.text("MODEL", "FE_METHOD") == "YES"


def test_its_tire_is_the_vehicle_files(truck: MultibodyPlant) -> None:
    tire, rear = plant_tire(_TRUCK), _TRUCK.static_axle_loads[1] / 4
    along, _ = (float(a) / rear for a in tire.stiffnesses(rear))
    assert along == pytest.approx(_TRUCK.tires.slip_stiffness)
    # no peak of the lateral force, as truck tires have none
    angles = np.linspace(0.05, 0.6, 50)
    assert (np.diff(tire.forces(0.0, angles, rear, 0.85, 20.0).F_y) > 0).all()


@pytest.mark.parametrize(
    ("name", "speed", "aside"), [("acceleration-lane-changes", 69.0, 0.4), ("ice-lane-change", 29.0, 0.2)]
)
def test_drives_what_it_is_there_for(truck: MultibodyPlant, name: str, speed: float, aside: float) -> None:
    task = manoeuvre(name).prepare(_TRUCK)
    driven = run.drive(truck, task, _TRUCK)
    truth = driven.truth
    off = truth.road[:, 1] - np.asarray(jax.vmap(task.path.at)(truth.road[:, 0]).d)
    assert np.abs(off).max() < aside
    assert np.ptp(truth.road[:, 1]) > 2.5
    assert truth.velocity[-1, 0] * 3.6 > speed
    # no wheel lifts, spins, locks or leans; no spring reaches its stop
    assert (truth.load.min(axis=0) > 0.3 * truth.load[0]).all()
    assert np.abs(truth.slip).max() < 0.06
    assert np.abs(truth.slip_angle).max() < 0.15
    assert np.abs(truth.camber).max() < np.deg2rad(1)
    figures = usual_figures(_TRUCK)
    assert truth.travel.max() < figures.front.bump_travel
    assert -truth.travel.min() < figures.front.rebound_travel
    used = np.hypot(truth.force_x, truth.force_y) / truth.load
    assert used.max() < 0.9 * truth.friction.min()
    engine = truth.engine_speed
    assert engine.max() < 0.95 * float(truck.driveline.largest_speed)


def test_figures_given_complete_the_usual_ones() -> None:
    given = PlantFigures(rear=Suspension.model_validate({"roll_centre_height": "0.8 m"}))
    figures = usual_figures(_TRUCK, given)
    usual = usual_figures(_TRUCK)
    assert figures.rear.roll_centre_height == 0.8
    assert figures.rear.ride_frequency == usual.rear.ride_frequency == 1.7
    assert figures.front == usual.front
    car = usual_figures(load_vehicle("suv"), given)
    assert car.rear.kind == "independent"
    assert car.rear.ride_frequency == PlantFigures().rear.ride_frequency
    with pytest.raises(InputError, match="upright"):
        usual_figures(_TRUCK, PlantFigures(front=Suspension(camber_per_travel=0.5)))
    with pytest.raises(InputError, match="springs off its wheels"):
        usual_figures(load_vehicle("suv"), PlantFigures.model_validate({"front": {"spring_track": 0.5}}))
