"""Forces that are weighed no more often than they can change."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import NDArray
from tests.estimators.tires_on_road import straight_on

from roadstate.estimators.friction_bank import BankState, FrictionBank
from roadstate.estimators.pace import SELDOM, Pace
from roadstate.estimators.sideways import V_Y, Touch
from roadstate.vehicles import Vehicle

SPEED = 15.0


def touch(accel_y: jax.Array, yaw_rate: jax.Array) -> Touch:
    """A car that is pushed aside, and of whose tires nothing tells."""
    untold = {"across_std": jnp.full(2, 1e6), "along_std": jnp.full(4, jnp.inf), "lag": jnp.zeros(())}
    return straight_on(speed=SPEED)._replace(accel_y=accel_y, yaw_rate=yaw_rate, **untold)


@pytest.fixture(scope="module")
def bank(vehicle: Vehicle) -> FrictionBank:
    return FrictionBank(vehicle, ())


@partial(jax.jit, static_argnames="always")
def driven(
    bank: FrictionBank, accel_y: jax.Array, yaw_rate: jax.Array, dt: jax.Array, *, always: bool
) -> tuple[jax.Array, jax.Array, jax.Array, BankState]:
    """v_y and its 1σ after each sample, whether it was weighed, and the last state."""

    def step(
        carry: tuple[Pace, BankState], row: tuple[jax.Array, ...]
    ) -> tuple[tuple[Pace, BankState], tuple]:
        pace, state = carry
        here = touch(row[0], row[1])
        if always:
            state = bank.step(state, here, row[2])[0]
        else:
            pace, state, _ = pace.weigh(bank, state, here, row[2])
        mean, std = pace.merged(bank, state)
        return (pace, state), (mean[V_Y], std[V_Y], pace.since == 0)

    (_, state), told = jax.lax.scan(step, (Pace.start(), bank.init()), (accel_y, yaw_rate, dt))
    return *told, state


def run(
    bank: FrictionBank, accel_y: NDArray[np.float64], dt: float, *, always: bool = False, turn: float = 0.0
):
    """:func:`driven` with samples ``dt`` apart."""
    told = driven(bank, *map(jnp.asarray, (accel_y, 0 * accel_y + turn, 0 * accel_y + dt)), always=always)
    return jax.tree.map(np.asarray, told)


@pytest.mark.parametrize(
    ("rate", "every"), [(20, 1), (50, 1), (64, 1), (75, 2), (100, 2), (128, 2), (200, 3), (1000, 15)]
)
@pytest.mark.parametrize("jitter", [0.0, 0.02])
def test_how_often(rate: int, every: int, jitter: float) -> None:
    """Whatever a clock's jitter, it is every so many samples."""
    steps = (1 + jitter * np.random.default_rng(0).uniform(-1, 1, (200, every))) / rate
    sums = np.cumsum(steps, axis=1)
    assert (sums[:, -1] > SELDOM).all()
    assert (sums[:, :-1] < SELDOM).all()


def test_seldom_samples_are_all_weighed(bank: FrictionBank) -> None:
    """At 50 Hz the states are the bank's own, to single precision's rounding."""
    accel = np.random.default_rng(1).normal(size=100)
    *_, weighed, paced = run(bank, accel, 0.02)
    *_, plain = run(bank, accel, 0.02, always=True)
    assert weighed.all()
    for one, other in zip(jax.tree.leaves(paced), jax.tree.leaves(plain), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-6)


def test_nothing_of_an_acceleration_is_lost_between_them(bank: FrictionBank) -> None:
    """One that only the samples feel which are not weighed moves the car half as far as a steady one."""
    steady = np.full(100, 1.0)
    odd = np.where(np.arange(100) % 2 == 0, 1.0, 0.0)
    velocity, _, weighed, _ = run(bank, steady, 0.01)
    assert weighed.sum() == 50
    assert not weighed[0::2].any()
    np.testing.assert_allclose(run(bank, odd, 0.01)[0][1::2], velocity[1::2] / 2, atol=2e-3)


@pytest.mark.parametrize("turn", [0.0, 0.1])
def test_sideslip_is_that_of_now(bank: FrictionBank, turn: float) -> None:
    """As where all samples are weighed, and as sure."""
    accel = np.full(100, 2.0)
    velocity, std, _, _ = run(bank, accel, 0.01, turn=turn)
    always, always_std, _, _ = run(bank, accel, 0.01, turn=turn, always=True)
    np.testing.assert_allclose(velocity[1::2], always[1::2], rtol=0.012)
    # a car that is hardly ever seen to slide is held back only where that is weighed
    assert np.abs(velocity - always).max() < 0.4 * 0.01 * 2.0
    np.testing.assert_allclose(std, always_std, rtol=0.02)


@pytest.mark.parametrize(
    ("speed", "gain", "at_once"),
    [(20.0, 0.0045, True), (20.0, 0.0035, False), (5.0, 0.0095, False), (5.0, 0.0105, True)],
)
def test_a_wheel_that_slips_otherwise_is_weighed_at_once(
    bank: FrictionBank, speed: float, gain: float, at_once: bool
) -> None:
    """Above 12.5 m/s by more than .004, below it by more than 5 cm/s."""
    here = straight_on(speed=speed)
    pace, state, _ = Pace.start().weigh(bank, bank.init(), here, jnp.asarray(0.02))
    slips = here._replace(slip=here.slip.at[2].set(-gain))
    after, _, _ = pace.weigh(bank, state, slips, jnp.asarray(0.01))
    assert (float(after.since) == 0) is at_once


def test_a_wheel_that_has_come_to_slip_more_is_watched(bank: FrictionBank) -> None:
    """For as long as that is new, every sample is weighed; and then as seldom as before."""
    here, dt = straight_on(), jnp.asarray(0.01)
    pace, state = Pace.start(), bank.init()
    weighed = []
    weigh = jax.jit(lambda pace, state, touch: pace.weigh(bank, state, touch, dt)[:2])
    for i in range(500):
        pace, state = weigh(pace, state, here if i < 100 else here._replace(slip=here.slip - 0.02))
        weighed.append(float(pace.since) == 0)
    assert sum(weighed[:100]) <= 51
    assert all(weighed[100:150])
    assert sum(weighed[-100:]) == 50
