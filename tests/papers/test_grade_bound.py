"""The bound of paper 002's drives: against Riccati's equation, in its units, and below what we reach."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from roadstate.core import WHEELS, InputError, Log
from roadstate.core.constants import GRAVITY
from roadstate.estimators.road import GradePrior
from roadstate.metrics import evaluate
from roadstate.papers.grade_bound import SIGNALS, least_rmse, own_road, rolling_car
from roadstate.papers.plants import drive_on, recordings
from roadstate.papers.tfobe import PAPER, SETTLED, as_fitted
from roadstate.run import scan
from roadstate.sim.sensors import sensor_preset
from roadstate.vehicles import load_vehicle

_CAR = as_fitted(load_vehicle("family-car"))
_DT, _SPEED = 0.01, 10.0
_ROAD = GradePrior(jnp.asarray(0.05), jnp.asarray(150.0))


def _level(samples: int = 12000) -> Log:
    """A steady drive on the level, as long as it takes to know all that can be known."""
    steady = {f"ref_force_x_{w}": np.zeros(samples) for w in WHEELS}
    still = {"ref_grade": np.zeros(samples), "kinematic_accel_x": np.zeros(samples)}
    return Log(np.arange(samples) * _DT, {**steady, **still, "ref_velocity_x": np.full(samples, _SPEED)})


def _riccati(road: GradePrior) -> float:
    """Slope's least 1σ, %, of the steady filter over speed, grade and its slope: the force is an input.

    The accelerometer's and the torques' means of s = z − noise drive v, weighed by their variances.
    """
    suite = sensor_preset("paper")
    assert suite.imu is not None
    assert suite.drive_torque is not None
    radius, mass = _CAR.wheels.radius, _CAR.mass
    rim = 4 * _CAR.wheels.inertia / (mass * radius**2)
    torque = suite.drive_torque.noise * np.sqrt(2) / (radius * mass) / (1 + rim)
    force = (suite.imu.accel.noise**-2 + torque**-2) ** -0.5
    # what the torques tell holds a share rim/(1 + rim) of the grade
    told = (torque**-2 / (suite.imu.accel.noise**-2 + torque**-2)) * rim / (1 + rim)
    A = np.eye(3)
    A[0, 1] = -GRAVITY * _DT * (1 - told)
    A[1:, 1:] = np.asarray(road.transition(jnp.asarray(_SPEED * _DT)), float)
    root = np.asarray(road.sqrt_Q(jnp.asarray(_SPEED * _DT)), float)
    Q = np.zeros((3, 3))
    Q[0, 0], Q[1:, 1:] = (force * _DT) ** 2, root @ root.T
    H = np.array([[1.0, 0.0, 0.0]])
    R = np.array([[(0.05 * radius / 2) ** 2]])
    ahead = solve_discrete_are(A.T, H.T, Q, R)
    P = ahead - ahead @ H.T @ np.linalg.solve(H @ ahead @ H.T + R, H @ ahead)
    return float(100 * np.sqrt(P[1, 1]))


def test_a_steady_drive_has_the_riccati_equations_error() -> None:
    found = least_rmse(_level(), _CAR, settle=60.0, road=_ROAD)
    assert found == pytest.approx(_riccati(_ROAD), rel=0.01)


def test_twice_the_noise_on_a_road_twice_as_steep_is_twice_the_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """All is linear in the grade but for its sine."""
    log = _level(3000)
    once = least_rmse(log, _CAR, settle=5.0, road=_ROAD)
    loud = _louder(2.0)
    monkeypatch.setattr("roadstate.papers.grade_bound.sensor_preset", lambda name: loud)
    assert least_rmse(log, _CAR, settle=5.0, road=_ROAD) > 1.2 * once
    steeper = GradePrior(2 * _ROAD.std, _ROAD.length)
    assert least_rmse(log, _CAR, settle=5.0, road=steeper) == pytest.approx(2 * once, rel=0.01)


def _louder(factor: float):  # type: ignore[no-untyped-def]
    quiet = sensor_preset("paper")
    assert quiet.imu is not None

    def scaled(probe):  # type: ignore[no-untyped-def]
        return replace(probe, noise=factor * probe.noise)

    return replace(
        quiet,
        imu=replace(quiet.imu, accel=scaled(quiet.imu.accel)),
        wheel_speed=scaled(quiet.wheel_speed),
        drive_torque=scaled(quiet.drive_torque),
        brake_torque=scaled(quiet.brake_torque),
    )


def test_more_signals_and_a_known_car_tell_more() -> None:
    log = _level(6000)

    def least(*signals: str, knows_car: bool = True) -> float:
        return least_rmse(log, _CAR, settle=5.0, road=_ROAD, signals=signals, knows_car=knows_car)

    assert least(*SIGNALS) < min(least("speed", "accel"), least("speed", "torque"))
    assert least(*SIGNALS) < least(*SIGNALS, knows_car=False)
    assert least("accel") > 4.0  # no speed: hardly more than that roads are this steep


def test_own_road_is_as_steep_as_the_drive() -> None:
    """A sine of amplitude a over a length w has mean squares a²/2 and (2πa/w)²/2."""
    log = _level()
    wavy = log.with_channels({"ref_grade": 0.04 * np.sin(2 * np.pi * _SPEED * log.time / 200.0)})
    road = own_road(wavy)
    assert float(road.std) == pytest.approx(0.04 / np.sqrt(2), rel=0.01)
    assert float(road.length) == pytest.approx(np.sqrt(3) * 200 / (2 * np.pi), rel=0.01)


def test_white_noise_only() -> None:
    log = _level(100)
    with pytest.raises(InputError, match="white noise alone"):
        least_rmse(log.select([c for c in log.channels if c.startswith("ref_")]), _CAR, settle=0.0)
    with pytest.raises(InputError, match="white noise on"):
        rolling_car(_CAR, _ROAD, sensor_preset("automotive"))


def test_no_method_is_better_than_its_bound() -> None:
    """And ours is not far above it: what remains is that it has to learn bias, gains and slips."""
    condition = PAPER.conditions[0]
    log = next(recordings(drive_on(condition, matched=True), condition, "matched", 1))
    for cell in (c for c in PAPER.cells if c.condition == condition.name and c.bound is not None):
        estimator = PAPER.methods[cell.method].best(condition.vehicle, log.available)
        error = evaluate(scan(estimator, log), log, settle=SETTLED)["grade"].rmse
        assert cell.bound is not None
        bound = cell.bound(log, condition.vehicle)
        assert bound < error
        assert cell.method != "tfobe" or error < 1.25 * bound
