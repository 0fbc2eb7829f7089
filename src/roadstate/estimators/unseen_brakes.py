"""Brakes that no channel tells of, as what is missing betrays them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from roadstate.estimators.signals import Held

if TYPE_CHECKING:
    from roadstate.estimators.traction import Traction

_BRAKE_LAG = 0.3  # s: filter of the acceleration that betrays a brake
_BRAKE_SIGN = 0.8  # m/s²: missing specific force that betrays a brake while the engine pulls
_BRAKE_SIGN_COASTING = 0.3  # m/s²: the same with the pedal released, when a brake is likely
_COASTING = 0.4  # m/s²: drive below which the pedal counts as released
# m/s² missing of late, s, with the pedal released: a brake that has just begun, and not a road that shakes
_SUDDEN = (0.5, 0.02)
_PULLS = (0.1, 0.5)  # m/s², s: so much drive for so long and the foot is not on the brake


class UnseenBrakes(NamedTuple):
    """What brakes may do that no channel tells of.

    Attributes:
        act: they do.
        may_act: they do, or there is no telling.
    """

    act: Bool[Array, ""]
    may_act: Bool[Array, ""]


class BrakeWatch(NamedTuple):
    """Betrays brakes that no channel tells of: specific force is what tires and air do, whatever the slope.

    Attributes:
        missing: low-passed specific force (m/s²) that is there beyond what the drive explains, in the
            direction of travel.
        now: the same of the last moments.
        coasting: whether the drive hardly pulls.
        pulled: s for which it has pulled so that nobody brakes; once it was long enough, it stays so.
    """

    missing: Float[Array, ""]
    now: Float[Array, ""]
    coasting: Bool[Array, ""]
    pulled: Float[Array, ""]

    @classmethod
    def none(cls) -> BrakeWatch:
        """Before the first sample."""
        zero = jnp.zeros(())
        return cls(zero, zero, zero > 0, zero)

    def take(
        self,
        accel: Held,
        explained: Float[Array, ""],
        push: Float[Array, ""],
        forward: Float[Array, ""],
        dt: Float[Array, ""],
    ) -> BrakeWatch:
        """A sample later.

        Args:
            accel: specific force, m/s².
            explained: what is known to act makes of it, less what turns up wheels and engine, m/s².
            push: the drive's part, m/s².
            forward: −1 where the car backs up, else 1.
            dt: s.
        """
        push = forward * push
        is_told, lacks = accel.age == 0, forward * (accel.value - explained)
        now, missing = (
            before - jnp.expm1(-dt / lag) * (jnp.where(is_told, lacks, self.missing) - before)
            for before, lag in ((self.now, _SUDDEN[1]), (self.missing, _BRAKE_LAG))
        )
        pulled = jnp.where(jnp.abs(push) > _PULLS[0], self.pulled + dt, 0.0)
        pulled = jnp.where(self.seems, 0.0, pulled)
        return BrakeWatch(
            missing, now, push < _COASTING, jnp.where(self.pulled > _PULLS[1], self.pulled, pulled)
        )

    @property
    def seems(self) -> Bool[Array, ""]:
        """Whether so much is missing that brakes act; released pedals make it likelier."""
        return self.missing < -jnp.where(self.coasting, _BRAKE_SIGN_COASTING, _BRAKE_SIGN)

    @property
    def possible(self) -> Bool[Array, ""]:
        """Whether what is missing may be a brake's all the same, and must not be learnt as a bias.

        It may where it is too sudden for a low pass, and where the log has begun with the pedal released.
        """
        begins = self.coasting & (self.now < -_SUDDEN[0])
        return begins | (self.pulled <= _PULLS[1])

    def unseen(self, drive: Traction, knows_brakes: bool, felt: Bool[Array, ""]) -> UnseenBrakes:
        """Verdict on brakes that no channel tells of.

        Args:
            drive: what torques and pedals tell.
            knows_brakes: whether any brake channel is there.
            felt: whether the accelerometer tells anything.
        """
        act = drive.is_brake_unknown | (self.seems & felt & (not knows_brakes))
        return UnseenBrakes(act, act | (self.possible & (not knows_brakes)))
