"""What the road does to the tires of each axle, and what is known beside it."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from roadstate.estimators.load_transfer import Lean
from roadstate.estimators.signals import STANDSTILL_SPEED
from roadstate.linalg import rss

LEAST_FORCE = 10.0
"""N by which an axle or a wheel without torque shares in what torques err."""
_PARKED = (0.06, 0.4)  # of the load; and besides, times the square of how far wheels locked


class Current(NamedTuple):
    """Forces as they are at this instant, noisier than low-passed ones.

    Attributes:
        along: (2,) F_x of the axles, in their wheels' frames, N.
        told: (2,) the same as torques alone tell it, N.
        across: (2,) F_y of the axles, N.
        load: (4,) of the wheels, N.
        yaw_accel: rad/s².
    """

    along: Float[Array, " 2"]
    told: Float[Array, " 2"]
    across: Float[Array, " 2"]
    load: Float[Array, " 4"]
    yaw_accel: Float[Array, ""]


class AxleForces(NamedTuple):
    """Forces on a car of exactly the file's mass.

    Attributes:
        along: (4,) F_x of the wheels in their own frames, N.
        across: (2,) F_y of the axles in their wheels' frames, N.
        load: (4,) N.
        steady: (4,) F_x of wheels that turned as the car moves: free of the noise of their speeds, N.
        told: (4,) F_x of the wheels as torques alone tell them, N.
        now: what of it is wanted without the low pass's lag.
        stir: (2, 2) by how much the axles' F_x and F_y were ahead of the low pass lately, at most, N.
        jolt: (4,) the same of the wheels' F_x, N.
        locking: how far brakes have locked wheels of late, or drive has spun them: by how much the rim of one
            gained on the car at most, over g, no more than 1; of a car that brakes hold, as it stopped.
        shaken: (2,) root mean square of what the road shakes the accelerometers by, m/s².
        along_std, across_std: (4,), (2,) 1σ over load, beyond what every such measurement errs; infinite
            where nothing tells.
        load_std: (2,) 1σ of what all loads are off by together, as a share: where the road bends up or down,
            which comes and goes, and where it leans, which lasts.
        accel: (2,) specific force at the accelerometer along and across, low-passed, without its known
            errors, m/s².
        lean: of the body, as late as ``accel``.
        yaw_accel: rad/s², low-passed.
        explained: what torques and air resistance make of the first, m/s².
        drive, brake, rolling, lever, turned: as :class:`~roadstate.estimators.along.AlongInput`.
        intensity: of the error of ``explained``, m/s²/√Hz.
        gust: what wind has in it, m/s²/√Hz: no error of what torques tell of the wheels.
        held: m/s², 1σ of what drive may have changed by since its torque came.
        age: s since the torque came; huge where there is none.
        is_shifting, is_brake_unknown: as :class:`~roadstate.estimators.traction.Traction`.
        may_brake: brakes act that no channel tells of, or there is no telling.
    """

    along: Float[Array, " 4"]
    across: Float[Array, " 2"]
    load: Float[Array, " 4"]
    steady: Float[Array, " 4"]
    told: Float[Array, " 4"]
    now: Current
    stir: Float[Array, "2 2"]
    jolt: Float[Array, " 4"]
    locking: Float[Array, ""]
    shaken: Float[Array, " 2"]
    along_std: Float[Array, " 4"]
    across_std: Float[Array, " 2"]
    load_std: Float[Array, " 2"]
    accel: Float[Array, " 2"]
    lean: Lean
    yaw_accel: Float[Array, ""]
    explained: Float[Array, ""]
    drive: Float[Array, ""]
    brake: Float[Array, ""]
    rolling: Float[Array, ""]
    lever: Float[Array, ""]
    turned: Float[Array, ""]
    intensity: Float[Array, ""]
    gust: Float[Array, ""]
    held: Float[Array, ""]
    age: Float[Array, ""]
    is_shifting: Bool[Array, ""]
    is_brake_unknown: Bool[Array, ""]
    may_brake: Bool[Array, ""]

    @property
    def over_load(self) -> Float[Array, " 4"]:
        """F_x of the wheels over their loads, of which none counts for less than a tenth of their mean."""
        return self.along / jnp.maximum(self.load, 0.1 * jnp.mean(self.load))

    @property
    def loads_std(self) -> Float[Array, ""]:
        """1σ of what all loads are off by together, for whatever reason, as a share."""
        return rss(*self.load_std)


def steered_cosines(cosine: Float[Array, ""]) -> Float[Array, " 4"]:
    """Cosines of the wheels' angles to the body, of which only the front ones steer."""
    ahead = jnp.ones_like(cosine)
    return jnp.stack([cosine, cosine, ahead, ahead])


def gains_aside(half_track: Float[Array, " 4"], turn: Float[Array, " 4"]) -> Float[Array, " 4"]:
    """(4,) m: v_x of a car less ``turn`` times a wheel's speed, over the yaw rate.

    At y to the left a wheel of the front axle moves by (v_x − y r) cos δ + (v_y + l_f r) sin δ where it
    points, with v_y + l_f r = v_x tan δ as it rolls: v_x/cos δ − y r cos δ in all.

    Args:
        half_track: y of the wheels, m.
        turn: :func:`steered_cosines`.
    """
    return half_track * turn**2


def held_back(across: Float[Array, ""], steer: Float[Array, ""], front: Float[Array, ""]) -> Float[Array, ""]:
    """By what specific force, m/s², the front tires of a car that turns hold it back.

    Args:
        across: specific force across, m/s².
        steer: mean front road-wheel angle, rad.
        front: share of the force across that the front tires bear.
    """
    return front * across * jnp.sin(steer)


def by_axle(wheels: Float[Array, " 4"]) -> Float[Array, " 2"]:
    """Sums over the wheels of the front and of the rear axle."""
    return wheels.reshape(2, 2).sum(axis=1)


def parked(
    load: Float[Array, " k"], speed: Float[Array, ""], locking: Float[Array, ""]
) -> Float[Array, " k"]:
    """1σ, N, of what axles or wheels of so much load (N), held by brakes, push against each other.

    A stop of wheels that lock and turn by turns ends with any of them on its tire's curve.
    """
    share = rss(_PARKED[0], _PARKED[1] * locking**2)
    return share * load * jnp.exp(-((speed / STANDSTILL_SPEED) ** 2))


def damped(value: Float[Array, ...], noise: Float[Array, ...]) -> Float[Array, ...]:
    """``value`` where it exceeds ``noise`` by far, next to nothing where it is less."""
    return value**3 / (value**2 + noise**2)
