"""Sideslip where forces err for long, and the road's bank changes meanwhile."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from tests.estimators.tires_on_road import straight_on

from roadstate.core.constants import GRAVITY
from roadstate.estimators.friction_bank import BankState, FrictionBank
from roadstate.estimators.sideways import FORCE_ERROR, V_Y, Touch
from roadstate.vehicles import Vehicle

SPEED, STEP, SECONDS, SEEDS = 15.0, 0.02, 40.0, 16
LASTS, SWIFT = 12.0, 0.1  # s: of an error while a tire stays where it is, and of what comes and goes
ANGLE_ERROR = 0.002  # rad
Numbers = NDArray[np.float64]


def straight(lateral: jax.Array, across: jax.Array, steer: jax.Array) -> Touch:
    """Ahead at :data:`SPEED`, nothing along the road."""
    angle = jnp.stack([steer, jnp.zeros_like(steer)])
    here = straight_on(speed=SPEED)._replace(accel_y=lateral, lateral=lateral, angle=angle, across=across)
    return here._replace(lag=jnp.zeros(()))


def wandering(rng: np.random.Generator, std: float, lasts: float, count: int) -> Numbers:
    """A Gauss-Markov process."""
    keep = np.exp(-STEP / lasts)
    noise = std * rng.normal(size=count)
    for i in range(1, count):
        noise[i] = keep * noise[i - 1] + (1 - keep**2) ** 0.5 * noise[i]
    return noise


def driven(bank: FrictionBank, seed: int) -> tuple[Touch, Numbers]:
    """A drive over a road whose bank changes, with tires that err as the filter is told; and its v_y."""
    rng, motion = np.random.default_rng(seed), bank.motion
    count = round(SECONDS / STEP)
    stiffness, give = np.asarray(motion.stiffness, float), np.asarray(motion.give, float)
    errors = [wandering(rng, np.hypot(FORCE_ERROR[0], ANGLE_ERROR * c), LASTS, count) for c in stiffness]
    tilt = wandering(rng, 0.02, 40.0 / SPEED, count)
    velocity, used = np.zeros(count), np.zeros(count)
    for i in range(count):
        used[i] = (errors[1][i] - stiffness[1] * velocity[i] / SPEED) / (1 + stiffness[1] * give[1])
        if i + 1 < count:
            velocity[i + 1] = velocity[i] + STEP * GRAVITY * (used[i] - tilt[i])
    steer = (used - errors[0]) / stiffness[0] + give[0] * used + velocity / SPEED
    told = used[:, None] + np.stack([wandering(rng, FORCE_ERROR[0], SWIFT, count) for _ in range(2)], axis=1)
    lateral = GRAVITY * used + 0.01 * rng.normal(size=count)
    return jax.vmap(straight)(*map(jnp.asarray, (lateral, told, steer))), velocity


def test_sideslip_is_as_sure_as_a_lasting_error_leaves_it(vehicle: Vehicle) -> None:
    """What a tire errs by for 12 s does not hide that the car slides aside within one."""
    bank = FrictionBank(vehicle, ())
    drives = [driven(bank, seed) for seed in range(SEEDS)]
    touches = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(touch for touch, _ in drives))

    @jax.jit
    @jax.vmap
    def run(touches: Touch) -> tuple[jax.Array, jax.Array]:
        def body(state: BankState, touch: Touch) -> tuple[BankState, tuple[jax.Array, jax.Array]]:
            state, _ = bank.step(state, touch, jnp.asarray(STEP))
            mean, std = bank.merged(state)
            return state, (mean[V_Y], std[V_Y])

        return jax.lax.scan(body, bank.init(), touches)[1]

    mean, std = map(np.asarray, run(touches))
    late = np.arange(mean.shape[1]) * STEP > 5
    off = ((mean - np.stack([velocity for _, velocity in drives])) / std)[:, late]
    assert np.sqrt(np.mean(std[:, late] ** 2)) < 0.04
    assert 0.4 < np.mean(off**2) < 1.3
    assert 0.9 < np.mean(np.abs(off) < 1.96) <= 1
