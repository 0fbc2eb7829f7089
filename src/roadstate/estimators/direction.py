"""Which way a car sets off whose wheels turn without a sign and which no gear makes go backward."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core.gaussian import Gaussian
from roadstate.estimators.along import BIAS, SLOPE, SPEED
from roadstate.estimators.base import Sample, leaf
from roadstate.estimators.intake import ACCEL_X, FASTEST_BACKWARD, SPIN, STALE, WHEEL_SPEEDS, Signals
from roadstate.estimators.signals import signed_direction
from roadstate.linalg import root

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_STANDS = (0.3, 1.5)  # m/s: of wheels, and of the filter beside them, below which a car may set off anew
_DEAD_BAND = 0.3  # m/s: 1σ of the speed with which wheels begin to tell
_CREEPS = 1.5  # s: a car moves as long before its wheels tell
_SETTLED = 0.15  # m/s²: 1σ of what it reads at rest, below which that is known
_UNSEEN = 2.0  # m/s²: 1σ of an acceleration that nothing tells
_UNEVEN = 0.1  # m/s²: 1σ of what the slope is another by within the first metres
# evidence (natural logarithm of the odds): that a car sets off forward before anything is known, and in a
# forward gear (it may roll back on a slope); beyond which one way is taken for sure; below which wheels are
# left out until then
_PRIOR, _GEARED, _SURE, _WITHHELD = 3.0, 6.0, 3.0, 2.0
_FITS = 3.0  # σ by which wheels and accelerometer may differ to be of one motion
_SET_OFF = 3.0  # m/s at which the question is over
_ROLLS_BACK = 4.0  # m/s: no car rolls back faster in a forward gear


class DirectionState(NamedTuple):
    """State of a :class:`Direction`.

    Attributes:
        velocity: since the wheels last stood, and shortly before, by the accelerometer, m/s.
        variance: of that.
        since: s since then.
        rest, rest_std: what the accelerometer reads on this slope in a car at rest, and 1σ, m/s².
        is_open: whether the car may go either way.
        backs: whether it was found to back up.
        has_sign: whether a wheel ever turned backward, so that its sign tells the way.
    """

    velocity: Float[Array, ""]
    variance: Float[Array, ""]
    since: Float[Array, ""]
    rest: Float[Array, ""]
    rest_std: Float[Array, ""]
    is_open: Bool[Array, ""]
    backs: Bool[Array, ""]
    has_sign: Bool[Array, ""]

    def is_refuted(self, before: DirectionState) -> Bool[Array, ""]:
        """Whether just now it turns out that the car has not backed up, as it seemed ``before``."""
        return before.backs & ~self.backs & ~self.is_open


class Direction(eqx.Module):
    """Gives unsigned wheel speeds the sign of the motion: that of reverse, or else of how the car set off.

    Once the wheels stand, what the accelerometer reads beyond the slope's share and its bias, summed up, is
    the velocity v, 1σ = s; the wheels tell a speed of n. Whether they turn forward or backward are two
    hypotheses with errors n ∓ v, whose evidence differs by ((n + v)² − (n − v)²)/2s² = 2 n v/s². Forward is
    what counts until the evidence is against it; from there until it is overwhelming the wheels count as
    missing, and what the filter predicts without them is all there is.

    Attributes:
        wheels: channels of the wheels.
        radius: m.
        shifts: whether there are several gears: an electric car's single one turns its motor backward.
    """

    wheels: tuple[str, ...] = eqx.field(static=True)
    radius: Float[Array, ""]
    shifts: Bool[Array, ""]

    def __init__(self, vehicle: Vehicle, available: Collection[str]) -> None:
        self.wheels = tuple(w for w in WHEEL_SPEEDS if w in available)
        self.radius = leaf(vehicle.wheels.radius)
        self.shifts = jnp.asarray(len(vehicle.driveline.gear_ratios) > 1)

    def init(self) -> DirectionState:
        """Forward, as far as is known: a log may begin at any speed."""
        zero, no = jnp.zeros(()), jnp.zeros((), bool)
        return DirectionState(zero, zero, zero, zero, zero, no, no, no)

    def turn(
        self,
        state: DirectionState,
        raw: Signals,
        sample: Sample,
        gear: Float[Array, ""],
        along: Gaussian,
        sign: Float[Array, ""],
        dt: Float[Array, ""],
    ) -> tuple[DirectionState, Signals, Float[Array, ""]]:
        """The signals with the wheels turned as the car goes, and what to multiply an unsigned speed by.

        That is −1 where the car backs up, NaN where wheels are left out because it is not known.

        Args:
            state: from :meth:`init` or the last call.
            raw: of this instant, wheels turned by the gear alone.
            sample: the channels.
            gear: latest ratio; 0 where none was told.
            along: of the filter, before this sample.
            sign: by which the longitudinal accelerometer is to be multiplied.
            dt: s.
        """
        by_gear = signed_direction(gear)
        if not self.wheels:
            return state, raw, by_gear
        has_sign = state.has_sign
        for wheel in self.wheels:
            has_sign = has_sign | (self.radius * sample[wheel] < -_STANDS[0])
        told = raw.age[SPIN] < STALE
        rims = self.radius * jnp.abs(jnp.where(told, raw.value[SPIN], 0.0))
        speed = jnp.sum(rims) / jnp.maximum(jnp.sum(told), 1)
        stands = jnp.any(told) & (speed < _STANDS[0]) & (jnp.abs(along.mean[SPEED]) < _STANDS[1])
        row = np.isin(np.arange(len(along.mean)), (SLOPE, BIAS)).astype(float)
        rest_std = jnp.where(stands, root(jnp.sum((row @ along.factor) ** 2) + _UNEVEN**2), state.rest_std)
        # of a car that creeps while its wheels still read 0 the filter believes that it stands on a slope
        settled = rest_std < _SETTLED
        arrives = stands & ~state.is_open
        slowly = jnp.where(settled & ~arrives, -jnp.expm1(-dt / _CREEPS), 1.0)
        rest = jnp.where(stands, state.rest + slowly * (row @ along.mean - state.rest), state.rest)
        felt = raw.age[ACCEL_X] < STALE
        gain = jnp.where(felt, sign * raw.value[ACCEL_X] - rest, 0.0)
        since = jnp.where(stands, 0.0, state.since + dt)
        velocity = (state.velocity + gain * dt) * jnp.where(stands, jnp.exp(-dt / _CREEPS), 1.0)
        velocity = jnp.where(arrives | (stands & ~settled), along.mean[SPEED], velocity)
        unseen = jnp.where(felt, 0.0, _UNSEEN**2 * dt)
        variance = jnp.where(stands, _DEAD_BAND**2, state.variance + unseen)
        total = variance + (rest_std * since) ** 2
        geared = (gear > 0) & self.shifts
        prior = jnp.where(geared, _GEARED, _PRIOR)
        evidence = prior + 2 * speed * velocity / jnp.maximum(total, _DEAD_BAND**2)
        fits = (speed + velocity) ** 2 < _FITS**2 * total
        known = has_sign | (gear < 0)
        is_open = (stands | state.is_open) & ~known
        found = is_open & (evidence < -_SURE) & fits
        fastest = jnp.where(geared, _ROLLS_BACK, FASTEST_BACKWARD)
        backs = (found | (state.backs & ~stands)) & ~known & (speed < fastest)
        is_open = is_open & ~found & (evidence < prior + _SURE) & (speed < _SET_OFF)
        withheld = is_open & (evidence < _WITHHELD)
        way = jnp.where(backs, -1.0, 1.0)
        new = DirectionState(velocity, variance, since, rest, rest_std, is_open, backs, has_sign)
        return new, _turned(raw, way, withheld), jnp.where(withheld, jnp.nan, by_gear * way)


def _turned(raw: Signals, way: Float[Array, ""], withheld: Bool[Array, ""]) -> Signals:
    """Signals with the wheels' speeds multiplied by ``way``, or counted as missing."""
    is_wheel = np.arange(8) >= SPIN.start
    factor = jnp.where(is_wheel, way, 1.0)
    missing = withheld & is_wheel
    age = jnp.where(missing, jnp.maximum(raw.age, 2 * STALE), raw.age)
    return raw.scaled(factor)._replace(age=age, is_fresh=raw.is_fresh & ~missing)
