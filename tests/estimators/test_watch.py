"""Channels looked at by themselves: which are frozen."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.estimators.watch import Watch

Array = NDArray[np.float64]
CHANNELS = ("accel_y", "yaw_rate", "wheel_speed_rl")
WATCH = Watch(CHANNELS)
FREEZES = 2000
"""Sample from which a channel of :func:`frozen` says the same."""


@jax.jit
def _looked(values: jax.Array, speed: jax.Array, dt: jax.Array) -> tuple[jax.Array, jax.Array]:
    def step(state, now):  # type: ignore[no-untyped-def]
        raw = dict(zip(CHANNELS, now[0], strict=True))
        state = WATCH.look(state, raw, now[1], dt)
        left = WATCH.without_frozen(state, raw)
        return state, (WATCH.is_frozen(state), jnp.stack([left[c] for c in CHANNELS]))

    return jax.lax.scan(step, WATCH.init(), (values.T, speed))[1]  # type: ignore[no-any-return]


def looked(values: Array, speed: Array, dt: float = 0.01) -> tuple[NDArray[np.bool_], Array]:
    """(n, 3) which are frozen, and what is left of the samples (3, n)."""
    found, left = _looked(jnp.asarray(values), jnp.asarray(speed), jnp.asarray(dt))
    return np.asarray(found), np.asarray(left)


def drive(step: float, seed: int = 0, n: int = 4000, noise: float = 0.01) -> Array:
    """Bends, then a straight from half way on, in steps of so many times the noise."""
    rng = np.random.default_rng(seed)
    bends = np.where(np.arange(n) < n // 2, np.sin(np.arange(n) / 150), 0.0)
    values = bends + noise * rng.standard_normal((3, n))
    return np.round(values / (step * noise)) * step * noise


def frozen(step: float, row: int, seed: int = 0) -> Array:
    """The same, a channel standing still from :data:`FREEZES` on for 10 s."""
    values = drive(step, seed)
    values[row, FREEZES : FREEZES + 1000] = values[row, FREEZES]
    values[row, FREEZES + 1000] += 1.0
    return values


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("row", [0, 1])
def test_a_frozen_one_is_found_within_a_second_and_left_out(row: int, seed: int) -> None:
    found, left = looked(frozen(1.0, row, seed), np.full(4000, 15.0))
    since, until = np.flatnonzero(found[:, row])[[0, -1]]
    assert FREEZES < since <= FREEZES + 100
    assert until == FREEZES + 999, "it is believed again as soon as it moves"
    assert found[since : until + 1, row].all()
    assert not np.delete(found, row, axis=1).any()
    assert (np.isnan(left[:, row]) == found[:, row]).all()


def test_it_is_found_again_however_long_it_was_before() -> None:
    values = frozen(1.0, 0)
    values[0, 3500:3900] = values[0, 3500]
    found, _ = looked(values, np.full(4000, 15.0))
    assert found[3560:3899, 0].all()


@pytest.mark.parametrize("step", [0.1, 1.0, 3.0, 10.0, 30.0])
@pytest.mark.parametrize("seed", range(3))
def test_coarse_steps_on_a_straight_are_not_frozen(step: float, seed: int) -> None:
    found, _ = looked(drive(step, seed), np.full(4000, 15.0))
    assert not found.any()


def test_nor_is_one_that_repeats_each_sample() -> None:
    values = np.repeat(drive(1.0, n=2000), 2, axis=1)
    assert not looked(values, np.full(4000, 15.0))[0].any()


def test_nor_anything_of_a_car_that_stands() -> None:
    values = frozen(1.0, 0)
    speed = np.where((np.arange(4000) >= FREEZES) & (np.arange(4000) < FREEZES + 1000), 0.0, 15.0)
    assert not looked(values, speed)[0].any()


def test_nor_a_wheel_which_holds_its_speed() -> None:
    assert not looked(frozen(1.0, 2), np.full(4000, 15.0))[0].any()


def test_one_that_has_never_changed_may_be_without_noise() -> None:
    values = drive(1.0)
    values[0] = 0.25
    assert not looked(values, np.full(4000, 15.0))[0].any()


def test_samples_that_come_slowly_are_not_judged() -> None:
    assert not looked(frozen(1.0, 0), np.full(4000, 15.0), dt=0.1)[0].any()
