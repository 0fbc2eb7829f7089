"""Whether a roll rate goes with what a road's bank does to the lateral accelerometer."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from roadstate.core.constants import GRAVITY

GRADIENT_ERROR = 0.3
"""1σ of the roll gradient, as a share; and of how swiftly the body follows it."""
APART_TIME = 4.0
"""s for which what the rate adds up to is compared with what a bank does to accel_y."""
_APART = 0.08  # rad: so far apart they are only when one of them fails
_BRIEF = 0.2  # s of a difference that means nothing: tires shake a car sideways
_SURE = 5.0  # 1σ of what is added up, that many times
_SLIDES = (0.06, 0.8, 1.0)  # m/s: what 1σ of v_y has beyond, counts; rad per m/s of it; s for which
_DRIFTS = (0.5, 1.0)  # m/s²: v̇_y of a car that turns evenly, at most; s for which it may still swerve
_LEAPS = (0.3, 10.0)  # m/s, and m/s²: no car's v_y changes by more from one sample to the next
_FOUND = 0.3  # s that it takes to find v_y where nothing told of it before
_PLACES = 2.0  # 1σ of what the accelerometer's place does, that many times
_UNKNOWN = 0.25  # m/s: with a larger 1σ v_y changes because it is being found, not because the car swerves


class Swerve(NamedTuple):
    """How the car's sideslip changes.

    Attributes:
        v_y: as it was told last, m/s.
        unsure: 1σ of it, at most, of late, m/s.
        most: |v̇_y| at most, of late, of a car that turns as this one does, m/s².
        late: v_y as late as the low-passed lateral specific force, m/s.
        rate: its derivative, m/s².
        anew: s for which v_y may still be being found, after nothing told of it.
        leaps: whether v_y has changed as no car's does, or has not been known of late.
    """

    v_y: Float[Array, ""]
    unsure: Float[Array, ""]
    most: Float[Array, ""]
    late: Float[Array, ""]
    rate: Float[Array, ""]
    anew: Float[Array, ""]
    leaps: Bool[Array, ""]

    @classmethod
    def none(cls) -> Swerve:
        """Nothing has been told."""
        zero = jnp.zeros(())
        return cls(zero, zero, zero, zero, zero, zero, jnp.asarray(False))

    def goes_on(self, told: Tilting, step: Float[Array, ""]) -> Swerve:
        """With a sample, ``step`` after the last, s."""
        v_y, unsure = told.across[0], jnp.maximum(told.across[1], self.unsure * jnp.exp(-step / _SLIDES[2]))
        most = jnp.maximum(_DRIFTS[0] + told.swerves, self.most * jnp.exp(-step / _DRIFTS[1]))
        anew = jnp.where(told.tells, jnp.maximum(self.anew - step, 0.0), _FOUND)
        leaps = (jnp.abs(v_y - self.v_y) > _LEAPS[0] + _LEAPS[1] * step) | (unsure > _UNKNOWN) | (anew > 0)
        # a difference is half a step late by itself
        share = 1 / jnp.maximum(told.lag / step + 0.5, 1.0)
        follows = jnp.where(leaps, 0.0, share * (v_y - self.late))
        # a v_y that changes while the car does not swerve follows an accelerometer that lies
        rate = jnp.clip(follows / step, -most, most)
        late = jnp.where(leaps, v_y, self.late + follows)
        return Swerve(v_y, unsure, most, late, rate, anew, leaps)


class Tilting(NamedTuple):
    """What a sample tells of a bank.

    Attributes:
        rate: of the bank, by the gyroscope, rad/s.
        leans: rate at which the body leans besides, rad/s.
        tilt: what a bank would have to be to make the lateral specific force of a car whose v_y does not
            change, rad.
        unsure: 1σ of it by the accelerometer's place, rad.
        lag: s by which that is late.
        across: v_y at the last sample and its 1σ, m/s.
        swerves: |v̇_y| at most of a car whose yaw rate changes as this one's, m/s².
        tells: whether all that is known.
    """

    rate: Float[Array, ""]
    leans: Float[Array, ""]
    tilt: Float[Array, ""]
    unsure: Float[Array, ""]
    lag: Float[Array, ""]
    across: Float[Array, " 2"]
    swerves: Float[Array, ""]
    tells: Bool[Array, ""]


class RollCheck(NamedTuple):
    """What the roll rate adds up to, against the lateral accelerometer: a_y − v_x r − v̇_y = g φ.

    v_y is what the tires tell (in a swerve v̇_y reaches .2 g), a sample later than the rest.

    Attributes:
        swerve: of the car, as of the sample before.
        tilt: of the last :class:`Tilting`.
        tells: whether that told all it could.
        gap: by how much more the rate has added up to than the tilt has changed since the sample before, rad.
        apart: the same of late, and of a car whose v_y may change, rad.
        lasting: that, low-passed.
        leant: by how much the body has leant besides, of late, rad.
        most_leant: the largest amount of that, of late, rad.
        place: 1σ of what the accelerometer's place adds to the tilt, at most of late, rad.
    """

    swerve: Swerve
    tilt: Float[Array, ""]
    tells: Bool[Array, ""]
    gap: Float[Array, ""]
    apart: Float[Array, ""]
    lasting: Float[Array, ""]
    leant: Float[Array, ""]
    most_leant: Float[Array, ""]
    place: Float[Array, ""]

    @classmethod
    def none(cls) -> RollCheck:
        """Nothing has been told."""
        zero = jnp.zeros(())
        return cls(Swerve.none(), zero, jnp.asarray(False), zero, zero, zero, zero, zero, zero)

    def goes_on(self, told: Tilting, step: Float[Array, ""]) -> RollCheck:
        """With a sample, ``step`` after the last, s."""
        swerve = self.swerve.goes_on(told, step)
        swerves = (swerve.rate - self.swerve.rate) / GRAVITY
        counts = self.tells & ~swerve.leaps & ~self.swerve.leaps
        gap = told.rate * step - (told.tilt - self.tilt)
        keep = jnp.exp(-step / APART_TIME)
        apart = (self.apart + jnp.where(counts, self.gap + swerves, 0.0)) * keep
        lasting = self.lasting - jnp.expm1(-step / _BRIEF) * (apart - self.lasting)
        leant = (self.leant + told.leans * step) * keep
        most = jnp.maximum(jnp.abs(leant), self.most_leant * keep)
        place = jnp.maximum(told.unsure, self.place * keep)
        return RollCheck(swerve, told.tilt, told.tells, gap, apart, lasting, leant, most, place)

    def is_odd(self, error: Float[Array, ""]) -> Bool[Array, ""]:
        """Whether the two are too far apart, if what is added up errs by ``error``, 1σ in rad."""
        slides = _SLIDES[1] * jnp.maximum(self.swerve.unsure - _SLIDES[0], 0.0)
        leans = GRADIENT_ERROR * self.most_leant
        return jnp.abs(self.lasting) > _APART + slides + leans + _PLACES * self.place + _SURE * error

    def anew(self, is_odd: Bool[Array, ""]) -> RollCheck:
        """The same, but for what was found if it was odd."""
        apart, lasting = (jnp.where(is_odd, 0.0, part) for part in (self.apart, self.lasting))
        return self._replace(apart=apart, lasting=lasting)
