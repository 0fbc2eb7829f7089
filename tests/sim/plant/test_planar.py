"""The simpler plants through the same interface."""

from __future__ import annotations

import jax
import numpy as np
import pytest
from tests.sim.plant.conftest import Plane, circle, drive, samples

from roadstate.core import InputError
from roadstate.core.constants import GRAVITY
from roadstate.sim.plant import Controls
from roadstate.sim.plant.planar import PlanarPlant
from roadstate.sim.plant.rollout import start
from roadstate.tires import NormalizedDugoff
from roadstate.vehicles import load_vehicle

_CAR = load_vehicle("family-car")


def test_seven_dof_turns_as_the_single_track_formula_says() -> None:
    plant, road, t = PlanarPlant.seven_dof(_CAR), Plane(), samples(4.0)
    assert _CAR.steering is not None
    controls = Controls.make(steering_wheel=np.full(t.shape, 0.1), gear=0.0)
    _, truth = drive(plant, road, start(plant, road, 20.0), controls)
    v, r = truth.velocity[-1, 0], truth.angular_rate[-1, 2]
    steer = 0.1 / _CAR.steering.ratio
    assert r == pytest.approx(v * steer / (_CAR.wheelbase + _CAR.understeer_gradient * v**2), rel=0.01)


def test_seven_dof_with_the_papers_tire_is_linear_in_friction() -> None:
    plant = PlanarPlant.seven_dof(_CAR, NormalizedDugoff())
    t = samples(1.0)
    controls = Controls.make(steering_wheel=np.full(t.shape, 0.5))
    forces = []
    for friction in (0.4, 0.8):
        road = Plane(0.0, 0.0, friction, friction)
        _, truth = drive(plant, road, start(plant, road, 20.0), controls)
        forces.append(truth.force_y[0, :2])
        np.testing.assert_array_equal(truth.friction[1], friction)
    assert forces[0].min() > 500
    np.testing.assert_allclose(forces[1].sum(), 2 * forces[0].sum(), rtol=0.01)


def test_seven_dof_feels_a_slope() -> None:
    plant, road, t = PlanarPlant.seven_dof(_CAR), Plane(0.1, 0.04), samples(4.0)
    grade = np.arctan(0.1)
    rolling = Controls.make(gear=np.zeros(t.shape))
    _, truth = drive(plant, road, start(plant, road, 10.0), rolling)
    assert truth.grade[0] == pytest.approx(grade)
    kinematic = np.gradient(truth.velocity[:, 0], 0.01)[100]
    assert kinematic < -0.9
    # what slows it but gravity is what an accelerometer feels
    assert truth.specific_force[100, 0] - kinematic == pytest.approx(GRAVITY * np.sin(grade), abs=0.05)
    rise = truth.position[100, 2] - truth.position[0, 2]
    assert rise == pytest.approx(0.1 * truth.road[100, 0] + 0.04 * truth.road[100, 1], abs=0.02)


def test_three_dof_is_driven_by_slip() -> None:
    plant, road, t = PlanarPlant.three_dof(_CAR), Plane(), samples(2.0)
    slip = np.full((len(t), 4), -0.02)
    _, truth = drive(plant, road, start(plant, road, 20.0), Controls.make(wheel_slip=slip))
    weight = _CAR.mass * GRAVITY
    expected = -_CAR.tires.slip_stiffness * 0.02 / 0.98 * weight
    assert truth.force_x[50].sum() == pytest.approx(expected, rel=0.01)
    assert truth.velocity[-1, 0] < 12
    np.testing.assert_array_equal(truth.slip, slip)


def test_place_along_a_circle() -> None:
    plant, road, t = PlanarPlant.seven_dof(_CAR), circle(80.0), samples(8.0)
    controls = Controls.make(steering_wheel=np.full(t.shape, 0.5), throttle=0.1)
    _, truth = drive(plant, road, start(plant, road, 12.0, 5.0, -1.0), controls)
    s, d = truth.road.T
    np.testing.assert_allclose((80.0 - d) * np.sin(s / 80.0), truth.position[:, 0], atol=2e-3)
    np.testing.assert_allclose(80.0 - (80.0 - d) * np.cos(s / 80.0), truth.position[:, 1], atol=2e-3)
    assert s[-1] > 70


def test_no_steering_no_plant() -> None:
    with pytest.raises(InputError, match="steering"):
        PlanarPlant.seven_dof(_CAR.model_copy(update={"steering": None}))


def test_every_plant_tells_the_same_truth() -> None:
    """The same fields, the same shapes: what follows need not ask which plant it was."""
    from roadstate.sim.plant import multibody_plant

    road, shapes = Plane(), []
    for plant in (multibody_plant(_CAR), PlanarPlant.seven_dof(_CAR), PlanarPlant.three_dof(_CAR)):
        truth = jax.eval_shape(lambda p=plant: p.truth(road, p.init(road, 10.0), Controls.make()))
        shapes.append(jax.tree.map(lambda a: a.shape, truth))
    assert shapes[0] == shapes[1] == shapes[2]


def test_told_drive_torques_are_those_that_act() -> None:
    """In neutral the pedal does nothing, in reverse it pushes back; what is asked of a wheel comes on top."""
    plant, road = PlanarPlant.seven_dof(_CAR), Plane()
    state = start(plant, road, 10.0)
    torques = {}
    for gear in (1.0, 0.0, -1.0):
        controls = Controls.make(throttle=0.3, gear=gear, wheel_torque=np.array([0.0, 0.0, 5.0, 0.0]))
        torques[gear] = np.asarray(plant.truth(road, state, controls).drive_torque)
    whole = 0.3 * np.asarray(plant.largest_torque)
    assert whole.sum() > 500
    for gear, torque in torques.items():
        assert torque == pytest.approx(gear * whole + np.array([0.0, 0.0, 5.0, 0.0])), gear


def test_no_wheel_turns_no_brake_presses_in_the_plant_that_slips_drive() -> None:
    plant, road = PlanarPlant.three_dof(_CAR), Plane()
    truth = plant.truth(road, plant.init(road, 10.0), Controls.make(throttle=0.3, brake=0.2))
    for absent in (truth.wheel_speed, truth.drive_torque, truth.brake_torque, truth.brake_pressure):
        assert np.isnan(absent).all()
    assert np.isfinite(truth.force_x).all()
