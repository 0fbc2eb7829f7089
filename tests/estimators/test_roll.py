"""The roll rate: turns against rotation matrices, biases, and gyroscopes that fail."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.accuracy.scenarios import SCENARIOS, on_plant
from numpy.typing import NDArray
from tests.estimators.body_rates import body_rates

from roadstate.core.constants import GRAVITY
from roadstate.estimators import build
from roadstate.estimators.intake import ACCEL_Y, YAW_RATE, Signals
from roadstate.estimators.roll import RollMeter, RollState
from roadstate.run import batch
from roadstate.vehicles import Vehicle

DT = 0.01
Array = NDArray[np.float64]


def seen(across: jax.Array, across_rate: jax.Array, turning: jax.Array, turning_rate: jax.Array) -> Signals:
    none, eight = jnp.zeros(8), jnp.zeros(8, bool)
    smooth = none.at[ACCEL_Y].set(across).at[YAW_RATE].set(turning)
    rate = none.at[ACCEL_Y].set(across_rate).at[YAW_RATE].set(turning_rate)
    return Signals(smooth, none, eight, smooth, rate, none, none, smooth, rate, jnp.zeros(2), eight)


def told(
    meter: RollMeter,
    roll: Array,
    across: Array,
    turning: Array,
    sine: float = 0.0,
    speed: float = 20.0,
    v_y: float | Array = 0.0,
    ahead: tuple[float, float] = (0.0, 0.0),
) -> tuple[RollState, Array, Array]:
    """The last state, and bank rates with their white errors, of samples of the roll rate."""

    def step(state: RollState, row: tuple[jax.Array, ...]) -> tuple[RollState, jax.Array]:
        rate, sideslip, *others = row
        along, dt = (jnp.asarray(sine), jnp.asarray(speed)), jnp.asarray(DT)
        unsure = jnp.array([sideslip, 0.03]), jnp.array(ahead)
        return meter.read(state, {"roll_rate": rate}, seen(*others), *along, *unsure, dt)

    sideslip = v_y * np.ones(len(roll))
    rows = tuple(
        map(jnp.asarray, (roll, sideslip, across, np.gradient(across, DT), turning, np.gradient(turning, DT)))
    )
    last, found = jax.lax.scan(step, meter.init(), rows)
    return last, *np.asarray(found).T


@pytest.mark.parametrize("turning", [-0.3, 0.0, 0.3])
@pytest.mark.parametrize("rise", [-0.08, 0.0, 0.08])
def test_it_is_the_rate_of_the_bank_in_any_turn_on_any_slope(
    turning: float, rise: float, vehicle: Vehicle
) -> None:
    bank, banking = 0.03, 0.04
    p, _, r = body_rates(0.4, -rise, bank, (turning, 0.0, banking))
    same = np.ones(3)
    _, rate, white = told(RollMeter(vehicle), p * same, 0.0 * same, r * same, float(np.sin(rise)))
    assert rate[2] == pytest.approx(banking, abs=5e-4)
    assert 0 < white[2] < 0.1


def test_a_body_that_leans_is_no_bank(vehicle: Vehicle) -> None:
    time = np.arange(0, 4, DT)
    across = 4.0 * np.sin(np.pi * time / 4) ** 2
    roll = np.gradient(vehicle.body.roll_gradient * across, DT)
    _, rate, _ = told(RollMeter(vehicle), roll, across, across / 20.0)
    assert np.abs(rate).max() < 0.05 * np.abs(roll).max()


def test_a_bias_averages_out(vehicle: Vehicle) -> None:
    """And what it may still be is part of the error."""
    time = np.arange(0, 90, DT)
    bias = 2 * vehicle.sensors.yaw_rate.bias
    noise = np.random.default_rng(1).normal(0, 0.002, len(time))
    _, rate, white = told(RollMeter(vehicle), bias + noise, 0 * time, 0 * time)
    late = time > 60
    assert abs(rate[late].mean()) < 0.3 * bias
    assert abs(rate[time < 2].mean()) > 0.8 * bias
    assert white[late].max() < 0.5 * white[10]


@pytest.mark.parametrize(("sign", "is_odd"), [(1.0, False), (-1.0, True)])
def test_one_turned_round_contradicts_the_accelerometer(sign: float, is_odd: bool, vehicle: Vehicle) -> None:
    time = np.arange(0, 6, DT)
    bank = 0.1 * np.sin(np.pi * np.clip((time - 1) / 4, 0, 0.5)) ** 2
    turning = bank
    across = 20.0 * turning - GRAVITY * np.sin(bank)
    lean = vehicle.body.roll_gradient * across
    meter = RollMeter(vehicle)
    noise = np.random.default_rng(1).normal(0, 0.002, len(time))
    last, _, white = told(meter, sign * np.gradient(lean - bank, DT) + noise, across, turning)
    assert bool(meter.is_faulty(last)) is is_odd
    assert bool(np.isinf(white[2:]).any()) is is_odd


def test_a_swerve_is_no_bank(vehicle: Vehicle) -> None:
    """v̇_y makes a lateral specific force that a bank would, too; one that nobody told of is a fault."""
    time = np.arange(0, 4, DT)
    v_y = 0.6 * (1 - np.cos(np.pi * time))
    turning = -v_y / 3
    across = 20.0 * turning + np.gradient(v_y, DT)
    roll = np.gradient(vehicle.body.roll_gradient * across, DT)
    meter = RollMeter(vehicle)
    last, *_ = told(meter, roll, across, turning, v_y=v_y)
    assert not meter.is_faulty(last)
    last, *_ = told(meter, roll, across, turning)
    assert meter.is_faulty(last)
    # nor does a car that does not turn swerve, whatever follows its accelerometer
    quiet = np.random.default_rng(1).normal(0, 1e-3, len(time))
    last, *_ = told(meter, quiet, np.gradient(v_y, DT), 0 * time, v_y=v_y)
    assert meter.is_faulty(last)
    # what another filter begins anew with is no motion
    last, *_ = told(meter, 0 * time, 0 * time, 0 * time, v_y=np.where(time > 2, 0.0, 1.5))
    assert not meter.is_faulty(last)


def test_a_sideslip_found_anew_is_no_swerve(vehicle: Vehicle) -> None:
    """After a break, in a bend: .15 m/s within a tenth of a second."""
    time = np.arange(0, 3, DT)
    quiet = np.random.default_rng(1).normal(0, 1e-3, len(time))
    roll = np.where((time > 1) & (time < 2), np.nan, quiet)
    turning = np.interp(time, [2.0, 3.0], [0.0, 0.3])
    leaning = np.gradient(vehicle.body.roll_gradient * 20 * turning, DT)
    v_y = np.interp(time, [2.0, 2.1], [0.0, 0.15])
    last, *_ = told(RollMeter(vehicle), roll + leaning, 20 * turning, turning, v_y=v_y)
    assert not RollMeter(vehicle).is_faulty(last)


@pytest.mark.parametrize(
    ("ahead", "is_odd"), [((0.0, 0.0), True), ((-1.0, 0.05), False), ((0.0, 0.5), False)]
)
def test_an_accelerometer_behind_the_centre_feels_the_yaw_acceleration(
    ahead: tuple[float, float], is_odd: bool, vehicle: Vehicle
) -> None:
    """1 m behind it; which is no bank, if anybody knows it, or that nobody does."""
    time = np.arange(0, 4, DT)
    turning = 0.2 * (1 - np.cos(2 * np.pi * time))
    across = 20.0 * turning - 1.0 * np.gradient(turning, DT)
    roll = np.gradient(vehicle.body.roll_gradient * across, DT)
    meter = RollMeter(vehicle)
    last, *_ = told(meter, roll, across, turning, ahead=ahead)
    assert bool(meter.is_faulty(last)) is is_odd


@pytest.mark.parametrize("drift", [0.0, 0.3])
def test_a_lateral_accelerometer_that_drifts_is_no_bank(drift: float, vehicle: Vehicle) -> None:
    """.3 m/s² more each second, straight on: a road that tilts would do it, and the car would roll."""
    time = np.arange(0, 6, DT)
    noise = np.random.default_rng(1).normal(0, 0.005, len(time))
    meter = RollMeter(vehicle)
    last, *_ = told(meter, noise, drift * time, 0 * time)
    assert bool(meter.is_faulty(last)) is (drift > 0)


def test_gaps_and_spikes_tell_nothing(vehicle: Vehicle) -> None:
    time = np.arange(0, 2, DT)
    noise = np.random.default_rng(1).normal(0, 0.002, len(time))
    roll = np.where(time > 1, noise, np.nan)
    roll[150] = 0.9
    roll[160] = 50.0
    _, rate, white = told(RollMeter(vehicle), roll, 0 * time, 0 * time)
    assert np.isinf(white[:100]).all()
    assert np.isfinite(white[105:]).all()
    assert np.abs(rate).max() < 0.01


def test_a_double_lane_change_is_no_failure_of_the_gyroscope() -> None:
    """v_y changes by up to .2 g at 85 km/h."""
    recordings = on_plant("family-car", SCENARIOS["double-lane-change-85-0.8"], 2)
    built = [build("joint", car, log.available) for log, car in recordings]
    for said in batch(built, [log for log, _ in recordings]):
        assert said.metadata["faults"] == []
