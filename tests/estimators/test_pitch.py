"""The pitch rate: turns against rotation matrices, gyroscopes that fail, and what they do to grade."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from tests.estimators.body_rates import body_rates

from contracts.plausible import GRADE, plausible_log
from roadstate.core import Log, Validity
from roadstate.estimators import build
from roadstate.estimators.pitch import PitchMeter, PitchState, lean_std
from roadstate.run import scan
from roadstate.vehicles import Vehicle, load_vehicle

NAN, DT = np.nan, 0.01
SPEEDS = jnp.asarray([0.0, NAN]), jnp.asarray([0.04, 0.04])
SPEED = jnp.asarray(15.0)
STRAIGHT = jnp.asarray(0.0)
IN_TIME, LATE = jnp.asarray(False), jnp.asarray(True)  # the accelerometer


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return load_vehicle("family-car")


def read(
    meter: PitchMeter,
    state: PitchState,
    rate: float,
    turning: float = 0.0,
    across: float = 0.0,
    bank: float = 0.0,
) -> tuple[PitchState, float, float]:
    tilt = jnp.asarray([bank, 0.0])
    sample = {"pitch_rate": jnp.asarray(rate)}
    state, told = meter.read(state, sample, jnp.asarray(turning), jnp.asarray(across), tilt, jnp.asarray(DT))
    return state, float(told.rate), float(told.intensity)


@pytest.mark.parametrize("turning", [-0.3, 0.0, 0.3])
@pytest.mark.parametrize("bank", [-0.05, 0.0, 0.08])
def test_it_is_the_rate_of_the_slope_in_any_turn_on_any_bank(
    turning: float, bank: float, vehicle: Vehicle
) -> None:
    meter, nose_up, rising = PitchMeter(vehicle), 0.06, 0.02
    across = 2.0 * np.sign(turning)
    roll = bank + vehicle.body.roll_gradient * across
    rates = body_rates(0.4, -nose_up, roll, (turning / np.cos(nose_up), -rising, 0.0))
    state, _, _ = read(meter, meter.init(), rates[1], turning, across, bank)
    _, told, _ = read(meter, state, rates[1], rates[2] * np.cos(roll) + rates[1] * np.sin(roll), across, bank)
    assert told == pytest.approx(rising, abs=4e-4)  # second order in slope and roll


def test_a_spike_is_refused_and_a_jump_that_lasts_is_not(vehicle: Vehicle) -> None:
    meter = PitchMeter(vehicle)
    state, _, _ = read(meter, meter.init(), 0.01)
    state, told, _ = read(meter, state, 0.9)
    assert told == pytest.approx(-0.01)
    assert bool(meter.is_faulty(state))
    for _ in range(6):
        state, told, _ = read(meter, state, 0.9)
    assert told == pytest.approx(-0.9)


def test_one_that_repeats_itself_counts_as_missing(vehicle: Vehicle) -> None:
    meter = PitchMeter(vehicle)
    state, _, usual = read(meter, meter.init(), 0.013)
    for _ in range(45):
        state, told, intensity = read(meter, state, 0.013)
    assert told == 0
    assert intensity > 20 * usual
    assert not bool(meter.is_faulty(state))


def test_one_that_contradicts_the_slope_is_not_believed_for_a_while(vehicle: Vehicle) -> None:
    meter = PitchMeter(vehicle)
    state, _, usual = read(meter, meter.init(), 0.013)
    gap, sure = jnp.asarray(0.03), jnp.asarray(0.0082)
    for i in range(150):
        state, _, _ = read(meter, state, 0.013 + 1e-6 * i)
        state = meter.judge(
            state, gap, sure, jnp.asarray(0.0081), SPEEDS, SPEED, STRAIGHT, IN_TIME, jnp.asarray(DT)
        )
    state, _, intensity = read(meter, state, 0.014)
    assert intensity > 20 * usual
    for i in range(2020):
        state = meter.judge(
            state, jnp.zeros(()), sure, jnp.asarray(0.0081), SPEEDS, SPEED, STRAIGHT, IN_TIME, jnp.asarray(DT)
        )
        state, _, intensity = read(meter, state, 0.014 + 1e-6 * i)
    assert intensity == pytest.approx(usual)


@pytest.mark.parametrize(("speeds", "fails"), [(-0.02, False), (0.02, True), (0.0, True)])
def test_a_street_that_bends_up_parts_speeds_from_the_slope_as_well(
    speeds: float, fails: bool, vehicle: Vehicle
) -> None:
    """Nose up, and slower than the slope foresees: then it is the slope that lags, as far as it may."""
    meter = PitchMeter(vehicle)
    state, sure, part = meter.init(), jnp.asarray(0.0082), jnp.asarray(0.0081)
    for i in range(300):
        state, _, _ = read(meter, state, 0.013 + 1e-6 * i)
        bent = i > 100
        gap, told = (-0.03, speeds) if bent else (0.0, 0.0)
        pulled = jnp.full(4, told), jnp.full(4, 0.04)
        state = meter.judge(
            state, jnp.asarray(gap), sure, part, pulled, SPEED, STRAIGHT, IN_TIME, jnp.asarray(DT)
        )
    assert bool(meter.is_faulty(state)) is fails


@pytest.mark.parametrize(
    ("speed", "gap", "fails"),
    [(1.5, 0.01, False), (1.5, 0.016, True), (15.0, 0.01, True), (15.0, 0.005, False), (-1.5, 0.01, False)],
)
def test_where_a_car_crawls_its_body_leans_for_long_on_unevenness(
    speed: float, gap: float, fails: bool, vehicle: Vehicle
) -> None:
    meter = PitchMeter(vehicle)
    state, sure, part = meter.init(), jnp.asarray(0.0082), jnp.asarray(0.0081)
    for i in range(400):
        state, _, _ = read(meter, state, 0.013 + 1e-6 * i)
        state = meter.judge(
            state,
            jnp.asarray(gap),
            sure,
            part,
            SPEEDS,
            jnp.asarray(speed),
            STRAIGHT,
            IN_TIME,
            jnp.asarray(DT),
        )
    assert bool(meter.is_faulty(state)) is fails


def test_what_the_filter_has_yet_to_find_after_a_gap_is_no_contradiction(vehicle: Vehicle) -> None:
    meter = PitchMeter(vehicle)
    state, _, _ = read(meter, meter.init(), 0.013)
    gap, sure, part = jnp.asarray(0.03), jnp.asarray(0.0082), jnp.asarray(0.0081)
    for i in range(100):
        state, _, usual = read(meter, state, 0.013 + 1e-6 * i)
        state = meter.judge(
            state, jnp.zeros(()), sure, part, SPEEDS, SPEED, STRAIGHT, IN_TIME, jnp.asarray(DT)
        )
    sample = {"pitch_rate": jnp.asarray(0.014)}
    zero = jnp.zeros(())
    state, told = meter.read(state, sample, zero, zero, jnp.zeros(2), jnp.asarray(5.0))
    assert float(told.rate) == 0
    assert float(told.intensity) > 20 * usual
    state = meter.judge(state, gap, sure, part, SPEEDS, SPEED, STRAIGHT, IN_TIME, jnp.asarray(5.0))
    for i in range(20):
        state, _, intensity = read(meter, state, 0.013 + 1e-6 * i)
        state = meter.judge(state, gap, sure, part, SPEEDS, SPEED, STRAIGHT, IN_TIME, jnp.asarray(DT))
        assert not bool(meter.is_faulty(state))
        assert intensity == pytest.approx(usual)


@pytest.mark.parametrize(("across", "fails"), [(0.0, True), (2.5, True), (-7.0, False), (7.0, False)])
def test_wheels_that_slip_in_a_sharp_bend_are_not_held_against_it(
    across: float, fails: bool, vehicle: Vehicle
) -> None:
    """Two wheels that read .1 m/s too little for a second."""
    meter = PitchMeter(vehicle)
    state, sure, part = meter.init(), jnp.asarray(0.0082), jnp.asarray(0.0081)
    slip = jnp.asarray([-0.1, -0.1, 0.0, 0.0]), jnp.full(4, 0.04)
    for i in range(200):
        state, _, _ = read(meter, state, 0.013 + 1e-6 * i)
        pulled = slip if i > 100 else (jnp.zeros(4), slip[1])
        state = meter.judge(
            state, jnp.zeros(()), sure, part, pulled, SPEED, jnp.asarray(across), IN_TIME, jnp.asarray(DT)
        )
    assert bool(meter.is_faulty(state)) is fails


@pytest.mark.parametrize(
    ("slips", "fails"),
    [((-0.4, 0.0, 0.0, 0.0), False), ((0.0, 0.0, 0.0, 0.4), False), ((-0.1, -0.1, -0.1, -0.1), True)],
)
def test_a_wheel_that_is_braked_alone_is_not_held_against_it(
    slips: tuple[float, ...], fails: bool, vehicle: Vehicle
) -> None:
    """As stability control does, for a second."""
    meter = PitchMeter(vehicle)
    state, sure, part = meter.init(), jnp.asarray(0.0082), jnp.asarray(0.0081)
    for i in range(200):
        state, _, _ = read(meter, state, 0.013 + 1e-6 * i)
        pulled = jnp.asarray(slips) if i > 100 else jnp.zeros(4), jnp.full(4, 0.04)
        state = meter.judge(
            state, jnp.zeros(()), sure, part, pulled, SPEED, STRAIGHT, IN_TIME, jnp.asarray(DT)
        )
    assert bool(meter.is_faulty(state)) is fails


def test_samples_that_no_body_makes_are_never_believed(vehicle: Vehicle) -> None:
    meter = PitchMeter(vehicle)
    state, _, _ = read(meter, meter.init(), 0.013)
    for _ in range(10):
        state, told, _ = read(meter, state, -999.0)
        assert told == pytest.approx(-0.013)


def test_an_accelerometer_that_lags_is_not_held_against_the_gyroscope(vehicle: Vehicle) -> None:
    meter = PitchMeter(vehicle)
    state, _, usual = read(meter, meter.init(), 0.013)
    for i in range(100):
        gap, part = jnp.asarray(0.03), jnp.asarray(0.0081)
        state = meter.judge(
            state, gap, jnp.asarray(0.0082), part, SPEEDS, SPEED, STRAIGHT, LATE, jnp.asarray(DT)
        )
        state, _, intensity = read(meter, state, 0.013 + 1e-6 * i)
    assert intensity == pytest.approx(usual)


def test_a_body_that_swings_tells_less_of_the_slope(vehicle: Vehicle) -> None:
    """A swing of ±6 mrad counts as an error of about its root mean square; a slope that grows, as none."""
    meter = PitchMeter(vehicle)
    steady = swinging = meter.init()
    for k in range(400):
        steady, _, _ = read(meter, steady, 0.03)
        swinging, _, _ = read(meter, swinging, 0.03 + 0.006 * 9.4 * np.cos(9.4 * k * DT))
    usual = float(lean_std(meter.init(), jnp.asarray(DT)))
    assert float(lean_std(steady, jnp.asarray(DT))) == pytest.approx(usual, rel=0.01)
    times = float(lean_std(swinging, jnp.asarray(DT))) / usual
    assert times == pytest.approx(np.hypot(0.0015, 0.006 / 2**0.5) / 0.0015, rel=0.25)


@pytest.mark.parametrize("kind", ["well", "none", "stuck", "drifts", "swapped"])
def test_grade_over_a_crest_with_gyroscopes_that_fail(kind: str, vehicle: Vehicle) -> None:
    """A slope that turns from 4 % up to level and back: nearer with the gyroscope, and never far without."""
    log = hill(vehicle)
    channels = {n: v.copy() for n, v in log.channels.items()}
    rate, late = channels["pitch_rate"], log.time > 15
    changed = {
        "well": rate,
        "none": np.where(late, NAN, rate),
        "stuck": np.where(late, rate[np.argmax(late)], rate),
        "drifts": rate + np.where(late, 0.03 * (log.time - 15), 0.0),
        "swapped": np.where(late, -rate, rate),
    }[kind]
    names = ["accel_x", *(f"wheel_speed_{w}" for w in ("fl", "fr", "rl", "rr")), "pitch_rate"]
    said = scan(build("joint", vehicle, names), Log(log.time, {**channels, "pitch_rate": changed}))
    error = said.values["grade"] - log["ref_grade"]
    error = error[log.time > 10] - error[log.time > 10].mean()  # no torque tells the bias
    assert np.abs(error).max() < (0.004 if kind == "well" else 0.06)
    if kind in ("drifts", "swapped"):
        assert (said.validity[log.time > 15] == Validity.SENSOR_FAULT).any()


def hill(vehicle: Vehicle) -> Log:
    level = plausible_log(vehicle, 30 * 128)
    random, time, speed = np.random.default_rng(4), level.time, level["speed"]
    grade = GRADE * np.cos(2 * np.pi * time / 12)
    body = 1 + 9.80665 * vehicle.body.pitch_gradient
    force = np.gradient(level["ref_velocity_x"], time) + 9.80665 * np.sin(grade)
    lean = vehicle.body.pitch_gradient * force
    rate = -np.gradient(grade + lean, time) + 0.003 + 0.002 * random.normal(size=len(time))
    accel = body * force + 0.1 * random.normal(size=len(time))
    changed = {"accel_x": accel, "pitch_rate": rate, "speed": speed, "ref_grade": grade}
    return level.with_channels(changed)
