"""The joint estimator's motion along the road: one step of its filter, and what goes into it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core.constants import GRAVITY
from roadstate.core.gaussian import Info
from roadstate.estimators.along import SLOPE, SPEED, AlongInput
from roadstate.estimators.axle_forces import AxleForces
from roadstate.estimators.intake import ACCEL_X, STALE, WHEEL_SPEEDS, YAW_RATE
from roadstate.estimators.joint_reading import Reading
from roadstate.estimators.pitch import PitchState
from roadstate.estimators.radii import RadiiState
from roadstate.estimators.sideways import BANK, V_Y
from roadstate.estimators.tilted_plane import tilting
from roadstate.estimators.wheel_rims import RimState
from roadstate.filters import FilterState
from roadstate.linalg import root, rss

if TYPE_CHECKING:
    from roadstate.estimators.joint import Joint, JointState

_LEAST_STEP = 1e-3  # s
_LATE_TIME = 0.5  # s: how long an error of a late signal lasts
_LAGS = 0.1  # s by which the accelerometer may be late when the gyroscope is no longer judged by it
_DRY = 0.9  # friction of a road on which what wheels slip in a bend is what the gyroscope's judge allows for
_TURNS_HARD = 2.0  # m/s² across at which v_y r, without a yaw rate, may be a slope's part


class Along(NamedTuple):
    """A step of the motion along the road.

    Attributes:
        filter, rims, radii, pitch: states of the parts.
        info: of the filter's step.
        u: its input.
        sideslip: v_y and its 1σ, of which it is part, m/s.
        signal: the speed signal, NaN where none came or there is none, m/s.
        tells: whether anything told the speed.
        stuck: (m,) which of the filter's sensors stand still while the car moves.
    """

    filter: FilterState
    rims: RimState
    radii: RadiiState
    pitch: PitchState
    info: Info
    u: AlongInput
    sideslip: Float[Array, " 2"]
    signal: Float[Array, ""]
    tells: Bool[Array, ""]
    stuck: Bool[Array, " m"]

    @property
    def speed(self) -> Float[Array, ""]:
        """m/s."""
        return self.filter.gaussian.mean[SPEED]

    @property
    def sine(self) -> Float[Array, ""]:
        """Of the road's slope."""
        return self.filter.gaussian.mean[SLOPE] / GRAVITY


def move(
    joint: Joint,
    state: JointState,
    reading: Reading,
    forces: AxleForces,
    across: tuple[Float[Array, " s"], Float[Array, " s"]],
    dt: Float[Array, ""],
) -> Along:
    """A step of the filter of speed and slope.

    Args:
        joint: the estimator.
        state: of it, before this sample.
        reading: of this sample.
        forces: of this instant.
        across: states across the road and their 1σ, before this sample.
        dt: s.
    """
    watch, sample, seen, verdict = reading.watch, reading.sample, reading.seen, reading.verdict
    sideslip = jnp.stack([across[0][V_Y], across[1][V_Y]])
    rims, u, z = joint.inputs.read(
        state, seen, forces, sample, sideslip, dt, verdict.sign(ACCEL_X), reading.way
    )
    steps = joint.watch.step(state.watch, WHEEL_SPEEDS)
    pushed = jnp.where(forces.may_brake, forces.accel[0], 0.0)
    white = joint.contact.white(seen)
    radii = joint.radii.learn(state.radii, seen, u.slip, pushed, u.turning, steps, white, dt)
    signal = z[joint.sensors.index("speed")] if "speed" in joint.sensors else jnp.full((), jnp.nan)
    is_signal = np.array([s == "speed" for s in joint.sensors])
    stuck = jnp.asarray(is_signal) & joint.watch.is_stuck(watch, state.along.gaussian.mean[SPEED])
    z = jnp.where(verdict.lies[-1] & is_signal | stuck, jnp.nan, z)
    lag, since = joint.watch.lateness(watch, joint.sensors), joint.watch.since(watch, joint.sensors)
    lasting = jnp.sqrt(_LATE_TIME / jnp.clip(since, _LEAST_STEP, _LATE_TIME))
    alike = root(joint.watch.alike(watch, joint.sensors))
    u = u._replace(sensor_std=rss(alike * u.sensor_std, lag * u.gaining * lasting))
    bank = jnp.stack([across[0][BANK], across[1][BANK]])
    u = u._replace(tilting=tilting(u.speed, u.turning, bank, joint.bank.motion.offset))
    pitch = state.pitch
    if "attitude" in joint.sensors:
        pitch, pitching = joint.pitch.read(pitch, sample, u.turning, u.smooth_across, bank / GRAVITY, dt)
        u = u._replace(pitching=pitching)
        is_attitude = np.array([s == "attitude" for s in joint.sensors])
        z = jnp.where(is_attitude & (pitch.gyro.rate.age > 0), jnp.nan, z)
    along, info = joint.filter.step(joint.along, state.along, u, z, dt)
    speeds = np.array([s == "speed" or s in WHEEL_SPEEDS for s in joint.sensors])
    if "attitude" in joint.sensors:
        row, rows = joint.sensors.index("attitude"), jnp.asarray(np.flatnonzero(speeds))
        seems = info.innovation[row], root(info.S[row, row]), u.sensor_std[row]
        pull = info.innovation[rows], root(jnp.diagonal(info.S)[rows])
        late = joint.watch.lateness(watch, ("accel_x",))[0] > _LAGS
        unknown = (seen.age[YAW_RATE] >= STALE) & (jnp.abs(u.smooth_across) > _TURNS_HARD)
        excused = late | unknown | reading.slides | ~joint.radii.is_known(radii)
        # where there is less friction, less makes wheels slip
        hard = u.smooth_across * jnp.maximum(_DRY / state.friction[1, 0], 1.0)
        moves = along.gaussian.mean[SPEED], hard, excused
        pitch = joint.pitch.judge(pitch, *seems, pull, *moves, dt)
    tells = jnp.any(jnp.isfinite(z) & speeds)
    return Along(along, rims, radii, pitch, info, u, sideslip, signal, tells, stuck)
