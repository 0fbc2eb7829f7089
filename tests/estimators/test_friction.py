"""Friction estimators: exact where their model holds, humble where nothing can be known."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from tests.estimators.friction_drives import FRICTION, RATE, force_share, lane_change, level_car, pull

from roadstate.core import WHEELS, InputError, Log, Validity
from roadstate.core.constants import GRAVITY
from roadstate.estimators import build
from roadstate.estimators.contact import Contact
from roadstate.estimators.friction import FrictionEstimator
from roadstate.papers.friction_measures import least_std, steering_begins
from roadstate.run import scan
from roadstate.vehicles import Vehicle

GIVEN: dict[str, Any] = {
    "grouping": "one",
    "mean": 1.0,
    "shared_std": 0.5,
    "own_std": 0.0,
    "shared_walk": 0.0,
    "own_walk": 0.0,
    "sensor_std": 0.01,
    "uses_rate": False,
    "direct": True,
}


@pytest.fixture(scope="module")
def car() -> Vehicle:
    return level_car()


@pytest.fixture(scope="module")
def drive() -> Log:
    return lane_change()


def made(name: str, car: Vehicle, log: Log, **options: Any) -> FrictionEstimator:
    estimator = build(name, car, log.available, **options)
    assert isinstance(estimator, FrictionEstimator)
    return estimator


def straight(speed: float, count: int = 1000) -> Log:
    """Constant speed, the wheels' slip just what the air takes, noise on every signal."""
    car, random = level_car(), np.random.default_rng(1)
    drag = 0.5 * car.aerodynamics.air_density * car.drag_area * speed**2 / (car.mass * GRAVITY)
    slip = drag / (0.8 * car.tires.slip_stiffness / car.tires.friction) * np.ones(count)
    log = pull(car, np.full(count, 0.8), slip, speed, noise=0.05)
    stds = {"speed": 0.05, "velocity_y": 0.03, "yaw_rate": 0.0035, "steer": 1e-3}
    stds |= {f"wheel_speed_{w}": 0.05 for w in WHEELS}
    return log.with_channels({n: log[n] + s * random.standard_normal(count) for n, s in stds.items()})


@pytest.mark.parametrize("name", ["friction-ukf", "friction-ekf", "friction-pf"])
def test_friction_is_exact_on_a_drive_of_the_own_model(name: str, car: Vehicle, drive: Log) -> None:
    found = scan(made(name, car, drive, **GIVEN), drive)
    late = drive.time > steering_begins(drive) + 1
    # the plant's loads are those of its forces, the estimator's those of its accelerometers: the same here
    error = found.values["friction_peak"][late] / FRICTION - 1
    assert np.abs(error).max() < (1e-3 if name == "friction-pf" else 2e-4)


@pytest.mark.parametrize("uses_rate", [False, True])
def test_of_a_linear_model_ekf_and_ukf_make_the_same(uses_rate: bool, car: Vehicle, drive: Log) -> None:
    options = GIVEN | {"grouping": "front_rear", "own_std": 0.2, "shared_walk": 0.02, "uses_rate": uses_rate}
    ekf, ukf = (
        scan(made(n, car, drive, filter_options={"gate": None}, **options), drive)
        for n in ("friction-ekf", "friction-ukf")
    )
    for quantity, values in ekf.values.items():
        np.testing.assert_allclose(ukf.values[quantity], values, rtol=1e-8, atol=1e-10)
    for quantity, spread in ekf.std.items():
        np.testing.assert_allclose(ukf.std[quantity], spread, rtol=1e-8, atol=1e-12)


def test_four_frictions_are_the_least_squares_solution(car: Vehicle, drive: Log) -> None:
    """F = μ F⁰ is linear: with a constant friction the filter is ridge regression on all samples."""
    options = GIVEN | {"grouping": "four", "shared_std": 0.0, "own_std": 0.3}
    estimator = made("friction-ekf", car, drive, filter_options={"gate": None}, **options)
    part = Log(drive.time[:600], {n: v[:600] for n, v in drive.channels.items()})
    found = scan(estimator, part)
    information, right = np.eye(4) / 0.3**2, np.ones(4) * 1.0 / 0.3**2
    for k in range(len(part)):
        contact = Contact(
            jnp.asarray([part[c][k] for c in ("speed", "velocity_y", "yaw_rate")]),
            jnp.asarray(part["steer"][k]),
            jnp.asarray([part[f"wheel_speed_{w}"][k] for w in WHEELS]),
            jnp.asarray([part["accel_x"][k], part["accel_y"][k]]),
            jnp.zeros(7),
            jnp.zeros(()),
        )
        shares = np.asarray(estimator.model.wheel_shares(jnp.ones(4), contact))
        z = np.array([part["accel_x"][k], part["accel_y"][k], part["yaw_accel"][k]])
        H = shares[:, :4]
        information += H.T @ H / 0.01**2
        right += H.T @ (z - shares[:, 4]) / 0.01**2
    expected, P = np.linalg.solve(information, right), np.linalg.inv(information)
    for i, wheel in enumerate(WHEELS):
        assert found.values[f"friction_peak_{wheel}"][-1] == pytest.approx(expected[i], rel=1e-6)
        assert found.std[f"friction_peak_{wheel}"][-1] == pytest.approx(np.sqrt(P[i, i]), rel=1e-6)


def test_the_bound_is_what_the_linear_filter_reaches(car: Vehicle, drive: Log) -> None:
    estimator = made("friction-ekf", car, drive, filter_options={"gate": None}, **GIVEN)
    np.testing.assert_allclose(
        least_std(estimator, drive), scan(estimator, drive).std["friction_peak"], rtol=1e-6
    )


@pytest.mark.parametrize(
    ("grouping", "told"),
    [
        ("one", set()),
        ("front_rear", {"front", "rear"}),
        ("left_right", {"left", "right"}),
        ("four", {"front", "rear", "left", "right", *WHEELS}),
    ],
)
def test_only_what_a_grouping_tells_apart_is_reported(
    grouping: str, told: set[str], car: Vehicle, drive: Log
) -> None:
    found = scan(made("friction-ekf", car, drive, grouping=grouping), drive)
    names = {n.removeprefix("friction_peak_") for n in found.std if n.startswith("friction_peak_")}
    assert names == told
    for name in told:
        assert (found.std[f"friction_peak_{name}"] >= 0.99 * found.std["friction_peak"]).mean() > 0.9


def test_force_and_moment_have_the_signs_of_the_axes(car: Vehicle, drive: Log) -> None:
    model = made("friction-ekf", car, drive).model

    def shares(velocity: list[float], steer: float, slip: float) -> Any:
        wheel_speed = jnp.full(4, (1 + slip) * velocity[0] / car.wheels.radius)
        contact = Contact(
            jnp.asarray(velocity), jnp.asarray(steer), wheel_speed, jnp.zeros(2), jnp.zeros(7), jnp.zeros(())
        )
        return np.asarray(model.wheel_shares(jnp.ones(4), contact))

    left = shares([15.0, 0.0, 0.0], 0.05, 0.0)
    assert (left[1, :2] > 0).all()  # steered to the left, pushed to the left
    assert left[2, :2].sum() > 0
    np.testing.assert_allclose(left[1, 2:4], 0, atol=1e-9)
    sliding_left = shares([15.0, 0.5, 0.0], 0.0, 0.0)
    assert (sliding_left[1, :4] < 0).all()
    driving = shares([15.0, 0.0, 0.0], 0.0, 0.02)
    assert driving[0, :4].sum() == pytest.approx(GRAVITY * force_share(car, np.array(0.02)), rel=1e-6)
    locked = shares([15.0, 0.0, 0.0], 0.0, -1.0)
    assert locked[0, :4].sum() == pytest.approx(-GRAVITY, rel=0.01)  # all of the friction there is


def test_nothing_is_learned_where_there_is_nothing_to_learn(car: Vehicle) -> None:
    """Noise taken for slips would look like a tire without grip."""
    log = straight(20.0)
    found = scan(made("friction-ukf", car, log), log)
    assert found.std["friction_peak"][-1] > 0.2
    assert abs(found.values["friction_peak"][-1] - 0.8) < 0.15
    assert (found.validity[100:] == Validity.LOW_EXCITATION).all()


def test_at_standstill_the_prior_stands(car: Vehicle) -> None:
    log = straight(0.0)
    found = scan(made("friction-ekf", car, log), log)
    assert (found.validity[50:] == Validity.STANDSTILL).all()
    np.testing.assert_allclose(found.values["friction_peak"], 0.8, atol=0.02)


def test_sliding_wheels_tell_the_friction(car: Vehicle) -> None:
    """A slip of half: the tire is far beyond its limit, whatever its stiffness."""
    count = 300
    slip = np.concatenate([np.zeros(100), np.full(count - 100, -0.5)])
    log = pull(car, np.full(count, 0.5), slip, 30.0)
    found = scan(made("friction-ukf", car, log), log)
    assert found.values["friction_peak"][-1] == pytest.approx(0.5, abs=0.03)
    assert found.std["friction_peak"][-1] < 0.15 * 0.5
    assert found.validity[-1] == Validity.EXCITED
    assert found.values["friction_peak_lower"][-1] > 0.4


def test_bounds_are_within_what_a_road_can_have(car: Vehicle, drive: Log) -> None:
    found = scan(made("friction-ukf", car, drive), drive)
    lower, upper = found.values["friction_peak_lower"], found.values["friction_peak_upper"]
    value = found.values["friction_peak"]
    assert ((lower >= 0) & (lower <= value) & (value <= upper) & (upper <= 1.5)).all()
    braking = drive.time > steering_begins(drive)
    used = np.maximum.accumulate(found.values["friction_used"][braking])
    assert (value[braking] >= 0.8 * used).all()


def test_more_friction_than_there_was_means_another_road(car: Vehicle) -> None:
    """Sliding on ice, then twice as much deceleration: the old answer must not stand."""
    friction = np.concatenate([np.full(300, 0.1), np.full(50, 0.6)])
    slip = np.concatenate([np.zeros(50), np.full(300, -0.3)])
    log = pull(car, friction, slip, 40.0, noise=0.02)
    found = scan(made("friction-ukf", car, log), log)
    assert found.values["friction_peak"][299] == pytest.approx(0.1, abs=0.03)
    assert found.values["friction_peak"][-1] == pytest.approx(0.6, abs=0.1)
    assert found.values["friction_peak_lower"][312] > 0.3


def test_a_kerb_proves_no_friction(car: Vehicle) -> None:
    """One sample of 12 m/s² is no force of a tire, and no road that bears so much."""
    calm = straight(20.0)
    jolted = calm["accel_x"].copy()
    jolted[600] = 12.0
    usual, found = (
        scan(made("friction-ukf", car, log), log) for log in (calm, calm.with_channels({"accel_x": jolted}))
    )
    for name in ("friction_peak", "friction_peak_lower"):
        assert np.abs(found.values[name] - usual.values[name]).max() < 0.1, name


def test_a_gap_forgets(car: Vehicle, drive: Log) -> None:
    channels = {n: v.copy() for n, v in drive.channels.items()}
    gap = slice(700, 900)
    for values in channels.values():
        values[gap] = np.nan
    found = scan(made("friction-ukf", car, drive), Log(drive.time, channels))
    assert found.validity[gap.stop - 1] == Validity.SENSOR_MISSING
    assert found.std["friction_peak"][gap.stop - 1] > found.std["friction_peak"][gap.start - 1]


def test_a_physical_tire_by_name(car: Vehicle, drive: Log) -> None:
    estimator = made("friction-ukf", car, drive, tire="dugoff")
    assert not estimator.model.is_proportional
    found = scan(estimator, drive)
    assert np.isfinite(found.values["friction_peak"]).all()
    assert found.std["friction_peak"][int(2 * RATE)] > 0.2  # below half of the limit friction is invisible


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"grouping": "three"}, "no grouping"),
        ({"groupin": "one"}, "no setting is called 'groupin'"),
        ({"tire": "dugof"}, "no tire model is called 'dugof'"),
    ],
)
def test_wrong_words_are_refused(options: dict[str, Any], message: str, car: Vehicle, drive: Log) -> None:
    with pytest.raises(InputError, match=message):
        build("friction-ekf", car, drive.available, **options)
