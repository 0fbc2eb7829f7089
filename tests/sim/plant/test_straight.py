"""Straight ahead: coasting, braking, driving, and what the brakes' and the drive's controls do."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from tests.sim.plant.conftest import Plane, drive, samples

from roadstate.sim.plant import AUTOMATIC, Controls, multibody_plant
from roadstate.sim.plant.multibody import MultibodyPlant
from roadstate.sim.plant.rollout import start
from roadstate.vehicles import load_vehicle


def test_coast_down(car: MultibodyPlant) -> None:
    """(m + ΣI/R²) v̇ = −½ρc_dAv² − ΣM_y/R, in neutral."""
    vehicle, road, t = load_vehicle("family-car"), Plane(), samples(10.0)
    _, truth = drive(car, road, start(car, road, 30.0), Controls.make(gear=np.zeros(t.shape)))
    v = np.asarray(truth.planar_velocity)[200:, 0]
    accel = np.gradient(v, 0.01)
    R = vehicle.wheels.radius
    loads = np.asarray(truth.load)[200:]
    moments = -np.asarray(car.tires.model.moments(0.0, 0.0, loads, 0.9, v[:, None]).M_y).sum(axis=1)
    turning = 4 * vehicle.wheels.inertia + float(car.driveline.shaft_inertia)
    force = 0.5 * 1.205 * vehicle.drag_area * v**2 + moments / R
    expected = -force / (vehicle.mass + turning / R**2)
    np.testing.assert_allclose(accel[20:-20].mean(), expected[20:-20].mean(), rtol=0.01)
    # and rolling resistance is what the vehicle file says, at 15 m/s
    rolling = vehicle.rolling_resistance
    share = float(-np.sum(car.tires.model.moments(0.0, 0.0, loads[0], 0.9, 15.0).M_y)) / R / loads[0].sum()
    assert share == pytest.approx(rolling.coefficient + rolling.speed_coefficient * 15**2, rel=0.02)


def test_wind_is_resisted_by_what_flows_past_the_car(car: MultibodyPlant) -> None:
    """−½ρ c_dA |u| u for u = v − w, whichever way the car faces; a car that goes with the wind feels none."""
    area, half = float(car.aerodynamics.area[0]), 0.5 * 1.205
    windy = eqx.tree_at(lambda p: p.aerodynamics.wind, car, jnp.asarray([6.0, -8.0, 0.0]))
    level = jnp.eye(3)
    force, _ = windy.aerodynamics.force(jnp.asarray([30.0, 0.0, 0.0]), level)
    through = np.hypot(24.0, 8.0)
    np.testing.assert_allclose(force[:2], half * area * through * np.array([-24.0, -8.0]))
    still = windy.aerodynamics.force(jnp.asarray([6.0, -8.0, 0.0]), level)
    np.testing.assert_allclose(np.concatenate(still), 0.0, atol=1e-6)
    # turned by a right angle to the left, the car has the world's y ahead
    R = jnp.asarray([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    force, _ = windy.aerodynamics.force(jnp.asarray([30.0, 0.0, 0.0]), R)
    through = np.hypot(38.0, 6.0)
    np.testing.assert_allclose(force[:2], half * area * through * np.array([-38.0, -6.0]))
    built = multibody_plant(load_vehicle("family-car"), wind=(6.0, -8.0))
    np.testing.assert_allclose(built.aerodynamics.wind, [6.0, -8.0, 0.0])


def test_braking_in_a_straight_line(car: MultibodyPlant) -> None:
    """Torques over radii make the deceleration, the deceleration the load transfer m a h / L."""
    vehicle, road, t = load_vehicle("family-car"), Plane(), samples(2.0)
    pressure = np.full((len(t), 4), 3e6)
    controls = Controls.make(gear=0.0, brake_pressure=pressure)
    _, truth = drive(car, road, start(car, road, 30.0), controls)
    part = slice(120, 190)
    v = np.asarray(truth.planar_velocity)[part, 0]
    brakes, g, R = vehicle.brakes, vehicle.geometry, vehicle.wheels.radius
    assert brakes is not None
    torque = 2 * 3e6 * (brakes.torque_per_pressure_front + brakes.torque_per_pressure_rear)
    np.testing.assert_allclose(-np.asarray(truth.brake_torque)[150].sum(), torque, rtol=1e-6)
    turning = 4 * vehicle.wheels.inertia + float(car.driveline.shaft_inertia)
    rolling = vehicle.rolling_resistance.coefficient * vehicle.mass * 9.81
    force = torque / R + 0.5 * 1.205 * vehicle.drag_area * v**2 + rolling
    accel = np.gradient(v, 0.01)  # the body's accelerometer sees gravity as it pitches
    np.testing.assert_allclose(accel.mean(), -(force / (vehicle.mass + turning / R**2)).mean(), rtol=0.015)
    load = np.asarray(truth.load)[part].mean(axis=0)
    lift = 0.5 * 1.205 * vehicle.aerodynamics.frontal_area * np.mean(v**2) * 0.05
    expected = (
        vehicle.static_axle_loads[0] - vehicle.mass * accel.mean() * g.cg_height / vehicle.wheelbase - lift
    )
    assert load[0] + load[1] == pytest.approx(expected, rel=0.01)
    assert load[0] == pytest.approx(load[1], rel=1e-9)


def stop_from(plant: MultibodyPlant, friction: float, speed: float = 20.0) -> dict[str, np.ndarray]:
    road, t = Plane(0.0, 0.0, friction, friction), samples(12.0)
    _, truth = drive(plant, road, start(plant, road, speed), Controls.make(brake=np.ones(t.shape)))
    return {name: np.asarray(values) for name, values in truth._asdict().items()}


def test_anti_lock_keeps_the_wheels_turning() -> None:
    vehicle = load_vehicle("family-car")
    locked = stop_from(multibody_plant(vehicle), 0.4)
    held = stop_from(multibody_plant(vehicle, anti_lock=True), 0.4)
    moving = (locked["planar_velocity"][:, 0] > 3) & (np.arange(1200) > 60)
    assert np.abs(locked["slip"][moving] + 1).max() < 0.02
    np.testing.assert_allclose(locked["wheel_speed"][moving], 0, atol=1e-3)
    braking = (held["planar_velocity"][:, 0] > 3) & (np.arange(1200) > 100)
    assert np.median(held["slip"][braking]) > -0.25
    assert held["position"][-1, 0] < locked["position"][-1, 0]
    # the peak is what the road has, and sliding gives less
    use = np.hypot(held["force_x"], held["force_y"]) / held["load"]
    assert 0.35 < np.quantile(use[braking], 0.9) < 0.46
    # both have come to rest, and stay
    for run in (locked, held):
        assert np.abs(run["velocity"][-1]).max() < 0.01


def test_traction_control_limits_wheel_spin() -> None:
    vehicle, road, t = load_vehicle("in-wheel-ev"), Plane(0.0, 0.0, 0.2, 0.2), samples(4.0)
    full = Controls.make(throttle=np.ones(t.shape))
    speeds, slips = [], []
    for on in (False, True):
        plant = multibody_plant(vehicle, traction_control=on)
        _, truth = drive(plant, road, start(plant, road, 3.0), full)
        speeds.append(float(truth.planar_velocity[-1, 0]))
        slips.append(float(np.median(np.asarray(truth.slip)[200:])))
    assert slips[0] > 1
    assert slips[1] < 0.25
    assert speeds[1] > speeds[0]


def test_motors_that_turn_backward_are_told_as_a_reverse_gear() -> None:
    vehicle, road, t = load_vehicle("in-wheel-ev"), Plane(), samples(2.0)
    plant = multibody_plant(vehicle)
    backward = Controls.make(throttle=np.full(t.shape, 0.2), gear=np.full(t.shape, -1.0))
    _, truth = drive(plant, road, start(plant, road, 0.0), backward)
    assert float(truth.planar_velocity[-1, 0]) < -0.5
    assert float(truth.gear_ratio[-1]) == -1.0


@pytest.mark.parametrize("name", ["compact-car", "suv", "truck"])
def test_drives_off_and_shifts(name: str) -> None:
    vehicle = load_vehicle(name)
    plant, road, t = multibody_plant(vehicle), Plane(), samples(12.0)
    _, truth = drive(plant, road, start(plant, road, 0.0), Controls.make(throttle=np.full(t.shape, 0.8)))
    speed, gear = np.asarray(truth.planar_velocity)[:, 0], np.asarray(truth.gear)
    assert speed[-1] > 9
    assert gear[0] == 1
    assert gear[-1] >= 2
    engine = np.asarray(truth.engine_speed)
    assert engine.min() > 0.5 * 80
    assert engine.max() < float(plant.driveline.largest_speed) * 1.05
    # the torque is interrupted while it shifts
    shifting = np.flatnonzero(np.diff(gear))[0]
    assert np.asarray(truth.drive_torque)[shifting].sum() < 0.2 * np.asarray(truth.drive_torque)[100].sum()
    ratio = np.asarray(truth.gear_ratio)
    driven = {"front": [0, 1], "rear": [2, 3], "all": [0, 1, 2, 3]}[vehicle.driveline.driven]
    wheels = np.asarray(truth.wheel_speed)[:, driven].mean(axis=1)
    closed = (ratio > 0) & (engine > 1.7 * 80) & (speed > 3)
    assert closed.sum() > 300
    off = np.abs(engine / np.where(closed, ratio, 1) / np.maximum(wheels, 1) - 1)[closed]
    assert np.quantile(off, 0.95) < 0.02  # but for the clutch's last slip


def test_reverse_and_neutral(car: MultibodyPlant) -> None:
    road, t = Plane(), samples(5.0)
    for gear, low, high in ((-1.0, -20.0, -1.0), (0.0, -0.01, 0.01)):
        controls = Controls.make(throttle=np.full(t.shape, 0.5), gear=gear)
        _, truth = drive(car, road, start(car, road, 0.0), controls)
        assert low < float(truth.velocity[-1, 0]) < high


def test_a_limited_slip_differential_pulls_on_a_split_road() -> None:
    from roadstate.sim.plant import PlantFigures
    from roadstate.sim.plant.figures import Powertrain

    vehicle, road, t = load_vehicle("truck"), Plane(0.0, 0.0, 0.05, 0.8), samples(6.0)
    controls = Controls.make(throttle=np.full(t.shape, 0.5), gear=1.0)
    reached = []
    for limited in (0.0, 300.0):
        figures = PlantFigures(powertrain=Powertrain(limited_slip=limited, limited_slip_torque=4000.0))
        plant = multibody_plant(vehicle, figures)
        _, truth = drive(plant, road, start(plant, road, 0.0, 0.0, 0.0), controls)
        reached.append(float(truth.planar_velocity[-1, 0]))
    assert reached[1] > reached[0] + 0.5
    assert AUTOMATIC == 100


@pytest.mark.parametrize("name", ["family-car", "suv", "truck"])
def test_shifts_are_not_felt_as_blows(name: str) -> None:
    """Shifting down while braking gently and up under power: no more than a little beyond what was there."""
    vehicle = load_vehicle(name)
    plant, road, t = multibody_plant(vehicle), Plane(), samples(14.0)
    braking = Controls.make(throttle=np.zeros(t.shape), brake=np.where(t > 1, 0.05, 0.0))
    driving = Controls.make(throttle=np.full(t.shape, 0.9))
    for controls, speed, up in ((braking, 16.0, False), (driving, 0.5, True)):
        _, truth = drive(plant, road, start(plant, road, speed), controls)
        accel, gear = np.asarray(truth.specific_force)[:, 0], np.asarray(truth.gear)
        shifts = [i for i in np.flatnonzero(np.diff(gear)) if 100 < i < 1280]
        assert shifts
        for i in shifts:
            assert (gear[i + 1] > gear[i]) == up
            felt, before = accel[i - 60 : i + 120], accel[i - 60 : i - 30].mean()
            if up:
                # the torque is interrupted, but neither is the car braked nor the engine let go
                assert felt.min() > -0.5
                assert felt.max() < 1.45 * before + 0.2
            else:
                assert np.abs(felt - before).max() < 0.75
            jerk = np.abs(np.diff(felt)) / 0.01
            assert jerk.max() < (90 if up else 20)
        if up:
            engine = np.asarray(truth.engine_speed)
            assert engine.max() < 1.15 * max(engine[i - 30] for i in shifts)


def test_the_engine_comes_up_to_the_speed_of_a_lower_gear(car: MultibodyPlant) -> None:
    """Within the shift, by its own torque: the clutch has next to nothing left to do."""
    road, t = Plane(), samples(4.0)
    controls = Controls.make(throttle=0.1, gear=np.where(t < 2, 3.0, 2.0))
    _, truth = drive(car, road, start(car, road, 11.0), controls)
    engine, torque = np.asarray(truth.engine_speed), np.asarray(truth.engine_torque)
    line = car.driveline
    shift = 200 + round(float(line.shift_time) / 0.01)
    fitting = float(line.ratios[3]) * np.asarray(truth.wheel_speed)[shift, :2].mean()
    assert fitting > 1.3 * engine[199]
    assert engine[shift] == pytest.approx(fitting, rel=0.02)
    assert torque[200:shift].max() > 0.5 * float(line.peak_torque)
    assert np.abs(np.asarray(truth.drive_torque)[200:shift].sum(axis=1)).max() < 150
