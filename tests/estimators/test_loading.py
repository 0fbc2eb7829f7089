"""Who gets in, or out, while the car stands, and what a mass that is learnt makes of it."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.core import WHEELS, Log
from roadstate.core.constants import GRAVITY
from roadstate.estimators import build
from roadstate.estimators.loading import Loading
from roadstate.run import scan
from roadstate.vehicles import Vehicle

DT = 0.01
STOPS = 4
# s, and the acceleration then, m/s²: how the car goes from stop to stop
PHASES = ((6.0, 0.0), (5.0, 2.0), (4.0, 0.0), (4.0, -2.5))
ROUND = sum(seconds for seconds, _ in PHASES)


def corrected(
    wrong: float, stands: float, drives: float, trials: int = 1
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(K, trials) what a filter of a constant says, its variance (K,), and where a load is noticed.

    The mass, known to 1 %, is in fact ``wrong`` of it more once the car has stood for ``stands`` s.
    """
    rng = np.random.default_rng(3)
    before, after = round(stands / DT), round(drives / DT)
    noise = rng.normal(size=(before + after, trials))
    begins = 0.01 * rng.normal(size=trials)  # what is true, about what is said at first

    def step(x: tuple, given: tuple) -> tuple:
        mean, P, loading = x
        told, gain, speed = given
        # a reading z = h m + n, 1σ of n being 1, after whatever has been loaded
        fresh = P + loading.std**2
        K = fresh * gain / (gain**2 * fresh + 1)
        new, left = mean + K * (told - gain * mean), (1 - K * gain) * fresh
        loading = jax.vmap(Loading.take, in_axes=(0, 0, 0, 0, None, None))(
            loading, (mean, fresh), (new, left), loading.gains, speed, jnp.asarray(DT)
        )
        return (new, left, loading), (new, left, loading.std)

    moves = np.arange(before + after) >= before
    gain = np.where(moves, 5.0, 0.0)
    told = gain[:, None] * (begins + wrong * moves[:, None]) + noise
    start = Loading(*(jnp.broadcast_to(x, (trials, *x.shape)) for x in Loading.none(jnp.zeros((3, 2)))))
    x = jnp.zeros(trials), jnp.full(trials, 0.01**2), start
    _, found = jax.jit(lambda g: jax.lax.scan(step, x, g))((told, gain, 10.0 * moves))
    mean, P, std = (np.asarray(f) for f in found)
    return mean - begins, P, std > 0


def test_a_mass_that_stays_is_hardly_ever_another() -> None:
    """Corrections add up to what σ shrinks by."""
    _, _, noticed = corrected(0.0, stands=5.0, drives=30.0, trials=400)
    assert noticed.any(axis=0).mean() < 0.05


def test_a_load_is_noticed_and_learnt() -> None:
    for load in (0.2, -0.1):
        mean, P, noticed = corrected(load, stands=5.0, drives=30.0, trials=50)
        assert noticed.any(axis=0).all()
        off = mean[-1] - load
        assert np.abs(off).max() < 0.02
        assert np.mean(off**2 / P[-1]) < 2


@pytest.mark.parametrize(("stands", "noticed"), [(2.0, False), (4.0, True)])
def test_nobody_boards_in_a_moment(stands: float, noticed: bool) -> None:
    assert corrected(0.2, stands=stands, drives=10.0)[2].any() == noticed


def test_what_is_corrected_long_after_a_stop_is_no_load() -> None:
    zero, dt, gains = jnp.zeros(()), jnp.asarray(1.0), jnp.full((3, 2), 0.1)
    state = Loading.none(jnp.zeros((3, 2)))
    for _ in range(5):
        state = state.take((zero, zero), (zero, zero), gains, zero, dt)
    for second in range(100):
        moved = zero + (0.2 if second in (50, 80) else 0.0)
        state = state.take((zero, zero + 1e-6), (moved, zero), 2 * gains, zero + 20, dt)
        assert bool(state.std > 0) == (second == 50)
        assert (state.gains == gains).all()


def told(vehicle: Vehicle, drive: Callable[..., Log], load: float, seed: int) -> Log:
    """From stop to stop, and from the third on with so much more, as a share of the mass."""
    gain = np.concatenate([np.full(round(seconds / DT), a) for seconds, a in PHASES] * STOPS)
    speed = np.maximum(np.cumsum(gain) * DT, 0.0)
    log = drive(speed, np.zeros(len(speed)))
    rng = np.random.default_rng(seed)
    channels = {name: values.copy() for name, values in log.channels.items()}
    resists = np.sign(speed) * GRAVITY * vehicle.rolling_resistance.coefficient
    more = load * vehicle.mass * (log.time > 2 * ROUND) * (np.gradient(speed, DT) + resists)
    whole = sum(log[f"drive_torque_{w}"] for w in WHEELS[:2]) - sum(log[f"brake_torque_{w}"] for w in WHEELS)
    whole = whole + more * vehicle.wheels.radius
    for wheel in WHEELS:
        channels[f"brake_torque_{wheel}"] = np.maximum(-whole, 0) / 4 + 5 * rng.normal(size=len(speed))
    for wheel in WHEELS[:2]:
        channels[f"drive_torque_{wheel}"] = np.maximum(whole, 0) / 2 + 5 * rng.normal(size=len(speed))
    channels["accel_x"] += 0.03 * rng.normal(size=len(speed))
    for wheel in WHEELS:
        channels[f"wheel_speed_{wheel}"] += 0.03 * rng.normal(size=len(speed)) * (speed > 0)
    return Log(log.time, channels)


@pytest.mark.parametrize("load", [-0.4, -0.15, 0.0, 0.06, 0.25, 0.7])
def test_the_mass_is_another_ten_seconds_after_the_stop(
    vehicle: Vehicle, drive: Callable[..., Log], load: float
) -> None:
    log = told(vehicle, drive, load, seed=4)
    found = scan(build("joint", vehicle, log.available), log)
    mass, std = found.values["mass"], found.std["mass"]
    late = log.time > 2 * ROUND + PHASES[0][0] + 10
    before = (log.time > ROUND) & (log.time < 2 * ROUND)
    true = (1 + load) * vehicle.mass
    assert (np.abs(mass - true)[late] < 2 * std[late]).all()
    assert np.abs(mass / true - 1)[late].max() < 0.04
    # σ grows where something has changed, and nowhere else
    widens = np.diff(std) > 0.02 * vehicle.mass
    assert widens[log.time[1:] > 2 * ROUND].any() == (load != 0)
    assert not widens[before[1:]].any()
    assert found.metadata.get("faults", []) == []


@pytest.mark.parametrize("load", [0.0, 0.25])
def test_nor_is_it_a_brake_that_no_channel_tells_of(
    vehicle: Vehicle, drive: Callable[..., Log], load: float
) -> None:
    """Who pulls does not brake; who brakes does, all the same."""
    log = told(vehicle, drive, load, seed=4)
    log = log.select([c for c in log.channels if "brake" not in c])
    found = scan(build("joint", vehicle, log.available), log)
    mass, std = found.values["mass"], found.std["mass"]
    late = log.time > 2 * ROUND + PHASES[0][0] + 10
    true = (1 + load) * vehicle.mass
    assert (np.abs(mass - true)[late] < 2 * std[late]).all()
    assert np.abs(mass / true - 1)[late].max() < 0.05
    error = np.abs(found.values["grade"] - log["ref_grade"])
    assert (error < 2.5 * found.std["grade"])[log.time > PHASES[0][0]].mean() > 0.95
