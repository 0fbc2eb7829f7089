"""How the body pitches, from the rate about its lateral axis: what lets a slope be followed at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from roadstate.estimators.base import Sample, leaf
from roadstate.estimators.gyroscope import Gyroscope
from roadstate.linalg import root, rss

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_UNSEEN = 0.05  # rad/s/√Hz: of a pitch rate that nothing tells
_ROLL_ERROR = 0.004  # rad: 1σ of the body's roll beyond what bank and roll gradient say, for _ROLL_TIME
_ROLL_TIME = 1.0  # s
_ODD_TIME = 0.5  # s: low pass of how far attitude and slope are apart
_ODD = 0.006  # rad: so far apart they are only when the gyroscope fails
_UNEVEN = (0.013, 2.7)  # rad by which they are where unevenness lasts, and m/s beyond which it averages out
_SURE = 4.0  # 1σ of what is expected to part them, that many times
# the same of the speeds' innovations over their 1σ, when the gyroscope pulls the slope away: at the least,
# and over what the low pass leaves of a noise that all speeds have in common
_PULL = (0.4, 4.0)
# the same: from which on speeds go along with the attitude, or against it; and s for which neither may be
_ALONG, _AGAINST, _PARTED = 0.04, 0.25, 0.8
_MOST = (0.1, 3.0)  # rad, and 1σ of speeds, that one sample may count for
_ASIDE = 3.0  # m/s² of lateral acceleration beyond which wheels slip for reasons of their own
_DISTRUST = 20.0  # s for which a gyroscope that failed is not believed
_LEAN_ERROR = 0.0015  # rad: 1σ of the body's pitch against slope and force: it swings, and roads are uneven
_LEAN_TIME = 0.15  # s: how long that lasts
_STEADY_TIME = 0.5  # s: low pass of the rate, besides which a body swings
_SWING_TIME = 0.15  # s over which that adds up to an angle
_UNREST_TIME = 2.0  # s over which that is averaged
_LEAST_STEP = 1e-3  # s


class PitchState(NamedTuple):
    """State of a :class:`PitchMeter`.

    Attributes:
        gyro: what has come of the pitch rate.
        apart: low-passed difference of attitude and slope, rad.
        pull: low-passed innovation of the speeds over its 1σ.
        parted: s for which these are too far apart, and speeds do not go along with the attitude.
        distrust: s for which the gyroscope is still not believed.
        steady: low-passed rate, rad/s.
        swing: angle by which the body swings besides, rad.
        unrest: its mean square, rad².
        heard: s of samples since the first, or since the last gap.
    """

    gyro: Gyroscope
    apart: Float[Array, ""]
    pull: Float[Array, ""]
    parted: Float[Array, ""]
    distrust: Float[Array, ""]
    steady: Float[Array, ""]
    swing: Float[Array, ""]
    unrest: Float[Array, ""]
    heard: Float[Array, ""]


class Pitching(NamedTuple):
    """What turns the body about its lateral axis.

    Attributes:
        rate: nose-up rate of the body against the horizon, freed of yaw, rad/s.
        intensity: of its white error, rad/s/√Hz.
    """

    rate: Float[Array, ""]
    intensity: Float[Array, ""]


class PitchMeter(eqx.Module):
    """The body's nose-up rate Θ̇ = (ψ̇ sin φ − q)/cos φ from the rate q about its lateral axis (ISO 8855).

    φ is the body's roll, by the road's bank and the vehicle file's roll gradient.
    """

    _noise: Float[Array, ""]
    _roll_gradient: Float[Array, ""]

    def __init__(self, vehicle: Vehicle) -> None:
        # the axes of one sensor are alike: the file knows the yaw rate's
        self._noise = leaf(vehicle.sensors.yaw_rate.noise)
        self._roll_gradient = leaf(vehicle.body.roll_gradient)

    def init(self) -> PitchState:
        """Nothing has come yet."""
        zero = jnp.zeros(())
        return PitchState(Gyroscope.silent(), *[zero] * 8)

    def read(
        self,
        state: PitchState,
        sample: Sample,
        turning: Float[Array, ""],
        across: Float[Array, ""],
        bank: Float[Array, " 2"],
        dt: Float[Array, ""],
    ) -> tuple[PitchState, Pitching]:
        """Take a sample ``dt`` after the last.

        Args:
            state: from :meth:`init` or the last call.
            sample: with ``pitch_rate``.
            turning: yaw rate, rad/s.
            across: lateral specific force, freed of roll, m/s².
            bank: of the road and its 1σ, rad.
            dt: s.
        """
        seen = jnp.isfinite(sample["pitch_rate"])
        meanwhile = state.gyro.goes_on(dt)
        gyro = state.gyro.take(sample["pitch_rate"], dt)
        known = gyro.is_known() & meanwhile & (state.distrust <= 0)
        between = gyro.between(state.gyro)
        roll = jnp.clip(bank[0] + self._roll_gradient * across, -0.5, 0.5)
        nose_up = (turning * jnp.sin(roll) - between) / jnp.cos(roll)
        unsure = jnp.abs(turning) * rss(bank[1], _ROLL_ERROR) * (2 * _ROLL_TIME) ** 0.5
        told = Pitching(
            rate=jnp.where(known, nose_up, 0.0),
            intensity=jnp.where(known, rss(self._noise * root(gyro.every), unsure), _UNSEEN),
        )
        lately = jnp.where(meanwhile, state.heard, 0.0)
        heard = jnp.where(meanwhile, lately + jnp.where(seen, dt, 0.0), 0.0)
        step = jnp.maximum(dt, _LEAST_STEP)
        share = step / (jnp.minimum(lately, _STEADY_TIME) + step)
        steady = state.steady + share * (gyro.rate.value - state.steady)
        besides = gyro.rate.value - steady
        swing = state.swing * jnp.exp(-dt / _SWING_TIME) + jnp.minimum(dt, _SWING_TIME) * besides
        share = step / (jnp.minimum(lately, _UNREST_TIME) + step)
        unrest = state.unrest + share * (swing**2 - state.unrest)
        return state._replace(gyro=gyro, steady=steady, swing=swing, unrest=unrest, heard=heard), told

    def is_faulty(self, state: PitchState) -> Bool[Array, ""]:
        """Whether samples are refused or contradict the slope."""
        return (state.distrust > 0) | (state.gyro.refused > 0)

    def judge(
        self,
        state: PitchState,
        innovation: Float[Array, ""],
        innovation_std: Float[Array, ""],
        sensor_std: Float[Array, ""],
        speeds: tuple[Float[Array, " k"], Float[Array, " k"]],
        speed: Float[Array, ""],
        across: Float[Array, ""],
        is_excused: Bool[Array, ""],
        dt: Float[Array, ""],
    ) -> PitchState:
        """See whether the attitude that the gyroscope tells still goes with slope and speeds.

        An accelerometer that lags pulls the slope away from the attitude, too, and no gyroscope is to blame;
        nor is it for a body that leans for a while as its axles climb over unevenness, one after the other.
        Where a road bends faster than the filter foresees, at the corner of a steep street, attitude and
        speeds both say that the slope lags; one that fails drags it to where the speeds do not follow.

        Args:
            state: of the same instant.
            innovation: of the attitude, rad.
            innovation_std: as the filter has it.
            sensor_std: the sample's part of it.
            speeds: (k,) innovations of whatever tells the speed, NaN where missing, and their 1σ, m/s.
            speed: m/s.
            across: lateral specific force, m/s².
            is_excused: whether the accelerometer may lag, v_y r, which nobody knows, pass for a slope, or
                wheels' radii for speeds.
            dt: s.
        """
        # one sample alone, of whatever size, is no contradiction that lasts
        gap = jnp.clip(jnp.where(jnp.isfinite(innovation), innovation, state.apart), -_MOST[0], _MOST[0])
        apart = state.apart - jnp.expm1(-dt / _ODD_TIME) * (gap - state.apart)
        expected = root(innovation_std**2 - sensor_std**2)
        heard = jnp.isfinite(speeds[0])
        count = jnp.sum(heard)
        each = jnp.where(heard, speeds[0], 0.0) / speeds[1]
        # a gyroscope pulls them all; the one that is farthest off may be a wheel that is braked alone
        rest = jnp.where(count > 2, jnp.arange(len(each)) != jnp.argmax(jnp.abs(each)), True)
        mean = jnp.sum(jnp.where(rest, each, 0.0)) / jnp.maximum(jnp.where(count > 2, count - 1, count), 1)
        mean = jnp.clip(mean, -_MOST[1], _MOST[1])
        share = -jnp.expm1(-dt / _ODD_TIME)
        told = state.pull + jnp.where(count > 0, share, 0.0) * (mean - state.pull)
        least = _PULL[0] * jnp.maximum(jnp.abs(across) / _ASIDE, 1.0) ** 2
        pulls = jnp.abs(told) > jnp.maximum(least, _PULL[1] * root(share / (2 - share)))
        uneven = _UNEVEN[0] / jnp.sqrt(jnp.maximum(jnp.abs(speed) / _UNEVEN[1], 1.0))
        most = jnp.maximum(jnp.maximum(_ODD, uneven), _SURE * expected)
        # a road that bends faster than foreseen parts attitude and speeds from the slope alike
        along = told * jnp.sign(apart)
        far = jnp.abs(apart) > most
        parted = jnp.where(far & (along < _ALONG), state.parted + dt, 0.0)
        odd = (far & (along < -_AGAINST)) | (parted > _PARTED) | (pulls & (along <= 0))
        # the filter first finds the attitude
        begins = state.heard < _ODD_TIME
        odd = odd & ~is_excused & ~begins
        distrust = jnp.where(odd, _DISTRUST, jnp.maximum(state.distrust - dt, 0.0))
        begin = jnp.where(odd | begins | is_excused, 0.0, 1.0)
        return state._replace(
            apart=begin * apart, pull=begin * told, parted=begin * parted, distrust=distrust
        )


def lean_std(state: PitchState, since: Float[Array, ""]) -> Float[Array, ""]:
    """1σ of a sample of the body's lean against slope and force, so that errors that last add up rightly.

    Args:
        state: of the instant.
        since: s since the sample before.
    """
    return jnp.sqrt((_LEAN_ERROR**2 + state.unrest) * 2 * _LEAN_TIME / since)
