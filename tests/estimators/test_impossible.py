"""Faults after which a filter would stay where no car and no road can be, and breaks of any length."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import WHEELS, Estimates, InputError, Log, Validity
from roadstate.core.constants import GRAVITY
from roadstate.estimators import build
from roadstate.estimators.astray import FASTEST, STEEPEST
from roadstate.run import Stream, scan
from roadstate.run.chunk import LONGEST_BREAK
from roadstate.vehicles import Vehicle

Array = NDArray[np.float64]
Drive = Callable[..., Log]
TIME = np.arange(4000) / 100
SPEED = 24 + 3 * np.sin(TIME / 4)
GRADE = 0.02 * np.sin(TIME / 10)
FELT = ("accel_x", "accel_y", "yaw_rate", "steer")


@pytest.fixture(scope="module")
def log(drive: Drive) -> Log:
    """A car that weaves over hills, all its sensors noisy."""
    rng = np.random.default_rng(3)
    turning = 0.1 * np.sin(TIME)
    made = drive(SPEED, GRADE)
    noise = {c: 0.02 * rng.normal(size=len(TIME)) for c in made.channels if "wheel" in c or c == "accel_x"}
    return made.with_channels(
        {c: made[c] + n for c, n in noise.items()}
        | {
            "yaw_rate": turning + 0.002 * rng.normal(size=len(TIME)),
            "accel_y": SPEED * turning + 0.05 * rng.normal(size=len(TIME)),
            "steer": 2.7 * turning / SPEED + 0.0005 * rng.normal(size=len(TIME)),
        }
    )


def broken(log: Log, faults: dict[str, float], seconds: float) -> Log:
    """With other values in some channels, from 5 s on."""
    hit = (log.time >= 5) & (log.time < 5 + seconds)
    return log.with_channels({c: np.where(hit, value, log[c]) for c, value in faults.items()})


def finite(said: Estimates) -> bool:
    """Whether all that is told is a number."""
    return all(np.isfinite(v).all() for part in (said.values, said.std) for v in part.values())


STANDING = {f"wheel_speed_{w}": 0.0 for w in WHEELS}
SPINNING = {f"wheel_speed_{w}": 180.0 for w in WHEELS[:2]}


@pytest.mark.parametrize("name", ["debe", "kmbe", "tfobe"])
@pytest.mark.parametrize(
    ("faults", "seconds"),
    [(STANDING, 2.0), (SPINNING, 2.0), ({"wheel_speed_fl": 655.35}, 0.5), ({"yaw_rate": 327.67}, 0.5)],
    ids=["standing", "spinning", "racing", "turning"],
)
def test_a_fault_that_is_over_is_forgotten(
    vehicle: Vehicle, log: Log, name: str, faults: dict[str, float], seconds: float
) -> None:
    """A sine is the same a turn further: DEBE and TFOBE stayed a half turn or a whole one off, surely. And
    speeds of 10²⁰⁰ m/s came to stay."""
    said = scan(build(name, vehicle, log.available), broken(log, faults, seconds))
    assert finite(said)
    assert np.abs(said.values["speed"]).max() < FASTEST
    assert np.abs(said.values["grade"]).max() < STEEPEST / 9
    late = log.time > 20
    assert np.abs(said.values["speed"] - SPEED)[late].max() < 0.3
    assert np.abs(said.values["grade"] - GRADE)[late].max() < 0.025
    assert (said.validity[late] != Validity.DIVERGED).all()


@pytest.mark.parametrize("name", ["debe", "kmbe", "tfobe", "friction-ukf", "two-stage"])
@pytest.mark.parametrize("value", [-64.0, 327.67, 1e6])
def test_inputs_that_no_car_makes_are_missing_ones(
    vehicle: Vehicle, log: Log, name: str, value: float
) -> None:
    """A gate refuses a wild measurement; an accelerometer that moves the state was believed."""
    estimator = build(name, vehicle, log.available)
    codes = [c for c in ("accel_x", "drive_torque_fl") if c == "accel_x" or value == 1e6]
    hit = (log.time >= 5) & (log.time < 5.1)
    said, without = (
        scan(estimator, log.with_channels({c: np.where(hit, put, log[c]) for c in codes}))
        for put in (value, np.nan)
    )
    for quantity, values in without.values.items():
        np.testing.assert_allclose(said.values[quantity], values, rtol=1e-9, atol=1e-9, err_msg=quantity)


def test_an_estimator_that_has_gone_astray_says_so(vehicle: Vehicle, log: Log) -> None:
    said = scan(build("debe", vehicle, log.available), broken(log, STANDING, 2.0))
    away = log.time[said.validity == Validity.DIVERGED]
    assert len(away)
    assert away.min() > 5
    assert away.max() < 9
    after = log.time > away.max()
    error = np.abs(said.values["grade"] - GRADE)[after]
    assert np.mean(error < 1.96 * said.std["grade"][after]) > 0.9


@pytest.mark.parametrize("name", ["joint", "tfobe", "two-stage", "kmbe"])
@pytest.mark.parametrize("seconds", [3e3, 86400.0, 1.7e9])
def test_after_a_break_of_any_length_it_goes_on(
    vehicle: Vehicle, log: Log, name: str, seconds: float
) -> None:
    """Of an hour, a night, or a clock that was set right: NaN or 10²¹³ m/s came to stay."""
    time = np.where(log.time < 15, log.time, log.time + seconds)
    said = scan(build(name, vehicle, log.available), Log(time, log.channels))
    assert finite(said)
    late = log.time > 25
    if "grade" in said.values:
        assert np.abs(said.values["speed"] - SPEED)[late].max() < 0.3
        assert np.abs(said.values["grade"] - GRADE)[late].max() < 0.025
    assert not np.isin(said.validity[late], [Validity.DIVERGED, Validity.SENSOR_FAULT]).any()


def test_a_longer_break_counts_as_one_of_five_minutes(vehicle: Vehicle, log: Log) -> None:
    estimator = build("kmbe", vehicle, log.available)
    short, long = (
        scan(estimator, Log(np.where(log.time < 15, log.time, log.time + more), log.channels))
        for more in (LONGEST_BREAK, 20 * LONGEST_BREAK)
    )
    np.testing.assert_allclose(short.values["grade"], long.values["grade"], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(short.std["speed"], long.std["speed"], rtol=1e-6)
    stream = Stream(estimator)
    for i in range(1490, 1510):
        now = stream.push(long.time[i], {c: v[i] for c, v in log.channels.items()})
    again = scan(estimator, Log(long.time[1490:1510], {c: v[1490:1510] for c, v in log.channels.items()}))
    assert float(now.std["speed"]) == pytest.approx(again.std["speed"][-1], rel=1e-12)


def test_a_gyroscope_tells_what_is_used_in_bends_where_no_accelerometer_does(
    vehicle: Vehicle, log: Log
) -> None:
    """Its 1σ was .3 of the load, on a straight road as well."""
    across = log["accel_y"]
    blind = log.with_channels({"accel_y": np.full(len(TIME), np.nan)})
    said = scan(build("joint", vehicle, log.available), blind)
    late = TIME > 5
    used = np.hypot(np.gradient(SPEED, TIME) + GRAVITY * np.sin(GRADE), across)[late] / GRAVITY
    std = said.std["friction_used"][late]
    assert used.max() > 0.2
    assert 0.05 < std.min() <= std.max() < 0.08
    assert np.mean(np.abs(said.values["friction_used"][late] - used) < 1.96 * std) > 0.95


@pytest.mark.parametrize("name", ["friction-ukf", "friction-ekf", "lm-aekf", "two-stage"])
def test_a_filter_that_is_spoilt_begins_anew_and_says_so(vehicle: Vehicle, log: Log, name: str) -> None:
    """What no reader lets pass, for three seconds: friction was NaN ever after, and called little excited."""
    wild = {c: 1e6 * (-1) ** i for i, c in enumerate(log.available)}
    said = scan(build(name, vehicle, log.available), broken(log, wild, 3.0))
    assert finite(said)
    late = log.time > 20
    assert np.abs(said.values["friction_used"][late]).max() < 1
    assert said.std["friction_peak"][late].max() < 1


@pytest.mark.parametrize("name", ["friction-ukf", "two-stage"])
def test_frictions_that_nothing_tells_of_stay_those_of_roads(
    vehicle: Vehicle, drive: Drive, name: str
) -> None:
    """Ten kilometres straight on: what wanders along the way has no limits of its own."""
    time = np.arange(1500) / 5
    made = drive(np.full(len(time), 33.0), np.zeros(len(time)))
    log = Log(time, made.channels).with_channels({c: np.zeros(len(time)) for c in FELT})
    said = scan(build(name, vehicle, log.available), log)
    for view in ("friction_peak", "friction_peak_front"):
        low, middle, high = (said.values[f"{view}{end}"] for end in ("_lower", "", "_upper"))
        assert (low >= 0).all()
        assert (low <= middle).all()
        assert (middle <= high).all()
        assert (high <= 1.5).all()
        assert (high - low)[-1] > 1.2


@pytest.mark.parametrize("name", ["kmbe", "debe", "tfobe", "joint", "friction-ukf", "two-stage"])
def test_an_option_that_there_is_not(vehicle: Vehicle, log: Log, name: str) -> None:
    with pytest.raises(InputError, match=r"no setting is called 'biass'; (known|there are none)"):
        build(name, vehicle, log.available, biass=True)


@pytest.mark.parametrize("name", ["friction-ukf", "friction-ekf", "friction-pf", "lm-aekf", "two-stage"])
def test_options_of_the_filter(vehicle: Vehicle, log: Log, name: str) -> None:
    with pytest.raises(InputError, match="no setting is called 'foo'; known: "):
        build(name, vehicle, log.available, filter_options={"foo": 1})


def test_an_option_that_the_filter_refuses(vehicle: Vehicle, log: Log) -> None:
    with pytest.raises(InputError, match="filter_options: "):
        build("two-stage", vehicle, log.available, filter_options={"floor": 0.0})
