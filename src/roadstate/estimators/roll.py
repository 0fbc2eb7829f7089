"""How the road's bank changes, from the rate about the body's longitudinal axis."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from roadstate.core.constants import GRAVITY
from roadstate.estimators.base import Sample, leaf
from roadstate.estimators.gyroscope import Gyroscope
from roadstate.estimators.intake import ACCEL_Y, STALE, YAW_RATE, Signals
from roadstate.estimators.roll_check import APART_TIME, GRADIENT_ERROR, RollCheck, Tilting
from roadstate.linalg import root, rss

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_LEAN_TIME = 0.3  # s for which the roll gradient errs alike
_SWING_TIME = 0.15  # s for which the body swings to one side
_SWIFTEST = 0.4  # rad/s: no faster does a road bank under a car
_BIAS_TIME = 60.0  # s over which the rate averages out, but for the gyroscope's bias
_BANKED = 0.08  # rad: 1σ of what a road's bank changes by altogether
_STEADY_TIME = 0.5  # s: low pass of the rate, besides which a body swings
_SLOWEST = 5.0  # m/s
_SELDOM = 0.02  # s from sample to sample
_DISTRUST = 20.0  # s for which a gyroscope that failed is not believed
_LEAST_STEP = 1e-3  # s
_LEAST_BIAS = 1e-4  # rad/s


class RollState(NamedTuple):
    """State of a :class:`RollMeter`.

    Attributes:
        gyro: what has come of the roll rate.
        bias: its mean, rad/s.
        heard: s of samples, at most :data:`_BIAS_TIME`.
        steady: low-passed rate, rad/s.
        unrest: mean square of what the body swings besides, rad²/s².
        check: what the rate adds up to, against the lateral accelerometer.
        distrust: s for which the gyroscope is still not believed.
    """

    gyro: Gyroscope
    bias: Float[Array, ""]
    heard: Float[Array, ""]
    steady: Float[Array, ""]
    unrest: Float[Array, ""]
    check: RollCheck
    distrust: Float[Array, ""]


class RollMeter(eqx.Module):
    """Rate of the road's bank φ̇ = p − r sin θ − k ȧ_y of the roll rate p (ISO 8855), with θ the slope.

    The body leans outward by k a_y besides, k the vehicle file's roll gradient. What p averages to over a
    minute is the gyroscope's bias: no road banks for ever. What it adds up to is held against what a bank
    does to the lateral accelerometer (:mod:`~roadstate.estimators.roll_check`): where the two part for good,
    it fails.
    """

    _noise: Float[Array, ""]
    _bias: Float[Array, ""]
    _gradient: Float[Array, ""]
    _arm: Float[Array, ""]
    _stiffness: Float[Array, ""]

    def __init__(self, vehicle: Vehicle) -> None:
        # the axes of one sensor are alike: the file knows the yaw rate's
        self._noise = leaf(vehicle.sensors.yaw_rate.noise)
        self._bias = jnp.maximum(leaf(vehicle.sensors.yaw_rate.bias), _LEAST_BIAS)
        self._gradient = leaf(vehicle.body.roll_gradient)
        self._arm = leaf(vehicle.geometry.cg_to_rear_axle)
        self._stiffness = leaf(vehicle.tires.cornering_stiffness_rear)

    def init(self) -> RollState:
        """Nothing has come yet."""
        zero = jnp.zeros(())
        return RollState(Gyroscope.silent(), zero, zero, zero, zero, RollCheck.none(), zero)

    def read(
        self,
        state: RollState,
        sample: Sample,
        seen: Signals,
        sine: Float[Array, ""],
        speed: Float[Array, ""],
        across: Float[Array, " 2"],
        ahead: Float[Array, " 2"],
        dt: Float[Array, ""],
    ) -> tuple[RollState, Float[Array, " 2"]]:
        """Take a sample ``dt`` after the last.

        Args:
            state: from :meth:`init` or the last call.
            sample: with ``roll_rate``.
            seen: the other signals; specific force across freed of roll.
            sine: of the slope.
            speed: m/s.
            across: v_y at the last sample and its 1σ, m/s.
            ahead: how far the accelerometer sits ahead of the centre of gravity and its 1σ, m.
            dt: s.

        Returns:
            The state, and the bank's rate in rad/s with its white error in rad/s/√Hz, infinite where unknown.
        """
        meanwhile = state.gyro.goes_on(dt)
        gyro = state.gyro.take(sample["roll_rate"], dt)
        compared = (seen.age[ACCEL_Y] < STALE) & (seen.age[YAW_RATE] < STALE)
        turning = jnp.where(seen.age[YAW_RATE] < STALE, seen.smooth[YAW_RATE], 0.0)
        leans = jnp.where(compared, self._gradient * seen.rate[ACCEL_Y], 0.0)
        usable = gyro.is_known() & meanwhile & (state.gyro.rate.age < STALE)
        raw = gyro.between(state.gyro) - turning * sine - leans
        step = jnp.clip(dt, _LEAST_STEP, STALE)
        heard = jnp.minimum(state.heard + jnp.where(usable, step, 0.0), _BIAS_TIME)
        counts = heard + _BANKED / self._bias
        learns = jnp.where(usable, step / counts, 0.0)
        bias = state.bias + learns * jnp.clip(raw - state.bias, -_SWIFTEST, _SWIFTEST)
        rate = jnp.clip(raw - bias, -_SWIFTEST, _SWIFTEST)
        keep = jnp.where(usable, -jnp.expm1(-step / _STEADY_TIME), 0.0)
        steady = state.steady + keep * (rate - state.steady)
        unrest = state.unrest + keep * ((rate - steady) ** 2 - state.unrest)
        yaw_accel = jnp.where(compared, seen.rate[YAW_RATE], 0.0)
        tilt = (seen.smooth[ACCEL_Y] - speed * turning - ahead[0] * yaw_accel) / GRAVITY
        # a car that hardly moves rocks on its tires
        tells = compared & usable & (jnp.abs(speed) > _SLOWEST)
        # v_y = r (l_r − v²/gC) in a steady turn; near the limit the rear axle's C is less by half
        swerves = jnp.abs(yaw_accel) * (self._arm + 2 * speed**2 / (GRAVITY * self._stiffness))
        unsure = ahead[1] * jnp.abs(yaw_accel) / GRAVITY
        told = Tilting(rate, leans, tilt, unsure, seen.lag[ACCEL_Y], across, swerves, tells)
        check = state.check.goes_on(told, step)
        # what swings between samples that come seldom adds up at random
        missed = unrest * jnp.maximum(gyro.every - _SELDOM, 0.0) * APART_TIME / 2
        odd = check.is_odd(root(missed))
        distrust = jnp.where(odd, _DISTRUST, jnp.maximum(state.distrust - dt, 0.0))
        biased = _BANKED / counts * (2 * APART_TIME) ** 0.5
        swings = root(unrest * 2 * _SWING_TIME)
        lags = GRADIENT_ERROR * leans * (2 * _LEAN_TIME) ** 0.5
        white = rss(self._noise * root(gyro.every), swings, lags, biased)
        known = usable & (distrust <= 0)
        new = RollState(gyro, bias, heard, steady, unrest, check.anew(odd), distrust)
        return new, jnp.stack([jnp.where(known, rate, 0.0), jnp.where(known, white, jnp.inf)])

    def contradicts(self, state: RollState) -> Bool[Array, ""]:
        """Whether it has just turned out that either the gyroscope or the lateral accelerometer fails."""
        return state.distrust >= _DISTRUST

    def is_faulty(self, state: RollState) -> Bool[Array, ""]:
        """Whether samples are refused or contradict the lateral accelerometer."""
        return (state.distrust > 0) | (state.gyro.refused > 0)
