"""How often forces are weighed: no more often than what is told of them can change."""

from __future__ import annotations

from typing import NamedTuple, Self, cast

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from roadstate.estimators import slip_jump
from roadstate.estimators.friction_bank import BankState, FrictionBank
from roadstate.estimators.sideways import BANK, BIAS_Y, V_Y, Touch

SELDOM = 0.0145
"""s that pass at least between two samples that are weighed.

Forces and slips are low-passed to some 3 Hz, so that of 100 samples in a second every other one tells what
there is to tell, unless a wheel's slip changes. No multiple of a usual step, which a clock's jitter would be
now above, now below.
"""
_JUMPED = (0.004, 0.05)
"""Difference of what a wheel slips beyond its force from what is remembered of it that is weighed at once: by
itself, and m/s over the speed.

A wheel that comes onto ice is caught within a few samples, before it slips so far that a controller steps in:
what each of them adds to the evidence is limited, so that every other one would find the ice 40 ms later. A
wheel's noise at 100 Hz seldom makes as much.
"""
_SLOW = 1.0  # m/s


class Pace(NamedTuple):
    """What has gone by since forces were last weighed.

    Attributes:
        since: s.
        push: ∫ (a_y − v_x r) dt since then, m/s: by so much v_y has grown, but for the bank and biases.
    """

    since: Float[Array, ""]
    push: Float[Array, ""]

    @classmethod
    def start(cls) -> Self:
        """Nothing."""
        return cls(jnp.zeros(()), jnp.zeros(()))

    def weigh(
        self, bank: FrictionBank, state: BankState, touch: Touch, dt: Float[Array, ""]
    ) -> tuple[Self, BankState, Float[Array, ""]]:
        """:meth:`FrictionBank.step`, where it is time for it: the log-likelihood is 0 elsewhere."""
        turning = touch.speed * touch.yaw_rate
        waits = self._replace(since=self.since + dt, push=self.push + dt * (touch.accel_y - turning))

        def due(waits: Self, state: BankState) -> tuple[Self, BankState, Array]:
            mean = waits.push / jnp.where(waits.since > 0, waits.since, 1.0)
            return self.start(), *bank.step(state, touch._replace(accel_y=mean + turning), waits.since)

        def early(waits: Self, state: BankState) -> tuple[Self, BankState, Array]:
            return waits, state, jnp.zeros(())

        now = (waits.since > SELDOM) | _jump(bank, state, touch)
        return cast("tuple[Self, BankState, Array]", jax.lax.cond(now, due, early, waits, state))

    def merged(self, bank: FrictionBank, state: BankState) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """:meth:`FrictionBank.merged`, with the v_y of now."""
        mean, std = bank.merged(state)
        return mean.at[V_Y].add(self.push - self.since * (mean[BANK] + mean[BIAS_Y])), std


def _jump(bank: FrictionBank, state: BankState, touch: Touch) -> Bool[Array, ""]:
    """Whether wheels slip otherwise than a moment ago."""
    speed = jnp.maximum(jnp.abs(touch.speed), _SLOW)
    memory = state.level[10:]
    jump = jnp.abs(slip_jump.unexplained(touch, bank.wheels.slip_stiffness) - memory)
    return jnp.any((memory < slip_jump.NOTHING) & (jump > jnp.maximum(_JUMPED[0], _JUMPED[1] / speed)))
