"""The joint estimator against sensors that lie, fall silent, come late or tell little."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import WHEELS, Estimates, Log, Validity
from roadstate.core.constants import GRAVITY
from roadstate.estimators import Estimator, build
from roadstate.run import Stream, scan
from roadstate.sim.sensors.wheel_pulses import ToothSensor
from roadstate.vehicles import Vehicle

pytestmark = pytest.mark.usefixtures("optimised")
Array = NDArray[np.float64]
RATE = 100.0
TIME = np.arange(2000) / RATE
NOISE = {"accel_x": 0.05, "accel_y": 0.05, "yaw_rate": 0.003, "steering_wheel": 0.01, "speed": 0.05}
BENDS = ("yaw_rate", "accel_y", "steering_wheel")
SPINS = tuple(f"wheel_speed_{w}" for w in WHEELS)
Turn = Callable[..., Log]
Run = Callable[[Log], Estimates]


@pytest.fixture(scope="module")
def turn(drive: Callable[..., Log], vehicle: Vehicle) -> Turn:
    """A level drive with bends: the linear single-track model in steady state, rolling wheels, noise."""
    geometry, tires, radius = vehicle.geometry, vehicle.tires, vehicle.wheels.radius
    assert vehicle.steering is not None
    base = geometry.cg_to_front_axle + geometry.cg_to_rear_axle
    rear = tires.cornering_stiffness_rear
    understeer = (1 / tires.cornering_stiffness_front - 1 / rear) / GRAVITY
    lean = 1 + GRAVITY * vehicle.body.pitch_gradient, 1 + GRAVITY * vehicle.body.roll_gradient
    ratio = vehicle.steering.ratio

    def make(speed: Array, yaw_rate: Array, seed: int = 0) -> Log:
        rng, count = np.random.default_rng(seed), len(speed)
        log = drive(speed, np.zeros(count))
        moving = np.where(np.abs(speed) < 0.5, np.inf, speed)
        steer = (base + understeer * speed**2) * yaw_rate / moving
        across = speed * yaw_rate
        slides = geometry.cg_to_rear_axle * yaw_rate - np.abs(speed) * across / GRAVITY / rear
        backward = vehicle.mass * across * geometry.cg_to_rear_axle / base * np.sin(steer)
        tracks = np.repeat([geometry.track_front, geometry.track_rear], 2) * np.array([0.5, -0.5, 0.5, -0.5])
        channels = {
            **log.channels,
            "accel_x": log["accel_x"] - lean[0] * slides * yaw_rate,
            "accel_y": lean[1] * across,
            "yaw_rate": yaw_rate,
            "steering_wheel": ratio * steer,
            "speed": np.where(np.arange(count) % 10 == 0, np.abs(speed), np.nan),
            "gear_ratio": np.where(speed < 0, -3.5, 3.5),
        }
        for i, spin in enumerate(SPINS):
            rolling = (speed - tracks[i] * yaw_rate) / np.cos(steer if i < 2 else 0.0) / radius
            noise = 0.05 * rng.standard_normal(count) * (np.abs(speed) > 0.1)  # rad/s
            channels[spin] = np.abs(rolling + noise)
        # in reverse, what drives backward is drive and what slows is brakes
        torque = 2 * channels["drive_torque_fl"] - 4 * channels["brake_torque_fl"]
        torque = torque + radius * (backward - vehicle.mass * slides * yaw_rate)
        pulls = torque * np.where(speed < 0, -1, 1) > 0
        channels |= {f"drive_torque_{w}": np.where(pulls, torque, 0.0) / 2 for w in ("fl", "fr")}
        channels |= {f"brake_torque_{w}": np.where(pulls, 0.0, np.abs(torque)) / 4 for w in WHEELS}
        for name, std in NOISE.items():
            channels[name] = channels[name] + std * rng.standard_normal(count)
        return Log(log.time, channels)

    return make


@pytest.fixture(scope="module")
def bends(turn: Turn) -> Log:
    """Speeding up and braking in bends to either side."""
    return turn(10 + 3 * np.sin(2 * np.pi * TIME / 10), 0.25 * np.sin(2 * np.pi * TIME / 6))


@pytest.fixture(scope="module")
def estimator(vehicle: Vehicle, bends: Log) -> Estimator:
    return build("joint", vehicle, [c for c in bends.available if not c.startswith("ref_")])


@pytest.fixture(scope="module")
def run(estimator: Estimator) -> Run:
    """One program for all logs."""
    return lambda log: scan(estimator, log)


@pytest.fixture(scope="module")
def clean(run: Run, bends: Log) -> Estimates:
    return run(bends)


def named(said: Estimates) -> dict[str, float]:
    """Fault → s of its begin."""
    return {one["fault"]: one["first_s"] for one in said.metadata["faults"]}


def sound(said: Estimates, steepest: float = 0.03, since: float = 2.0) -> None:
    """Finite, positive, and level after some time (s), as the road is."""
    assert all(np.isfinite(v).all() for v in said.values.values())
    assert all((v > 0).all() and np.isfinite(v).all() for v in said.std.values())
    assert np.abs(said.values["grade"][said.time > since]).max() < steepest


def test_a_clean_drive_has_no_faults(clean: Estimates) -> None:
    assert clean.metadata["faults"] == []
    assert not np.isin(clean.validity, [Validity.SENSOR_FAULT, Validity.DIVERGED]).any()
    sound(clean, 0.015)


@pytest.mark.parametrize("channel", ["yaw_rate", "steering_wheel", "accel_y", "accel_x"])
def test_a_swapped_sign_is_named_and_put_right(run: Run, bends: Log, clean: Estimates, channel: str) -> None:
    said = run(bends.with_channels({channel: -bends[channel]}))
    wrong = {what: when for what, when in named(said).items() if "wrong sign" in what}
    (what,) = wrong
    assert what.startswith(f"{channel}: wrong sign")
    assert "flip it in the mapping" in what
    assert wrong[what] < 11.0
    assert {f.split(":")[0] for f in named(said) if "contradicts what" in f} <= {channel}
    assert (said.validity[wrong[what] + 0.02 < TIME] == Validity.SENSOR_FAULT).all()
    end = TIME > 17.0
    assert all(np.isfinite(v).all() for v in said.values.values())
    for quantity, near in (("grade", 0.02), ("velocity_y", 0.3), ("speed", 0.2)):
        apart = np.abs(said.values[quantity] - clean.values[quantity])[end]
        assert (apart < np.maximum(near, 2 * said.std[quantity][end])).all(), quantity


@pytest.mark.parametrize("channel", ["yaw_rate", "accel_y", "accel_x"])
def test_a_sign_that_was_right_is_not_put_right(run: Run, bends: Log, clean: Estimates, channel: str) -> None:
    """How a sensor is mounted does not change on the way: what is right again later must not be turned."""
    during = (TIME > 4.0) & (TIME < 13.0)
    said = run(bends.with_channels({channel: np.where(during, -1, 1) * bends[channel]}))
    assert 4.0 < named(said)[f"{channel}: contradicts what others tell; left out"] < 6.0
    assert not any("wrong sign" in f for f in named(said))
    end = TIME > 16.5
    assert not np.isin(said.validity[end], [Validity.SENSOR_FAULT]).any()
    for quantity, near in (("grade", 0.01), ("velocity_y", 0.1), ("speed", 0.1)):
        assert np.abs(said.values[quantity] - clean.values[quantity])[end].max() < near, quantity
    assert (said.values["friction_peak_lower"] < clean.values["friction_peak_upper"])[end].all()


@pytest.mark.parametrize("mirrored", [("left", "right"), BENDS])
def test_a_mirrored_car_is_named(run: Run, bends: Log, mirrored: tuple[str, ...]) -> None:
    """Sides swapped, or all that tells of bends: which of them it is, nothing in the log can tell."""
    swapped = {a: bends[b] for a, b in zip(SPINS, (SPINS[i] for i in (1, 0, 3, 2)), strict=True)}
    said = run(bends.with_channels(swapped if mirrored != BENDS else {c: -bends[c] for c in BENDS}))
    assert {f.split(":")[0] for f in named(said) if "swapped" in f} == {"front wheels", "rear wheels"}
    assert all(np.isfinite(v).all() for v in said.values.values())


def test_degrees_taken_for_radians_are_contradicted(run: Run, bends: Log) -> None:
    said = run(bends.with_channels({"yaw_rate": np.degrees(bends["yaw_rate"])}))
    assert any(f.startswith("yaw_rate: contradicts") for f in named(said))
    assert not any("wrong sign" in f for f in named(said))
    assert all(np.isfinite(v).all() for v in said.values.values())


@pytest.mark.parametrize(
    ("channel", "begins", "change", "what"),
    [
        ("accel_y", 7.0, lambda v: np.full_like(v, np.nan), "no samples any more"),
        ("wheel_speed_rl", 7.0, lambda v: np.full_like(v, np.nan), "no samples any more"),
        ("brake_torque_fr", 7.0, lambda v: np.full_like(v, np.nan), "no samples any more"),
        ("accel_x", 6.5, lambda v: np.full_like(v, v[0]), "stuck"),
        ("accel_y", 8.3, lambda v: np.full_like(v, v[0]), "stuck"),
        ("yaw_rate", 8.3, lambda v: np.full_like(v, v[0]), "stuck"),
        ("wheel_speed_fl", 5.0, lambda v: np.full_like(v, v[0]), "stuck"),
        ("yaw_rate", 7.0, lambda v: v + 0.5, "contradicts what others tell"),
        ("accel_x", 7.0, lambda v: v + 4.0, "contradicts what others tell"),
        ("wheel_speed_rr", 7.0, lambda v: -v, "wrong sign"),
        ("yaw_rate", 7.0, lambda v: v + 3.0 * (np.arange(len(v)) == 30), "far off its neighbours"),
        ("speed", 7.0, lambda v: v + 9.0 * (np.arange(len(v)) == 30), "far off its neighbours"),
    ],
)
def test_what_can_be_told_is_told_within_a_second(
    run: Run, bends: Log, channel: str, begins: float, change: Callable[[Array], Array], what: str
) -> None:
    during = begins <= TIME
    values = bends[channel].copy()
    values[during] = change(values[during])
    said = run(bends.with_channels({channel: values}))
    when = {f: s for f, s in named(said).items() if f.startswith(channel) and what in f}
    assert min(when.values()) - begins <= 1.0
    flagged = np.isin(said.validity, [Validity.SENSOR_FAULT, Validity.SENSOR_MISSING])
    assert not flagged[~during].any()
    assert flagged[during & (begins + 1.0 >= TIME)].any()
    if what == "stuck":  # it is there all the while
        assert (said.validity[begins + 1.0 < TIME] == Validity.SENSOR_FAULT).all()
    sound(said, 0.05, begins + 2.0)


def test_speed_in_whole_kilometres_per_hour(run: Run, bends: Log, vehicle: Vehicle) -> None:
    """Neither a stuck sensor nor a step of the speed is seen in the steps; nor is a slope."""
    radius = vehicle.wheels.radius
    whole = {c: np.round(bends[c] * radius * 3.6) / 3.6 / radius for c in SPINS}
    said = run(bends.with_channels(whole | {"speed": np.round(bends["speed"] * 3.6) / 3.6}))
    assert named(said) == {}
    sound(said, 0.04)


@pytest.mark.parametrize("channel", ["accel_x", "accel_y", "yaw_rate", "steering_wheel", "wheels", "torques"])
def test_a_tenth_of_a_second_late(run: Run, bends: Log, channel: str) -> None:
    """No channel that comes so late is taken for one that lies, nor spoils the grade."""
    which = {"wheels": "wheel_speed", "torques": ("drive_torque", "brake_torque")}.get(channel, channel)
    late = round(0.1 * RATE)
    hit = {c: np.r_[np.full(late, v[0]), v[:-late]] for c, v in bends.channels.items() if c.startswith(which)}
    assert hit
    said = run(bends.with_channels(hit))
    assert not any("sign" in f or "contradicts what" in f for f in named(said))
    sound(said, 0.05)


def test_an_hour_at_standstill(run: Run, turn: Turn) -> None:
    """Nothing drifts and no variance collapses in an hour of noise, told every four seconds."""
    speed = np.maximum(8 - 1.6 * np.arange(900) / RATE, 0.0)
    drive = turn(speed, np.zeros(900))
    rest = turn(np.zeros(900), np.zeros(900), seed=1)
    time = np.r_[drive.time, drive.time[-1] + 4.0 * np.arange(1, 901)]
    still = rest.with_channels({"speed": np.abs(rest["speed"])})  # at every sample
    log = Log(time, {c: np.r_[drive[c], still[c]] for c in drive.channels})
    said = run(log)
    stands = time > drive.time[-1] + 60
    assert all(np.isfinite(v).all() for v in said.values.values())
    assert np.abs(said.values["speed"][stands]).max() < 0.3
    grade, spread = said.values["grade"], said.std["grade"]
    assert (np.abs(grade) < 3 * spread)[stands].all()
    assert np.ptp(grade[stands]) < 0.015
    # what is left in the end is the bias that looks like a slope
    assert spread[stands][0] >= spread[-1] > 0.006
    assert np.abs(said.values["accel_x_bias"][stands]).max() < 0.1
    low, high = said.values["friction_peak_lower"], said.values["friction_peak_upper"]
    assert (high - low)[stands].min() > 0.3
    assert not any("sign" in f or "contradicts" in f or "stuck" in f for f in named(said))


def test_a_stop_and_a_launch_told_by_teeth(run: Run, turn: Turn, vehicle: Vehicle) -> None:
    """At walking pace the time from tooth to tooth is long, and what a sensor reads is late by as much."""
    speed = np.maximum(np.abs(6 - 1.5 * TIME) - 3, 0.0)  # 3 m/s to rest, 4 s there, and off again
    log = turn(speed, np.zeros(len(speed)))
    spins, rng = ToothSensor(resolution=0.02, delay=0.01), np.random.default_rng(3)
    fine = np.arange(0.0, TIME[-1], 1e-3)
    rolling = np.interp(fine, TIME, speed) / vehicle.wheels.radius
    read = {spin: np.append(spins.read(fine, rolling, rng)[1], np.nan) for spin in SPINS}
    said = run(log.with_channels(read | {"speed": np.full(len(log), np.nan)}))
    error, spread = said.values["speed"] - speed, said.std["speed"]
    slow = (said.time > 1.0) & (speed < 2.0)
    assert np.abs(error[slow]).max() < 0.1
    assert np.sqrt(np.mean(error[slow] ** 2)) < 0.03
    assert np.mean(np.abs(error[slow]) < 1.96 * spread[slow]) > 0.9
    # what brakes hold one axle against the other nothing tells
    stands = said.std["force_x_front"][(said.time > 3.0) & (said.time < 5.0)]
    assert stands.min() > 0.03 * vehicle.mass * GRAVITY > 1.5 * said.std["force_x_front"][-1]


def test_in_a_long_bend_the_grade_is_no_surer_than_the_sideslip(run: Run, turn: Turn) -> None:
    """v_y r looks like a slope."""
    rate = np.minimum(TIME / 4, 1.0) * 0.4
    said = run(turn(np.full(len(TIME), 15.0), rate))
    late = said.time > 10
    assert (said.std["grade"] > 0.9 * said.std["velocity_y"] * 0.4 / GRAVITY)[late].all()
    assert np.abs(said.values["grade"] / said.std["grade"])[late].max() < 2.5


def test_a_receiver_tells_that_all_wheels_repeat_themselves(run: Run, turn: Turn) -> None:
    """They do from 8 to 13 s of a car that speeds up steadily, so that no acceleration changes either."""
    speed = 8 + 1.6 * np.clip(TIME - 5, 0, 7)
    log = turn(speed, np.zeros_like(TIME))
    frozen, at = (TIME >= 8) & (TIME < 13), int(8 * RATE)
    said = run(log.with_channels({s: np.where(frozen, log[s][at], log[s]) for s in SPINS}))
    told = named(said)
    assert all(8.5 < told[f"{s}: stuck, or jumps as no car does"] < 9.5 for s in SPINS)
    assert np.abs(said.values["speed"] - speed)[(TIME > 10) & (TIME < 13)].max() < 0.6
    sound(said, 0.015, since=14.0)


def test_coarse_wheels_at_constant_speed_repeat_themselves_for_good_reason(run: Run, turn: Turn) -> None:
    """Steps of .3 m/s, and a receiver of ±.2 m/s that comes after two seconds and is far off once."""
    log = turn(np.full_like(TIME, 15.05), np.zeros_like(TIME))
    speed = 15.05 + 0.2 * np.random.default_rng(1).standard_normal(len(TIME))
    speed[1200] += 6.0
    heard = (np.arange(len(TIME)) % 10 == 0) & (TIME > 2)
    coarse = {s: np.round(log[s]) for s in SPINS}
    said = run(log.with_channels(coarse | {"speed": np.where(heard, speed, np.nan)}))
    assert min((np.diff(c) != 0).sum() for c in coarse.values()) == 0
    assert not any(what.startswith("wheel_speed") for what in named(said))


def test_wheels_and_a_receiver_that_agree_are_not_both_wrong(run: Run, turn: Turn) -> None:
    """All wheels drift away by 3 m/s, and the filter with them; then they tell what the receiver does."""
    speed = 12 + np.sin(TIME)
    log = turn(speed, np.zeros_like(TIME))
    drift = np.where((TIME >= 6) & (TIME < 12), 0.5 * (TIME - 6), 0.0)
    said = run(log.with_channels({s: log[s] * (1 + drift / speed) for s in SPINS}))
    error = said.values["speed"] - speed
    assert error[1190] > 2
    assert np.abs(error[TIME > 12.4]).max() < 0.5
    sound(said, 0.03, since=14.0)


def test_wheels_that_all_spin_are_not_believed_for_a_signal_that_is_theirs(run: Run, turn: Turn) -> None:
    """The dashboard's speed follows four wheels that spin under drive, for a second and a half."""
    speed = 10 + 3 * np.sin(2 * np.pi * TIME / 10)
    log = turn(speed, np.zeros_like(TIME))
    ahead = 1 + 0.25 * np.clip((TIME - 9) / 0.1, 0, 1) * (TIME < 10.5)
    said = run(log.with_channels({c: log[c] * ahead for c in (*SPINS, "speed")}))
    np.testing.assert_allclose(said.values["speed"][50:], speed[50:], atol=0.8)


@pytest.mark.parametrize(("begins", "ends"), [(8.0, 16.0), (0.0, 20.0), (0.0, 10.0)])
def test_wheels_whose_sign_is_swapped_are_put_right(run: Run, turn: Turn, begins: float, ends: float) -> None:
    """All four, so that they agree with one another, and with a receiver, which has no sign; from the first
    sample on the car seems to drive backward, until it is too fast for that."""
    speed = 5 + 7 * np.minimum(TIME / 3, 1) + np.sin(TIME)
    log = turn(speed, 0.1 * np.sin(TIME))
    swapped = np.where((begins <= TIME) & (ends > TIME), -1.0, 1.0)
    said = run(log.with_channels({s: log[s] * swapped for s in SPINS}))
    known = max(begins, 4.0) <= TIME
    np.testing.assert_allclose(said.values["speed"][known], speed[known], atol=0.3)
    when = named(said)
    assert all(
        when[f"{spin}: wrong sign (put right here); flip it in the mapping"] < 4.0 + begins for spin in SPINS
    )
    assert not any("contradicts what" in f and s > 4.0 for f, s in when.items())
    sound(said, 0.05, since=begins + 8.0)


def test_reverse(run: Run, turn: Turn) -> None:
    """Wheels without a sign, a reverse gear: no sign is taken for swapped."""
    speed = -5 - 1.5 * np.sin(2 * np.pi * TIME / 10)
    said = run(turn(speed, 0.2 * np.sin(2 * np.pi * TIME / 6)))
    assert not any("sign" in f or "contradicts what" in f for f in named(said))
    np.testing.assert_allclose(said.values["speed"][200:], speed[200:], atol=0.4)
    sound(said, 0.05)


@pytest.mark.parametrize("what", ["one locks", "all lock", "spins", "lifts off"])
def test_wheels_that_do_not_roll(run: Run, turn: Turn, what: str) -> None:
    """What tires do is no fault of a sensor, and the speed is known all the while."""
    speed = 10 + 3 * np.sin(2 * np.pi * TIME / 10)
    straight = turn(speed, 0.0 * TIME)
    values = {c: straight[c].copy() for c in SPINS}
    brakes = (TIME > 3.5) & (TIME < 4.3)
    if what == "one locks":
        values["wheel_speed_fl"][brakes] = 0.0
    elif what == "all lock":
        for v in values.values():
            v[brakes] *= np.clip(1 - (TIME[brakes] - 3.5) / 0.1, 0, 1)
    elif what == "spins":
        pulls = (TIME > 9.0) & (TIME < 10.5)
        for side in ("fl", "fr"):
            values[f"wheel_speed_{side}"][pulls] *= 1.6
    else:  # in the air, a rear wheel keeps its speed
        air = (TIME > 4.2) & (TIME < 4.8)
        values["wheel_speed_rr"][air] = values["wheel_speed_rr"][air][0]
    said = run(straight.with_channels(values))
    assert not any("sign" in f or "contradicts what" in f for f in named(said))
    np.testing.assert_allclose(said.values["speed"][50:], speed[50:], atol=0.8)
    sound(said, 0.06)


def test_wheels_that_roll_are_believed_against_those_that_spin_for_long(run: Run, turn: Turn) -> None:
    """On ice, traction control lets the driven axle spin again and again, for many seconds."""
    speed = 5 + 0.7 * TIME
    straight = turn(speed, 0.0 * TIME)
    ahead = np.where(TIME > 4, 0.12 * (1 - np.cos(2 * np.pi * (TIME - 4) / 1.2)), 0.0)
    spinning = {spin: straight[spin] * (1 + ahead) for spin in SPINS[:2]}
    said = run(straight.with_channels(spinning | {"speed": np.full(len(TIME), np.nan)}))
    assert not any("contradicts what" in f for f in named(said))
    off = said.values["speed"] / speed - 1
    assert np.abs(off[TIME > 4]).max() < 0.01
    assert (np.abs(off) * speed < 3 * said.std["speed"])[TIME > 1].all()


def test_countersteering_is_no_swapped_sign(run: Run, bends: Log) -> None:
    """A slide: the car turns left, the driver steers right, and all else goes on."""
    slides = (TIME > 6.4) & (TIME < 8.6)
    other = np.where(slides, -1.0, 1.0) * bends["steering_wheel"]
    said = run(bends.with_channels({"steering_wheel": other}))
    assert not any("wrong sign" in f for f in named(said))


def test_late_samples_end_in_the_same_state(estimator: Estimator, bends: Log) -> None:
    count = 60
    rows = [{c: float(bends[c][i]) for c in estimator.channels} for i in range(count)]
    whole, late = Stream(estimator), Stream(estimator, window=0.2)
    for i in range(count):
        last = whole.push(float(TIME[i]), rows[i])
    order = np.arange(count)
    order[10:58:2], order[11:59:2] = order[11:59:2].copy(), order[10:58:2].copy()
    for i in order:
        other = late.push(float(TIME[i]), rows[i])
    for quantity, value in last.values.items():
        np.testing.assert_array_equal(np.asarray(value), np.asarray(other.values[quantity]))
