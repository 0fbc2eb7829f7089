"""Turning: the linear single-track model at small lateral accelerations, load transfer, curvilinear place."""

from __future__ import annotations

import numpy as np
import pytest
from tests.sim.plant.conftest import Plane, circle, drive, samples

from roadstate.sim.plant import Controls, PlantFigures, multibody_plant
from roadstate.sim.plant.figures import Suspension
from roadstate.sim.plant.multibody import MultibodyPlant
from roadstate.sim.plant.rollout import start
from roadstate.tires.curves import linear_stiffness
from roadstate.vehicles import load_vehicle


def steady(plant: MultibodyPlant, speed: float, wheel: float) -> dict[str, np.ndarray]:
    """The end of 6 s with a held steering wheel and enough torque to keep the speed, nearly."""
    road, t = Plane(), samples(6.0)
    vehicle_drag = 0.5 * 1.205 * float(plant.aerodynamics.area[0]) * speed**2
    torque = (vehicle_drag + 0.012 * float(plant.chassis.mass) * 9.81) * 0.3 / 4
    controls = Controls.make(
        steering_wheel=np.minimum(t, 1.0) * wheel, gear=0.0, wheel_torque=np.full((len(t), 4), torque)
    )
    _, truth = drive(plant, road, start(plant, road, speed), controls)
    return {name: np.asarray(values)[-50:].mean(axis=0) for name, values in truth._asdict().items()}


@pytest.mark.parametrize("speed", [10.0, 20.0, 30.0])
def test_understeer_gradient(speed: float) -> None:
    """r = v δ/(L + K v²) with K from tire and steering stiffness and the trails, written out here.

    With a camber gain that keeps the wheels upright, since the linear formula knows no camber.
    """
    vehicle = load_vehicle("in-wheel-ev")
    upright = 2 / vehicle.geometry.track_front
    plant = multibody_plant(
        vehicle,
        PlantFigures(front=Suspension(camber_per_travel=upright), rear=Suspension(camber_per_travel=upright)),
    )
    loads = 0.5 * np.array(vehicle.static_axle_loads)
    tire, k = plant.tires.model, float(plant.steering.stiffness)
    _, C = linear_stiffness(tire, loads, 0.9, speed)
    small = [0.0, 1e-4, loads, 0.9, speed]
    trail = -np.asarray(tire.moments(*small).M_z) / np.asarray(tire.forces(*small).F_y)
    caster = float(-plant.chassis.steering_axis[0, 0] / plant.chassis.steering_axis[2, 0])
    C_f, C_r = 2 * float(C[0]), 2 * float(C[1])
    C_f = C_f / (1 + C_f * (trail[0] + caster * vehicle.wheels.radius) / k)
    g = vehicle.geometry
    behind, ahead = g.cg_to_rear_axle + trail[1], g.cg_to_front_axle - trail[0]
    K = vehicle.mass / vehicle.wheelbase * (behind / C_f - ahead / C_r)

    accel = 0.5  # m/s²
    steer = accel / speed**2 * (vehicle.wheelbase + K * speed**2)
    end = steady(plant, speed, steer * vehicle.steering.ratio)
    v, r = end["velocity"][0], end["angular_rate"][2]
    assert abs(v - speed) < 0.05 * speed
    assert r == pytest.approx(v * steer / (vehicle.wheelbase + K * v**2), rel=0.05)


def test_load_transfer(car: MultibodyPlant) -> None:
    """m a_y h = Σ track · load difference / 2, the body's roll included."""
    end = steady(car, 20.0, 0.6)
    vehicle = load_vehicle("family-car")
    accel = end["velocity"][0] * end["angular_rate"][2]  # without what gravity adds in a body that rolls
    assert 1.5 < accel < 5
    g = vehicle.geometry
    right_less_left = end["load"][1::2] - end["load"][::2]
    moment = 0.5 * (g.track_front * right_less_left[0] + g.track_rear * right_less_left[1])
    roll = end["attitude"][2]
    against_wheels = (end["travel"][1] - end["travel"][0]) / g.track_front
    assert roll == pytest.approx(vehicle.body.roll_gradient * accel, rel=0.1)
    assert against_wheels < roll < 1.4 * against_wheels  # the tires give, too
    # the centre of gravity moves outwards as the body rolls about an axis below it
    shift = vehicle.mass * 9.80665 * roll * (g.cg_height - 0.1)
    assert moment == pytest.approx(vehicle.mass * accel * g.cg_height + shift, rel=0.04)
    assert end["load"].sum() == pytest.approx(vehicle.mass * 9.80665, rel=0.01)


def test_place_along_a_circle(car: MultibodyPlant) -> None:
    """s and d as integrated agree with the place in the world after a long way."""
    road, t = circle(80.0), samples(12.0)
    controls = Controls.make(steering_wheel=np.full(t.shape, 0.55), throttle=0.2)
    _, truth = drive(car, road, start(car, road, 12.0, 5.0, -1.0), controls)
    s, d = np.asarray(truth.road).T
    x, y = np.asarray(truth.position)[:, :2].T
    assert s[-1] > 100
    assert np.ptp(d) > 1
    np.testing.assert_allclose((80.0 - d) * np.sin(s / 80.0), x, atol=2e-3)
    np.testing.assert_allclose(80.0 - (80.0 - d) * np.cos(s / 80.0), y, atol=2e-3)


def test_friction_is_each_wheels_own(car: MultibodyPlant) -> None:
    """Braking on a split road turns the car to the side that grips."""
    road, t = Plane(0.0, 0.0, 0.2, 0.8), samples(1.0)
    _, truth = drive(car, road, start(car, road, 20.0), Controls.make(brake=np.full(t.shape, 0.3)))
    np.testing.assert_array_equal(np.asarray(truth.friction)[50], [0.2, 0.8, 0.2, 0.8])
    used = np.abs(np.asarray(truth.force_x)[-1]) / np.asarray(truth.load)[-1]
    assert used[0] < 0.22
    assert used[1] > 0.3
    assert float(truth.angular_rate[50, 2]) < -0.01
