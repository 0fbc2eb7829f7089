"""Understeer: that of the vehicle file, in the plant as it drives."""

from __future__ import annotations

import numpy as np
import pytest
from tests.sim.plant.conftest import Plane, drive, samples

from roadstate.core.constants import GRAVITY
from roadstate.sim.plant import Controls, PlantFigures, multibody_plant
from roadstate.sim.plant.figures import SteeringFigures, usual_figures
from roadstate.sim.plant.handling import compliance, linear
from roadstate.sim.plant.multibody import MultibodyPlant
from roadstate.sim.plant.rollout import start
from roadstate.tires.mf_build import PASSENGER
from roadstate.vehicles import Vehicle, load_vehicle, presets

_ACCEL = 0.5  # m/s²


def turned(vehicle: Vehicle, plant: MultibodyPlant, speed: float) -> tuple[float, float, float]:
    """Speed, yaw rate and mean road-wheel angle at the steering wheel after 6 s of a small held angle."""
    road, t = Plane(), samples(6.0)
    angle = _ACCEL / speed**2 * (vehicle.wheelbase + vehicle.understeer_gradient * speed**2)
    ratio = float(plant.steering.ratio)
    controls = Controls.make(steering_wheel=np.minimum(t, 1.0) * angle * ratio, gear=np.zeros(t.shape))
    _, truth = drive(plant, road, start(plant, road, speed), controls)
    end = slice(-50, None)
    return float(truth.velocity[end, 0].mean()), float(truth.angular_rate[end, 2].mean()), angle


def gradient(vehicle: Vehicle, plant: MultibodyPlant) -> float:
    """K of δ v/r = l' + K v², from two speeds."""
    (v1, r1, d1), (v2, r2, d2) = (turned(vehicle, plant, speed) for speed in (12.0, 26.0))
    return (d2 * v2 / r2 - d1 * v1 / r1) / (v2**2 - v1**2)


def found(
    vehicle: Vehicle, plant: MultibodyPlant, figures: PlantFigures | None = None
) -> tuple[float, float, float]:
    """Effective compliance of front and rear axle, and K, by the linear formulas, rad/(m/s²)."""
    figures = usual_figures(vehicle, figures)
    vertical = float(plant.tires.stiffness[0])
    axles = linear(vehicle, figures, plant.tires.model, plant.chassis, plant.suspension, vertical)
    hub = vehicle.geometry.cg_height + float(plant.chassis.places[2, 1])
    now = compliance(vehicle, axles, figures.steering.caster, hub)
    k = float(plant.steering.stiffness)
    return now.slip_front + now.steering_moment / k, now.slip_rear, now.understeer(k)


@pytest.mark.parametrize("name", sorted(presets()))
def test_the_plant_understeers_as_its_file_says(name: str) -> None:
    vehicle = load_vehicle(name)
    plant = multibody_plant(vehicle)
    assert gradient(vehicle, plant) == pytest.approx(vehicle.understeer_gradient, rel=0.05)


@pytest.mark.parametrize("name", sorted(presets()))
def test_each_axle_is_as_soft_as_its_file_says(name: str) -> None:
    vehicle = load_vehicle(name)
    front, rear, understeer = found(vehicle, multibody_plant(vehicle))
    assert front == pytest.approx(1 / (GRAVITY * vehicle.tires.cornering_stiffness_front), rel=1e-4)
    assert rear == pytest.approx(1 / (GRAVITY * vehicle.tires.cornering_stiffness_rear), rel=1e-4)
    assert understeer == pytest.approx(vehicle.understeer_gradient, rel=1e-3)


@pytest.mark.parametrize("name", sorted(presets()))
def test_the_plant_pitches_as_its_file_says(name: str) -> None:
    """Nose up per forward specific force: the mean of pushing and braking, whose links differ a little."""
    vehicle = load_vehicle(name)
    plant, t = multibody_plant(vehicle), samples(3.0)
    first, gradients = start(plant, Plane(), 15.0), []
    for pedal, much in (("throttle", 0.8), ("brake", 0.3)):
        pressed = {pedal: much * np.clip(t, 0.0, 1.0)}
        _, truth = drive(plant, Plane(), first, Controls.make(gear=4.0, **pressed))
        force = np.asarray(truth.force_body)[:, :, 0].sum(axis=1) / vehicle.mass
        pitch = -np.asarray(truth.attitude)[:, 1]
        assert abs(force[-80:].mean()) > 0.4
        gradients.append((pitch[-80:].mean() - pitch[0]) / (force[-80:].mean() - force[0]))
    assert np.mean(gradients) == pytest.approx(vehicle.body.pitch_gradient, rel=0.1)
    assert gradients[1] == pytest.approx(gradients[0], rel=0.3)


@pytest.mark.parametrize("name", sorted(presets()))
def test_the_plant_rolls_as_its_file_says(name: str) -> None:
    """Against the road, in a steady bend: on springs and tires, less what the links take."""
    vehicle = load_vehicle(name)
    plant, t = multibody_plant(vehicle), samples(6.0)
    turned = np.minimum(t, 1.0) * 0.01 * float(plant.steering.ratio)
    controls = Controls.make(steering_wheel=turned, gear=np.zeros(t.shape))
    _, truth = drive(plant, Plane(), start(plant, Plane(), 20.0), controls)
    force = np.asarray(truth.force_body)[-50:, :, 1].sum(axis=1).mean() / vehicle.mass
    roll = np.asarray(truth.attitude)[-50:, 2].mean()
    assert force > 0.5
    assert roll / force == pytest.approx(vehicle.body.roll_gradient, rel=0.06)


def test_what_is_given_stays() -> None:
    """A steering stiffness of a plant file, a tire as measured: then the gradient is what comes of them."""
    vehicle = load_vehicle("suv")
    figures = PlantFigures(steering=SteeringFigures(stiffness=9000.0))
    soft = multibody_plant(vehicle, figures)
    assert float(soft.steering.stiffness) == 9000
    _, rear, understeer = found(vehicle, soft, figures)
    assert rear == pytest.approx(1 / (GRAVITY * vehicle.tires.cornering_stiffness_rear), rel=1e-4)
    assert understeer > 1.5 * vehicle.understeer_gradient
    measured = multibody_plant(vehicle, tir=PASSENGER)
    assert float(measured.tires.model.coefficients["LKY"]) == 1.0


def test_roll_is_what_the_camber_is_reckoned_with() -> None:
    """The camber of the wheels per lateral acceleration, on the road and by the formula."""
    for name in ("family-car", "truck"):
        vehicle = load_vehicle(name)
        plant = multibody_plant(vehicle)
        road, t = Plane(), samples(6.0)
        controls = Controls.make(
            steering_wheel=np.minimum(t, 1.0) * 0.01 * float(plant.steering.ratio), gear=np.zeros(t.shape)
        )
        _, truth = drive(plant, road, start(plant, road, 20.0), controls)
        accel = float((truth.velocity[-50:, 0] * truth.angular_rate[-50:, 2]).mean())
        camber = np.asarray(truth.camber)[-50:].mean(axis=0)
        axles = linear(
            vehicle, usual_figures(vehicle), plant.tires.model, plant.chassis, plant.suspension,
            float(plant.tires.stiffness[0]),
        )  # fmt: skip
        assert accel > 0.5
        assert camber[2:].mean() / accel == pytest.approx(axles.camber[1], rel=0.05)
        # the front wheels lean by the caster as they are steered, too
        leaned = -np.sin(usual_figures(vehicle).steering.caster) * float(truth.steer[-1, :2].mean())
        assert (camber[:2].mean() - leaned) / accel == pytest.approx(axles.camber[0], rel=0.07)
