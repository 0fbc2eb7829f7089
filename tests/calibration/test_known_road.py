"""A road whose friction is told, and what figures of the tires owe to those that nobody asked for."""

from __future__ import annotations

import numpy as np
import pytest

from roadstate.calibration import Learned, calibrate, fit
from roadstate.calibration.known_road import on_road
from roadstate.calibration.likelihood import Likelihood
from roadstate.calibration.parameters import select
from roadstate.core import WHEELS, InputError, Log
from roadstate.core.constants import GRAVITY
from roadstate.estimators import build
from roadstate.run import scan
from roadstate.vehicles import Vehicle, load_vehicle

SPEED = 20.0  # m/s
STIFF = ("tires.cornering_stiffness_front", "tires.cornering_stiffness_rear")


@pytest.fixture(scope="module")
def bends(car: Vehicle) -> Log:
    """A linear single-track car at constant speed, steered in a sweep up to 1.4 Hz; little noise."""
    random, dt = np.random.default_rng(1), 0.05
    time = np.arange(0.0, 40.0, dt)
    steer = 0.03 * np.sin(2 * np.pi * (0.2 + 0.015 * time) * time)
    a, b, tires = car.geometry.cg_to_front_axle, car.geometry.cg_to_rear_axle, car.tires
    load = car.mass * GRAVITY / (a + b)
    front, rear = tires.cornering_stiffness_front * b * load, tires.cornering_stiffness_rear * a * load
    v = r = 0.0
    rows = []
    for delta in steer:
        for _ in range(10):
            F_f, F_r = front * (delta - (v + a * r) / SPEED), -rear * (v - b * r) / SPEED
            turn, across = (a * F_f - b * F_r) / car.yaw_inertia, (F_f + F_r) / car.mass
            v, r = v + dt / 10 * (across - SPEED * r), r + dt / 10 * turn
        rows.append((r, across))
    yaw_rate, accel_y = np.array(rows).T
    spin = np.full(len(time), SPEED / car.wheels.radius)
    noise = random.normal(size=(2, len(time)))
    return Log(
        time,
        {
            "accel_x": np.zeros(len(time)),
            "accel_y": accel_y + 0.02 * noise[0],
            "yaw_rate": yaw_rate + 0.001 * noise[1],
            "steering_wheel": steer * car.steering.ratio,
            **{f"wheel_speed_{w}": spin for w in WHEELS},
        },
    )


def pushes(friction: float, *, hardest: float) -> tuple[Vehicle, Log]:
    """A car with a motor in each wheel on a level road, whose four wheels slip alike, up to ``hardest``."""
    random, dt = np.random.default_rng(2), 0.02
    car = load_vehicle("in-wheel-ev")
    low = car.geometry.model_copy(update={"cg_height": 0.01})  # loads stay, and the body does not pitch
    body = car.body.model_copy(update={"pitch_gradient": 0.0})
    dry = car.tires.model_copy(update={"friction": 1.0})
    car = car.model_copy(update={"geometry": low, "body": body, "tires": dry})
    time = np.arange(0.0, 32.0, dt)
    slip = hardest * np.sin(2 * np.pi * 0.15 * time) * np.linspace(0.3, 1.0, len(time))
    tires, radius, wheel = car.tires, car.wheels.radius, car.wheels.inertia
    # friction makes the curve's height, not its slope at the origin
    rise = tires.slip_stiffness / (tires.shape * friction)
    share = friction * np.sin(tires.shape * np.arctan(rise * slip / (1 + slip)))
    v, drag = np.full(len(time), SPEED), 0.5 * car.aerodynamics.air_density * car.drag_area / car.mass
    accel = np.zeros(len(time))
    for k in range(len(time)):
        accel[k] = GRAVITY * share[k] - drag * v[k] ** 2
        v[min(k + 1, len(time) - 1)] = v[k] + accel[k] * dt
    spin = (1 + slip) * v / radius
    roll = car.rolling_resistance.coefficient + car.rolling_resistance.speed_coefficient * v**2
    ahead = 0.5 * car.geometry.cg_to_rear_axle / car.wheelbase
    load = car.mass * GRAVITY * np.array([ahead, ahead, 0.5 - ahead, 0.5 - ahead])
    torque = radius * load[:, None] * (share + roll) + wheel * np.gradient(spin, dt)
    noise = random.normal(size=(7, len(time)))
    zero = np.zeros(len(time))
    return car, Log(
        time,
        {
            "speed": v,
            "accel_x": accel + 0.2 * noise[0],
            "accel_y": 0.2 * noise[1],
            "yaw_rate": 0.01 * noise[6],
            "steering_wheel": zero,
            **{f"wheel_speed_{w}": spin + 0.1 * noise[2 + i] for i, w in enumerate(WHEELS)},
            **{f"drive_torque_{w}": own for w, own in zip(WHEELS, torque, strict=True)},
            **{f"brake_torque_{w}": zero for w in WHEELS},
        },
    )


def with_inertia(car: Vehicle, factor: float) -> Vehicle:
    return car.model_copy(update={"yaw_inertia": car.yaw_inertia * factor})


def test_no_other_friction_is_thought_of(car: Vehicle, bends: Log) -> None:
    estimator = on_road(build("joint", car, bends.available), 0.62)
    found = scan(estimator, bends.between(0.0, 10.0)).values
    for name in ("friction_peak", "friction_peak_lower", "friction_peak_upper", "friction_peak_front"):
        assert found[name] == pytest.approx(0.62)
    assert np.ptp(
        scan(build("joint", car, bends.available), bends.between(0.0, 10.0)).values["friction_peak"]
    )


def test_friction_of_dry_roads_counts_no_more(car: Vehicle, bends: Log) -> None:
    parameters = select(car, ["friction", "tire"], tune=False).parameters
    guessed, told = (
        Likelihood(car, parameters, {"bends": bends}, "joint", road).unused() for road in (None, 0.8)
    )
    assert guessed == {}
    assert told == {"tires.friction": "'joint' does not use it"}


@pytest.mark.parametrize("friction", [0.0, -0.8, 80.0, float("nan")])
def test_friction_that_makes_no_sense(car: Vehicle, bends: Log, friction: float) -> None:
    with pytest.raises(InputError, match=r"--road-friction: \S+ is no peak friction .* from 0\.05 to 1\.5"):
        calibrate(car, {"bends": bends}, ["tire"], road_friction=friction)


def test_estimator_without_hypotheses(car: Vehicle, level: Log) -> None:
    with pytest.raises(InputError, match=r"--road-friction: 'kmbe' weighs no hypotheses .*--estimator joint"):
        calibrate(car, {"level": level}, ["mass"], estimator="kmbe", road_friction=0.8)


@pytest.mark.usefixtures("optimised")
def test_tires_owe_their_uncertainty_to_the_yaw_inertia_as_well(
    car: Vehicle, bends: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    # by such a prior next to nothing is refused, and stiffnesses go where the log has them
    open_minded = car.model_copy(update={"prior": car.prior.model_copy(update={"stiffness_relative": 0.6})})

    def learned(told: Vehicle, beside: tuple[str, ...]) -> dict[str, Learned]:
        monkeypatch.setattr(fit, "_BESIDE", {"tires": beside})
        found = calibrate(told, {"bends": bends}, ["tire"], road_friction=1.0)
        return {one.parameter.name: one for one in found.learned if one.parameter.name in STIFF}

    whole, alone = learned(open_minded, ("inertia",)), learned(open_minded, ())
    heavy = learned(with_inertia(open_minded, np.exp(0.15)), ())
    assert whole.keys() == alone.keys() == heavy.keys() == set(STIFF)
    for name in STIFF:
        shift = np.log(heavy[name].value / alone[name].value)
        assert whole[name].value == alone[name].value
        added = np.sqrt(whole[name].relative ** 2 - alone[name].relative ** 2)
        assert added == pytest.approx(abs(shift), rel=0.4)


@pytest.mark.usefixtures("optimised")
def test_friction_is_learned_where_it_has_been_used_up() -> None:
    car, log = pushes(0.7, hardest=0.12)
    assert car.tires.friction == 1.0
    (found,) = calibrate(car, {"pushes": log}, ["friction"]).learned
    assert found.value == pytest.approx(0.7, abs=0.05)
    assert found.std < 0.05


@pytest.mark.usefixtures("optimised")
def test_friction_that_is_not_used_up_is_refused() -> None:
    car, log = pushes(0.7, hardest=0.02)
    with pytest.raises(InputError, match=r"tires\.friction hardly shows in these data"):
        calibrate(car, {"pushes": log}, ["friction"])
