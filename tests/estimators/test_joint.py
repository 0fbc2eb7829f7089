"""The joint estimator on the reference plant with production sensors, and its parts against closed forms."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.core import REFERENCES, WHEELS, Estimates, Log, Validity
from roadstate.core.constants import GRAVITY
from roadstate.core.gaussian import Gaussian
from roadstate.core.quantities import reference
from roadstate.estimators import build
from roadstate.estimators.contact_forces import ForceMeter
from roadstate.estimators.intake import SMOOTHING, SPIN, Signals
from roadstate.estimators.joint import Joint
from roadstate.estimators.tire_contact import TireContact
from roadstate.papers.base import MISMATCHED
from roadstate.papers.plants import told
from roadstate.run import batch, scan
from roadstate.sim.manoeuvres import KMH, manoeuvre
from roadstate.sim.plant import multibody_plant
from roadstate.sim.run import drive, truth_table
from roadstate.sim.sensors import measure, sensor_preset, to_log
from roadstate.vehicles import Vehicle

SEEDS = 4
SATELLITE = {"speed", "altitude", "vertical_speed", "latitude", "longitude"}


@pytest.fixture(scope="module")
def lane_change(vehicle: Vehicle) -> tuple[list[Log], list[Estimates]]:
    """At 85 km/h on 0.8, with figures in the vehicle file that are off by 5 to 10 %."""
    script = manoeuvre("double-lane-change").prepare(vehicle, speed=85 * KMH, friction=0.8)
    table = truth_table(drive(multibody_plant(vehicle), script, vehicle, rate=200.0))
    sensors = sensor_preset("automotive")
    logs = [to_log(measure(table, sensors, seed=s, metadata={})) for s in range(SEEDS)]
    channels = [c for c in logs[0].available if c not in SATELLITE]
    cars = [build("joint", told(vehicle, MISMATCHED, s), channels) for s in range(SEEDS)]
    return logs, batch(cars, logs)


def truth(log: Log, quantity: str) -> np.ndarray:
    assert quantity in REFERENCES
    value = reference(quantity, log.channels)
    assert value is not None
    return value


class TestLaneChange:
    def test_axle_forces(self, lane_change: tuple[list[Log], list[Estimates]]) -> None:
        for log, said in zip(*lane_change, strict=True):
            for axle in ("front", "rear"):
                true = truth(log, f"force_y_{axle}")
                error = said.values[f"force_y_{axle}"] - true
                assert np.sqrt(np.mean(error[100:] ** 2)) < 0.16 * np.abs(true).max()

    @pytest.mark.parametrize("name", ["force_x_front", "force_x_rear", "friction_used"])
    def test_intervals_are_neither_too_narrow_nor_too_wide(
        self, lane_change: tuple[list[Log], list[Estimates]], name: str
    ) -> None:
        z = np.concatenate(
            [(e.values[name] - truth(log, name)) / e.std[name] for log, e in zip(*lane_change, strict=True)]
        )
        assert 0.5 < np.sqrt(np.mean(z**2)) < 1.3

    def test_sideslip(self, lane_change: tuple[list[Log], list[Estimates]]) -> None:
        for log, said in zip(*lane_change, strict=True):
            true = truth(log, "velocity_y")
            error = (said.values["velocity_y"] - true)[100:]
            assert np.sqrt(np.mean(error**2)) < 0.12 * np.abs(true).max()

    def test_the_friction_lies_between_its_bounds(
        self, lane_change: tuple[list[Log], list[Estimates]]
    ) -> None:
        for log, said in zip(*lane_change, strict=True):
            true = truth(log, "friction_peak")
            inside = (said.values["friction_peak_lower"] <= true) & (
                true <= said.values["friction_peak_upper"]
            )
            assert inside[100:].mean() > 0.9

    def test_grade_of_a_level_road(self, lane_change: tuple[list[Log], list[Estimates]]) -> None:
        for log, said in zip(*lane_change, strict=True):
            error = said.values["grade"] - truth(log, "grade")
            assert np.abs(error[200:]).max() < 0.025
            assert (np.abs(error) < 3 * said.std["grade"])[200:].mean() > 0.95


def test_small_forces_are_told_by_torques_and_large_ones_by_the_accelerometer(
    vehicle: Vehicle, lane_change: tuple[list[Log], list[Estimates]]
) -> None:
    """100 N are told by the one and 250 N by the other; 4.0 and 4.4 kN under brakes; and without torque."""
    log = lane_change[0][0]
    estimator = build("joint", vehicle, [c for c in log.available if c not in SATELLITE])
    state, estimate = estimator.init(), eqx.filter_jit(estimator.estimate)

    def front(told: float, along: float, brake: float, age: float = 0.0) -> float:
        both, axle = jnp.asarray([1.0, 1.0, 0.0, 0.0]), jnp.asarray([2.0, 0.0])
        # as after a while: the low pass has followed
        forces = state.latest._replace(
            told=told * both,
            along=along * both,
            now=state.latest.now._replace(told=told * axle, along=along * axle),
            load=jnp.full(4, 3500.0),
            along_std=jnp.zeros(4),
            brake=jnp.asarray(brake),
            intensity=jnp.asarray(0.02),
            age=jnp.asarray(age),
        )
        values = estimate(state._replace(latest=forces)).values
        return float(values["force_x_front"])

    gentle = front(50.0, 125.0, 0.0)
    assert 90 < gentle < 160
    assert front(-2000.0, -2200.0, 8.0) < -4150  # brakes' gains err by a tenth and more
    assert front(50.0, 125.0, 0.0, age=9.0) == pytest.approx(250, abs=2)  # silent, or caught lying


def test_the_first_sample_of_a_car_on_the_move_is_not_that_of_one_held_by_brakes(vehicle: Vehicle) -> None:
    """An accelerometer that reads .4 m/s² too low at 72 km/h: torques tell the force at once."""
    torques = [f"{kind}_torque_{w}" for kind in ("drive", "brake") for w in WHEELS]
    driven = {f"drive_torque_{w}": 100.0 for w in WHEELS[:2]}
    wheels = {f"wheel_speed_{w}": 20.0 / vehicle.wheels.radius for w in WHEELS}
    channels = dict.fromkeys(torques, 0.0) | driven | wheels | {"accel_x": -0.4, "yaw_rate": 0.0}
    estimator = build("joint", vehicle, list(channels))
    sample = {c: jnp.asarray(channels[c]) for c in estimator.channels}
    state, _ = eqx.filter_jit(estimator.step)(estimator.init(), sample, jnp.zeros(()))
    said = eqx.filter_jit(estimator.estimate)(state)
    rolls = vehicle.rolling_resistance.coefficient * GRAVITY * vehicle.mass / 2
    assert float(said.values["force_x_front"]) == pytest.approx(
        200.0 / vehicle.wheels.radius - rolls, rel=0.25
    )
    assert float(said.std["force_x_front"]) < 80


def test_a_stuck_accelerometer_is_noticed(
    vehicle: Vehicle, lane_change: tuple[list[Log], list[Estimates]]
) -> None:
    log = lane_change[0][0]
    channels = {n: v.copy() for n, v in log.channels.items()}
    channels["accel_y"][300:] = channels["accel_y"][300]
    estimator = build("joint", vehicle, [c for c in log.available if c not in SATELLITE])
    said = scan(estimator, Log(log.time, channels, log.metadata))
    assert (said.validity[300:600] == Validity.SENSOR_FAULT).any()
    assert all(np.isfinite(v).all() for v in said.values.values())


@pytest.mark.parametrize("bigger", [0.0, 0.01])
def test_wheels_under_drive_slip_as_much_as_they_do(vehicle: Vehicle, bigger: float) -> None:
    """A low pass lags by its time constant; wheels and car are compared at the same instant.

    Wheels that are bigger than the file says slip by that much more than their speeds tell.
    """
    contact, meter = TireContact(vehicle), ForceMeter(vehicle, ())
    accel, radius = 3.0, vehicle.wheels.radius
    time = np.arange(0, 3, 0.01)
    speed = 10 + accel * time
    # 2 % of slip, read when a wheel's speed comes
    spin = 1.02 * (speed - 0.01 * accel) / radius
    smooth = spin - 1.02 * SMOOTHING * accel / radius
    zero = jnp.zeros(8)
    seen = Signals(
        value=zero.at[SPIN].set(spin[-1]),
        age=zero,
        is_fresh=jnp.ones(8, bool),
        smooth=zero.at[SPIN].set(smooth[-1]),
        rate=zero.at[SPIN].set(1.02 * accel / radius),
        lag=zero + SMOOTHING - 0.005,
        noise=zero,
        now=zero,
        now_rate=zero,
        shaken=jnp.zeros(2),
        is_faulty=jnp.zeros(8, bool),
    )
    forces = meter.nothing()
    _, touch = contact.touch(
        contact.init(), seen, forces, jnp.asarray(speed[-1]), (jnp.asarray(bigger), jnp.asarray(0.01)),
        jnp.asarray(accel), jnp.zeros(()), jnp.asarray([0.0, jnp.inf]), jnp.zeros((), bool),
        jnp.asarray(0.01),
    )  # fmt: skip
    np.testing.assert_allclose(np.asarray(touch.slip), 1.02 * (1 + bigger) - 1, atol=3e-4)


def test_a_mass_is_read_out_as_the_model_has_it(vehicle: Vehicle) -> None:
    """Torques explain 1 − δ of what they would move a car of the file's mass by: m = m₀/(1 − δ)."""
    torques = [f"{kind}_torque_{w}" for kind in ("drive", "brake") for w in WHEELS]
    joint = build("joint", vehicle, ["accel_x", *(f"wheel_speed_{w}" for w in WHEELS), *torques])
    assert isinstance(joint, Joint)
    state, place = joint.init(), joint.along.place("mass")
    usual = joint.estimate(state)
    before = state.along.gaussian
    along = state.along._replace(gaussian=Gaussian(before.mean.at[place].set(0.2), before.factor))
    heavy = joint.estimate(state._replace(along=along))
    assert float(heavy.values["mass"]) == pytest.approx(vehicle.mass / 0.8)
    assert float(heavy.std["mass"]) == pytest.approx(float(usual.std["mass"]) / 0.8**2)
