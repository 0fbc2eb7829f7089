"""Which channels come late, on drives whose motion is integrated here step by step."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import Log
from roadstate.core.channels import WHEELS
from roadstate.core.signals import Signal, interpolate
from roadstate.lateness import Late, lateness
from roadstate.time_shift import RATE, TimeShift, rate_of, smooth, time_shift
from roadstate.vehicles import Vehicle, load_vehicle

Array = NDArray[np.float64]
G = 9.81
STEP = 0.01
SPINS = tuple(f"wheel_speed_{w}" for w in WHEELS)
TORQUES = tuple(f"{kind}_torque_{w}" for kind in ("drive", "brake") for w in WHEELS)
PARTS = {
    "accel_x": ("accel_x",),
    "wheels": SPINS,
    "torques": TORQUES,
    "speed": ("speed",),
    "yaw_rate": ("yaw_rate",),
    "accel_y": ("accel_y",),
    "steer": ("steer",),
}


def noise(rng: np.random.Generator, count: int, std: float, time: float) -> Array:
    """Correlated over ``time`` s."""
    out = np.zeros(count)
    keeps = np.exp(-STEP / time)
    pushes = std * np.sqrt(1 - keeps**2) * rng.standard_normal(count)
    for i in range(1, count):
        out[i] = keeps * out[i - 1] + pushes[i]
    return out


def driven(car: Vehicle, seconds: float, seed: int) -> Log:
    """A single-track car with linear tires that speeds up, brakes and turns at random, and its sensors."""
    rng = np.random.default_rng(seed)
    count = int(seconds / STEP)
    time = STEP * np.arange(count)
    accel = noise(rng, count, 1.2, 1.5)
    speed = np.clip(14 + STEP * np.cumsum(accel - np.linspace(0, 1, count) * np.mean(accel)), 6, 30)
    accel = np.gradient(speed, STEP)
    steer = 0.3 * noise(rng, count, 1.5, 1.0) / (1 + speed**2 / 20)
    steer = np.convolve(steer, np.full(20, 1 / 20), "same")
    l_f, l_r = car.geometry.cg_to_front_axle, car.geometry.cg_to_rear_axle
    stiff_f, stiff_r = car.axle_cornering_stiffness
    across, yaw, lateral = np.zeros(count), np.zeros(count), np.zeros(count)
    v_y = r = 0.0
    for i in range(count):
        front = stiff_f * (steer[i] - (v_y + l_f * r) / speed[i])
        rear = -stiff_r * (v_y - l_r * r) / speed[i]
        across[i], yaw[i], lateral[i] = (front + rear) / car.mass, r, v_y
        v_y += STEP * (across[i] - speed[i] * r)
        r += STEP * (l_f * front - l_r * rear) / car.yaw_inertia
    slope = 0.02 * np.sin(time / 17)
    slip = accel / (G * car.tires.slip_stiffness)
    turn = np.array([-1, 1, -1, 1])[:, None] * 0.5 * car.geometry.track_rear * yaw
    spins = (speed + turn) / (1 - slip) / car.wheels.radius
    force = car.mass * (accel + G * slope) * car.wheels.radius
    sensors = {
        "accel_x": accel + G * slope + 0.1 + rng.normal(0, 0.1, count),
        "accel_y": across - 0.1 + rng.normal(0, 0.1, count),
        "yaw_rate": yaw + 0.003 + rng.normal(0, 0.003, count),
        "steer": steer + 0.002 + rng.normal(0, 0.0005, count),
        "speed": np.where(np.arange(count) % 10 == 0, speed + rng.normal(0, 0.05, count), np.nan),
        **{name: w + rng.normal(0, 0.05, count) for name, w in zip(SPINS, spins, strict=True)},
        **{name: np.maximum(0.25 * force, 0) + rng.normal(0, 5, count) for name in TORQUES[:4]},
        **{name: np.maximum(-0.25 * force, 0) for name in TORQUES[4:]},
    }
    return Log(time, sensors)


def delayed(log: Log, names: tuple[str, ...], seconds: float) -> Log:
    steps = round(seconds / STEP)
    late = {n: np.concatenate([np.full(steps, np.nan), log[n][: len(log) - steps]]) for n in names}
    return Log(log.time, {**log.channels, **late})


@pytest.fixture(scope="module", params=["family-car", "suv"])
def car(request: pytest.FixtureRequest) -> Vehicle:
    return load_vehicle(request.param)


@pytest.fixture(scope="module")
def drive(car: Vehicle) -> Log:
    return driven(car, 180.0, seed=3)


def test_none_is_late(drive: Log, car: Vehicle) -> None:
    assert lateness(drive, car) == []


@pytest.mark.parametrize("seconds", [0.2, 0.35])
@pytest.mark.parametrize("part", list(PARTS))
def test_each_that_is_late(drive: Log, car: Vehicle, part: str, seconds: float) -> None:
    (found,) = lateness(delayed(drive, PARTS[part], seconds), car)
    assert found.channels == PARTS[part]
    assert found.std < 0.06
    assert found.seconds == pytest.approx(seconds, abs=max(0.03, found.std))


def test_two_that_are_late(drive: Log, car: Vehicle) -> None:
    found = lateness(delayed(delayed(drive, ("speed",), 0.4), SPINS, 0.15), car)
    assert [one.channels for one in found] == [("speed",), SPINS]
    assert [one.seconds for one in found] == pytest.approx([0.4, 0.15], abs=0.03)


def test_of_two_channels_the_later_is_late(drive: Log, car: Vehicle) -> None:
    two = Log(drive.time, {n: drive[n] for n in ("accel_x", *SPINS)})
    assert [one.channels for one in lateness(delayed(two, ("accel_x",), 0.2), car)] == [("accel_x",)]
    assert [one.channels for one in lateness(delayed(two, SPINS, 0.2), car)] == [SPINS]


def test_a_car_of_other_tires(car: Vehicle) -> None:
    """The file's stiffnesses, inertia and mass are off by a tenth; nothing becomes late of that."""
    tires = car.tires.model_copy(
        update={"cornering_stiffness_front": 12.1, "cornering_stiffness_rear": 15.0, "slip_stiffness": 19.0}
    )
    other = car.model_copy(update={"tires": tires, "yaw_inertia": 1.1 * car.yaw_inertia})
    for seed in range(4):
        assert lateness(driven(other, 120.0, seed), car) == []


def test_says_nothing_of_what_does_not_tell(drive: Log, car: Vehicle) -> None:
    """Too short a log, one that stands, one with a sign swapped, one channel alone, one that is noise."""
    late = delayed(drive, ("accel_x",), 0.3)
    assert lateness(late.between(0, 15), car) == []
    assert lateness(late.between(0, 0.01), car) == []
    standing = {n: np.zeros(len(late)) for n in SPINS}
    assert lateness(Log(late.time, {"accel_x": late["accel_x"], **standing}), car) == []
    assert lateness(Log(late.time, {n: late[n] for n in SPINS} | {"accel_x": -late["accel_x"]}), car) == []
    assert lateness(Log(late.time, {"yaw_rate": late["yaw_rate"]}), car) == []
    rng = np.random.default_rng(0)
    noisy = {"accel_x": rng.normal(0, 3, len(late)), **{n: late[n] for n in SPINS}}
    assert lateness(Log(late.time, noisy), car) == []


def test_gaps_do_no_harm(drive: Log, car: Vehicle) -> None:
    holes = (drive.time % 40 > 32) & (drive.time % 40 < 36)
    log = Log(drive.time, {n: np.where(holes, np.nan, v) for n, v in drive.channels.items()})
    assert lateness(log, car) == []
    (found,) = lateness(delayed(log, ("accel_x",), 0.2), car)
    assert found == Late(("accel_x",), pytest.approx(0.2, abs=0.02), pytest.approx(0.02, abs=0.02))


def wave(time: Array, rng: np.random.Generator) -> Array:
    """Something without end, of all frequencies that count."""
    frequencies, phases = rng.uniform(0.1, 1.0, 40), rng.uniform(0, 2 * np.pi, 40)
    return np.asarray(np.sum(np.sin(2 * np.pi * frequencies[:, None] * time + phases[:, None]), axis=0))


GRID = np.arange(0, 120, 1 / RATE)
ALWAYS = np.ones(len(GRID), bool)


@pytest.mark.parametrize("seconds", [-0.4, -0.03, 0.0, 0.013, 0.25])
@pytest.mark.parametrize("gain", [0.01, 3.0])
def test_shift_between_grid_points(seconds: float, gain: float) -> None:
    found = time_shift(
        wave(GRID, np.random.default_rng(1)),
        5 + gain * wave(GRID - seconds, np.random.default_rng(1)),
        ALWAYS,
    )
    assert isinstance(found, TimeShift)
    assert found.seconds == pytest.approx(seconds, abs=2e-3)
    assert found.correlation > 0.999


def test_shift_among_noise() -> None:
    """1σ is no less than the errors' spread, and not ten times that."""
    errors, stds = [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        x, y = wave(GRID, np.random.default_rng(seed)), wave(GRID - 0.1, np.random.default_rng(seed))
        found = time_shift(x, y + 4 * smooth(rng.standard_normal(len(GRID)) * 3, 0.2), ALWAYS)
        assert found is not None
        errors.append(found.seconds - 0.1)
        stds.append(found.std)
    z = np.array(errors) / np.array(stds)
    assert 0.1 < np.sqrt(np.mean(z**2)) < 1.0


@pytest.mark.parametrize("noisy", ["first", "second"])
def test_noise_of_either_is_no_precision(noisy: str) -> None:
    """A rate made of a noisy signal, whose own slope is mostly noise, against a slow wave."""
    z = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        slow = 0.5 * np.cos(0.5 * GRID)
        rough = slow + rate_of(0.2 * rng.standard_normal(len(GRID)))
        found = time_shift(*((rough, slow) if noisy == "first" else (slow, rough)), ALWAYS)
        if found is not None:
            z.append(found.seconds / found.std)
    assert len(z) > 5
    assert np.sqrt(np.mean(np.square(z))) < 1.3
    assert np.max(np.abs(z)) < 3


def test_outliers_do_not_decide() -> None:
    rng = np.random.default_rng(2)
    x, y = wave(GRID, rng), wave(GRID - 0.2, np.random.default_rng(2))
    spins = (GRID > 30) & (GRID < 45)
    y = np.where(spins, y + 60 * np.sin(2 * GRID), y)
    found = time_shift(x, y, ALWAYS)
    assert found is not None
    assert found.seconds == pytest.approx(0.2, abs=0.03)


def test_no_shift_is_made_up() -> None:
    x = wave(GRID, np.random.default_rng(1))
    opposite = time_shift(x, -x, ALWAYS)
    assert opposite is None or opposite.correlation < 0.7
    assert time_shift(x, x, GRID < 15) is None
    assert time_shift(x[:10], x[:10], ALWAYS[:10]) is None
    assert time_shift(x, np.full(len(x), np.nan), ALWAYS) is None
    assert time_shift(x, np.zeros(len(x)), ALWAYS) is None


def test_grid_and_rate() -> None:
    time = np.arange(0, 20, 0.1)
    signal = Signal(time, np.where((time > 8) & (time < 12), np.nan, 3 * time))
    on = interpolate(signal, GRID[: int(18 * RATE)])
    inside = (GRID[: len(on)] < 7.9) | (GRID[: len(on)] > 12.1)
    np.testing.assert_allclose(on[inside], 3 * GRID[: len(on)][inside])
    assert np.isnan(on[(GRID[: len(on)] > 8.2) & (GRID[: len(on)] < 11.8)]).all()
    slope = rate_of(3 * GRID)
    np.testing.assert_allclose(slope[20:-20], 3.0, rtol=1e-9)
