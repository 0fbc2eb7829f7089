"""TFOBE on drives whose forces and grade are known, and its lower layer against the vehicle model."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import WHEELS, Log
from roadstate.core.constants import GRAVITY
from roadstate.estimators import build
from roadstate.estimators.force_observer import ForceObserver
from roadstate.estimators.kmbe import KMBE
from roadstate.estimators.tfobe import TFOBE
from roadstate.estimators.tire_forces import SPIN, ForceInput
from roadstate.papers.tfobe_printed import PrintedSlope, PrintedTFOBE
from roadstate.run import scan
from roadstate.vehicles import SevenDofForces, Vehicle

Array = NDArray[np.float64]
RATE = 100.0
DRIVEN = ("fl", "fr")


def made(
    vehicle: Vehicle,
    speed: Array,
    grade: Array,
    *,
    yaw_rate: float = 0.0,
    bias: float = 0.0,
    gain: float = 1.0,
    noise: float = 0.0,
    seed: int = 0,
) -> Log:
    """A car on a slope, or on a circle where it is level, whose wheels slip as the vehicle file says.

    Args:
        vehicle: front driven.
        speed: (T,) m/s; grade: (T,) rad.
        yaw_rate: rad/s.
        bias: of ``accel_x``, m/s²; gain: torques read over what they are.
        noise: share of the vehicle file's noise that is put on every sensor.
        seed: of that.
    """
    T, R = len(speed), vehicle.wheels.radius
    slope = np.gradient(speed, 1 / RATE)
    drag = 0.5 * vehicle.aerodynamics.air_density * vehicle.drag_area * speed**2
    specific = slope + GRAVITY * np.sin(grade)
    rolling = vehicle.rolling_resistance
    f = rolling.coefficient + rolling.speed_coefficient * speed**2
    roll = f * vehicle.mass * GRAVITY * np.cos(grade)
    spin = 4 * vehicle.wheels.inertia * slope / R**2
    wheel_force = vehicle.mass * specific + drag + roll + spin
    front, rear = vehicle.static_axle_loads
    pitch, lean = (1 + GRAVITY * g for g in (vehicle.body.pitch_gradient, vehicle.body.roll_gradient))
    values = {
        "accel_x": pitch * specific + bias,
        "accel_y": lean * speed * yaw_rate,
        "yaw_rate": np.full(T, yaw_rate),
        "steer": np.zeros(T),
        "brake": (wheel_force < 0).astype(float),
        "kinematic_accel_x": slope,
        "kinematic_accel_y": speed * yaw_rate,
    }
    sensors, random = vehicle.sensors, np.random.default_rng(seed)
    for i, w in enumerate(WHEELS):
        track = vehicle.geometry.track_front if i < 2 else vehicle.geometry.track_rear
        rolling = (speed + (1 if i % 2 else -1) * yaw_rate * track / 2) / R
        drive = np.maximum(wheel_force, 0) / 2 * R if w in DRIVEN else np.zeros(T)
        brake = np.maximum(-wheel_force, 0) / 4 * R
        values[f"drive_torque_{w}"], values[f"brake_torque_{w}"] = gain * drive, gain * brake
        shift = vehicle.mass * vehicle.geometry.cg_height / (2 * vehicle.wheelbase) * specific
        load = front / 2 - shift if i < 2 else rear / 2 + shift
        force = (drive - brake) / R - f * load - spin / 4
        values[f"ref_force_x_{w}"] = force
        values[f"wheel_speed_{w}"] = rolling * (1 + force / (vehicle.tires.slip_stiffness * load))
    noises = {"accel": sensors.accel.noise_density * 10, "yaw": sensors.yaw_rate.noise}
    noises |= {"wheel": sensors.wheel_speed.noise, "drive": 5.0}
    for name, column in values.items():
        std = noises.get(name.split("_")[0], 0.0)
        values[name] = column + noise * std * random.normal(size=T)
    return Log(np.arange(T) / RATE, {**values, "ref_grade": grade, "ref_velocity_x": speed})


def weaving(seconds: float, depth: float = 0.8) -> Array:
    """Speeds up and slows down about 12 m/s."""
    t = np.arange(int(seconds * RATE)) / RATE
    return 12 + depth * 2 * np.sin(0.4 * t)


def constant(T: int, percent: float) -> Array:
    return np.full(T, np.arctan(percent / 100))


def run(vehicle: Vehicle, log: Log) -> tuple[TFOBE, object]:
    estimator = build("tfobe", vehicle, [c for c in log.channels if not c.startswith("ref_")])
    assert isinstance(estimator, TFOBE)
    return estimator, scan(estimator, log)


class TestLowerLayer:
    """The linear model of forces against the vehicle model that it stands for."""

    @pytest.fixture
    def observer(self, vehicle: Vehicle) -> ForceObserver:
        return ForceObserver(vehicle, {f"drive_torque_{w}" for w in DRIVEN})

    @pytest.mark.parametrize("steer", [-0.3, 0.0, 0.08])
    def test_specific_force_and_yaw_are_those_of_the_vehicle_model(
        self, observer: ForceObserver, vehicle: Vehicle, steer: float
    ) -> None:
        random = np.random.default_rng(1)
        along, axles = random.normal(size=4) * 1000, random.normal(size=2) * 1000
        car = SevenDofForces.from_vehicle(vehicle)
        given = jnp.asarray(np.concatenate([[steer, 0], np.zeros(8), along, np.repeat(axles / 2, 2)]))
        motion = car.motion(jnp.asarray([0.0, 0, 0, 0, 0, 0, 0]), given)
        got = observer.model.gain(jnp.asarray(steer)) @ jnp.concatenate([along, axles])
        expected = [motion.accel_x, motion.accel_y, motion.yaw_accel]
        np.testing.assert_allclose(got, np.array([float(e) for e in expected]), rtol=1e-10, atol=1e-10)

    @pytest.mark.parametrize("engine", [0.0, 20.0])
    def test_wheels_spin_up_with_the_engine_they_share(self, observer: ForceObserver, engine: float) -> None:
        """I_w ω̇_i + E d_i Σ d_j ω̇_j = T_i, solved as a matrix."""
        model, own = observer.model, np.asarray(observer.model.vehicle.wheel_inertia)
        share, torque = np.array([0.5, 0.5, 0.0, 0.0]), np.array([300.0, 100.0, -20.0, 40.0])
        zero, four = jnp.zeros(()), jnp.zeros(4)
        u = ForceInput(
            gain=jnp.zeros((3, 6)),
            drag=zero,
            torque=jnp.asarray(torque),
            drive_torque=four,
            brake_torque=four,
            accel_x=zero,
            rolling=four,
            engine=jnp.asarray(engine * share),
            torque_noise=four,
            force_noise=four,
            jerk=zero,
            sensor_std=jnp.ones(7),
        )
        spun = np.asarray(model.f(jnp.zeros(len(model.states)), u, jnp.asarray(0.01)))[SPIN] / 0.01
        matrix = np.diag(own) + engine * np.outer(share, share)
        np.testing.assert_allclose(spun, np.linalg.solve(matrix, torque), rtol=1e-9)


class TestGrade:
    @pytest.mark.parametrize("percent", [-6.0, 0.0, 4.0])
    def test_a_constant_slope(self, vehicle: Vehicle, percent: float) -> None:
        speed = weaving(40)
        log = made(vehicle, speed, constant(len(speed), percent))
        _, e = run(vehicle, log)
        error = 100 * (np.tan(e.values["grade"]) - np.tan(log["ref_grade"]))[1000:]
        assert np.abs(error).max() < 0.25
        assert np.abs(error).mean() < 0.12

    def test_an_accelerometers_bias_is_found_out_by_the_torques(self, vehicle: Vehicle) -> None:
        """0.2 m/s² is 2 % of grade for who trusts the accelerometer."""
        speed = weaving(60)
        log = made(vehicle, speed, constant(len(speed), 3.0), bias=0.2)
        late = slice(3000, None)
        _, e = run(vehicle, log)
        trusting = scan(KMBE.build(vehicle, ["accel_x", *(f"wheel_speed_{w}" for w in WHEELS)]), log)
        error = 100 * np.abs(np.tan(e.values["grade"]) - 0.03)[late].mean()
        assert error < 0.3
        assert 100 * np.abs(np.tan(trusting.values["grade"]) - 0.03)[late].mean() > 1.5

    def test_a_mass_that_is_wrong_is_found_out_by_the_accelerometer(self, vehicle: Vehicle) -> None:
        """Torques that push a lighter car than thought: DEBE takes 10 % of its force for a slope."""
        speed = weaving(90, depth=2.0)
        log = made(vehicle, speed, constant(len(speed), 5.0), gain=1.1)
        available = [c for c in log.channels if not c.startswith("ref_")]
        late = slice(6000, None)
        errors = {}
        for name in ("tfobe", "debe"):
            e = scan(build(name, vehicle, available), log)
            errors[name] = 100 * abs((np.tan(e.values["grade"]) - 0.05)[late].mean())
        assert errors["debe"] > 0.4
        assert errors["tfobe"] < 0.5 * errors["debe"]

    def test_intervals_are_honest(self, vehicle: Vehicle) -> None:
        """Bias, gain and noise drawn as the vehicle file says: the 95 % interval holds 9 of 10 or more."""
        inside, squares = [], []
        speed = weaving(30)
        s = np.cumsum(speed) / RATE
        grade = 0.04 * np.sin(s / 150)
        for seed in range(16):
            random = np.random.default_rng([seed, 7])
            log = made(
                vehicle,
                speed,
                grade,
                bias=vehicle.sensors.accel.bias * random.normal(),
                gain=1 + 0.05 * random.normal(),
                noise=0.7,
                seed=seed,
            )
            _, e = run(vehicle, log)
            z = ((e.values["grade"] - grade) / e.std["grade"])[500:]
            inside.append(np.mean(np.abs(z) < 1.96))
            squares.append(np.mean(z**2))
        assert np.mean(inside) > 0.9
        assert 0.1 < np.mean(squares) < 1.5


class TestForces:
    def test_longitudinal_forces_are_those_of_the_wheels(self, vehicle: Vehicle) -> None:
        speed = weaving(30)
        log = made(vehicle, speed, constant(len(speed), 4.0))
        _, e = run(vehicle, log)
        for w in WHEELS:
            error = e.values[f"force_x_{w}"] - log[f"ref_force_x_{w}"]
            assert np.abs(error[1000:]).max() < 60
        for axle, (a, b) in {"front": ("fl", "fr"), "rear": ("rl", "rr")}.items():
            total = e.values[f"force_x_{a}"] + e.values[f"force_x_{b}"]
            np.testing.assert_allclose(e.values[f"force_x_{axle}"], total, rtol=1e-9, atol=1e-6)

    def test_lateral_forces_hold_the_car_on_its_circle(self, vehicle: Vehicle) -> None:
        speed = np.full(2000, 15.0)
        log = made(vehicle, speed, np.zeros(2000), yaw_rate=0.2)
        _, e = run(vehicle, log)
        whole = vehicle.mass * 15.0 * 0.2
        share = vehicle.geometry.cg_to_rear_axle / vehicle.wheelbase
        late = slice(1000, None)
        assert e.values["force_y_front"][late].mean() == pytest.approx(share * whole, rel=0.02)
        assert e.values["force_y_rear"][late].mean() == pytest.approx((1 - share) * whole, rel=0.02)
        # outer wheels carry more, and nothing but the load tells
        assert (e.values["force_y_fr"] > e.values["force_y_fl"])[late].all()
        assert (e.std["force_y_fl"] > 0.5 * e.std["force_y_front"])[late].all()

    def test_a_mass_not_known_is_in_the_forces_interval(self, vehicle: Vehicle) -> None:
        speed = np.full(1500, 15.0)
        log = made(vehicle, speed, constant(1500, 8.0))
        vague = vehicle.model_copy(update={"prior": vehicle.prior.model_copy(update={"mass_relative": 0.2})})
        narrow, wide = (run(v, log)[1].std["force_x_front"][-1] for v in (vehicle, vague))
        assert wide > narrow


class TestAsPrinted:
    def test_finds_a_slope_where_accelerations_lack_gravity(self, vehicle: Vehicle) -> None:
        speed = weaving(30)
        log = made(vehicle, speed, constant(len(speed), 3.0))
        available = [c for c in log.channels if not c.startswith("ref_")]
        e = scan(PrintedTFOBE.build(vehicle, available, below="accel_x"), log)
        assert 100 * np.tan(e.values["grade"])[1000:].mean() == pytest.approx(3.0, abs=0.3)

    def test_a_lower_layer_without_gravity_takes_half_of_the_slope_for_its_own(
        self, vehicle: Vehicle
    ) -> None:
        """Its accelerometer says that no force is there, its torques say that of the slope."""
        speed = np.full(3000, 12.0)
        log = made(vehicle, speed, constant(3000, 6.0))
        available = [c for c in log.channels if not c.startswith("ref_")]
        e = scan(PrintedTFOBE.build(vehicle, available), log)
        assert 100 * np.tan(e.values["grade"])[1000:].mean() < 5.9

    @pytest.mark.parametrize("method", ["kmbe", "debe"])
    def test_the_rivals_find_a_slope(self, vehicle: Vehicle, method: str) -> None:
        speed = np.full(3000, 12.0)
        log = made(vehicle, speed, constant(3000, 3.0))
        available = [c for c in log.channels if not c.startswith("ref_")]
        e = scan(PrintedSlope.build(vehicle, available, method=method), log)
        assert 100 * np.tan(e.values["grade"])[1500:].mean() == pytest.approx(3.0, abs=0.15)
