"""How the rolling radii of a car's wheels differ from one another: tires wear, one is new, one is a spare."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core.constants import GRAVITY
from roadstate.estimators.axle_forces import gains_aside, steered_cosines
from roadstate.estimators.base import leaf
from roadstate.estimators.intake import (
    ACCEL_Y,
    SMOOTHING,
    SPIN,
    STALE,
    STEER,
    WHEEL_SPEEDS,
    YAW_RATE,
    Signals,
)
from roadstate.estimators.redundancy import inner_mean
from roadstate.linalg import rss

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_PRIOR = 0.01  # 1σ of how far a wheel's radius is off the others', as a share
_FORGETS = 300.0  # s after which what was found counts no more: tires warm up, and lose air
_LASTS = 1.0  # s: how long the errors below last
_LEVEL = 0.001  # 1σ of what a wheel that rolls freely straight ahead differs by, as a share
_OF_SLIP = 0.5  # 1σ of the slip that its force makes, as a share of it
_OF_BEND = 0.03  # 1σ, over (a_y/g)²: slip angles and loads change the radius
_OF_TURN = 0.004  # m/s: 1σ of what the yaw rate's error does to a wheel's speed
_OF_STEER = 0.2  # 1σ, over the square of the steering angle
_ROLLS = 0.004  # slip that a wheel's force makes, of wheels that roll nearly freely
_COASTS = 0.5  # m/s² along that a car has which nothing brakes or drives
_LEAST_LEVER = 1e-3  # m²: wheels of one side tell of no turn
_STRAIGHT = 2.5  # m/s² across
_ALIKE = 0.8  # m/s² by which that and the yaw rate's may differ: roads bank
_SLOWEST = 4.0  # m/s
_STEADY = 4.0  # m/s² by which no wheel gains more than the middle ones
_LARGEST = 0.12  # a share by which no wheel that is mounted differs
_LARGE = 0.03  # a share by which wheels differ seldom
_SETTLES = (0.1, 1.0)  # s for which all that must have been so: usually, and where they differ by more
_OF_STEP = 0.3  # 1σ of a speed that comes in steps, over a step
_STRAYS = (0.004, 4.0)  # a share, and σ, by which a wheel may differ from what is known of it
_ANEW = 3.0  # s for which one must, to be learned anew
_KNOWN = 0.004  # 1σ with which differences pass for known
# a share, and σ besides, by which it changes within so many s when what follows is found anew
_MOVED, _SURELY, _SWIFT = 0.004, 2.0, 2.0


class RadiiState(NamedTuple):
    """State of :class:`Radii`.

    Attributes:
        faster: (4,) by what share each wheel turns faster than the others do at the same speed.
        known: (4,) what is known of that, 1/σ².
        settled: s for which wheels have rolled freely.
        stray: s for which one has contradicted what is known of it while they did.
        moved: (4,) by how much ``faster`` has changed of late, since that was last told.
    """

    faster: Float[Array, " 4"]
    known: Float[Array, " 4"]
    settled: Float[Array, ""]
    stray: Float[Array, ""]
    moved: Float[Array, " 4"]


class Radii(eqx.Module):
    """Learns from wheels that roll freely by what share each turns faster than the middle ones.

    That is (1 + ρ_m)/(1 + ρ_i) − 1 of radii R (1 + ρ_i): their common level is another matter, which only a
    speed that is not the wheels' tells. Two hundredths between axles are usual (a set of new tires, 4 mm of
    tread), and would pass for slip, as on ice, for a yaw rate, and for a speed that jumps as now one wheel
    is trusted, now another.

    Attributes:
        has: (4,) wheels that can be told from others.
        radius: of the vehicle file, m.
        half_track: (4,) of the wheels to the left, m.
    """

    has: Bool[Array, " 4"]
    radius: Float[Array, ""]
    half_track: Float[Array, " 4"]

    def __init__(self, vehicle: Vehicle, available: Collection[str]) -> None:
        has = np.array([name in available for name in WHEEL_SPEEDS])
        self.has = jnp.asarray(has & (has.sum() > 1))
        self.radius = leaf(vehicle.wheels.radius)
        self.half_track = jnp.asarray(np.array(vehicle.geometry.half_tracks))

    def init(self) -> RadiiState:
        """All alike, as far as anybody knows."""
        four = jnp.zeros(4)
        return RadiiState(four, four + _PRIOR**-2, jnp.zeros(()), jnp.zeros(()), four)

    def is_known(self, state: RadiiState) -> Bool[Array, ""]:
        """Whether differences of the wheels that are there are known well."""
        return jnp.min(jnp.where(self.has, state.known, jnp.inf)) > _KNOWN**-2

    def has_moved(self, state: RadiiState) -> Bool[Array, ""]:
        """Whether what was found has surely changed so much that what followed from it is wrong."""
        return jnp.any(jnp.abs(state.moved) > _MOVED + _SURELY / jnp.sqrt(state.known))

    def even(self, state: RadiiState, seen: Signals) -> Signals:
        """Signals with wheels that turn as if all radii were alike."""
        return seen.scaled(jnp.ones(8).at[SPIN].set(1 / (1 + state.faster)))

    def _turns(self, rim: Float[Array, " 4"], told: Bool[Array, " 4"]) -> Float[Array, ""]:
        """Yaw rate that the wheels ``told`` have by themselves, by least squares, rad/s."""
        centre = jnp.sum(jnp.where(told, self.half_track, 0.0)) / jnp.maximum(jnp.sum(told), 1)
        lever = jnp.where(told, self.half_track - centre, 0.0)
        return -jnp.sum(lever * rim) / jnp.maximum(jnp.sum(lever**2), _LEAST_LEVER)

    def learn(
        self,
        state: RadiiState,
        seen: Signals,
        slip: Float[Array, " 4"],
        felt: Float[Array, ""],
        turning: Float[Array, ""],
        steps: Float[Array, " 4"],
        noise: Float[Array, " 4"],
        dt: Float[Array, ""],
    ) -> RadiiState:
        """Take what a sample, ``dt`` after the last, tells.

        Args:
            state: from :meth:`init` or the last call.
            seen: of :meth:`even`.
            slip: (4,) what the forces along make wheels slip.
            felt: specific force along, m/s², where brakes may act of which nobody knows what each wheel gets;
                0 elsewhere.
            turning: yaw rate, rad/s; where nothing tells of one, what differs from side to side is one.
            steps: (4,) in which the wheels' speeds come, rad/s.
            noise: (4,) 1σ of white noise in their low-passed speeds, m/s.
            dt: s.
        """
        told = seen.age[SPIN] < STALE
        angle = jnp.where(seen.age[STEER] < STALE, jnp.clip(seen.smooth[STEER], -0.9, 0.9), 0.0)
        turn = steered_cosines(jnp.cos(angle))
        spin = self.radius * seen.smooth[SPIN]
        rim = spin / (1 + slip * jnp.sign(spin)) * turn
        is_told = jnp.minimum(seen.age[YAW_RATE], seen.age[ACCEL_Y]) < STALE
        turning = jnp.where(is_told, turning, self._turns(rim, told))
        rim = rim + gains_aside(self.half_track, turn) * turning
        middle, _, count = inner_mean(rim, told)
        moves = jnp.abs(middle) > _SLOWEST
        apart = rim / jnp.where(moves, middle, 1.0) - 1
        gains = self.radius * seen.rate[SPIN]
        gains = gains - inner_mean(gains, told)[0]
        across = jnp.where(seen.age[ACCEL_Y] < STALE, seen.smooth[ACCEL_Y], middle * turning)
        # a yaw rate that lies makes wheels differ, too
        bends = jnp.abs(across) + _STRAIGHT / _ALIKE * jnp.abs(across - middle * turning)
        rolls = (jnp.abs(slip) < _ROLLS) & (jnp.abs(gains) < _STEADY) & (jnp.abs(apart) < _LARGEST)
        rolls = jnp.all(rolls | ~told) & moves & (count > 1.5) & (bends < _STRAIGHT)
        settled = jnp.where(rolls & (jnp.abs(felt) < _COASTS), state.settled + dt, 0.0)
        # radii do not jump: a wheel that leaves what is known of it slips, unless it goes on rolling so
        sure = state.known > _KNOWN**-2
        strays = told & sure & (jnp.abs(apart) > _STRAYS[0] + _STRAYS[1] / jnp.sqrt(state.known))
        stray = jnp.where(rolls & jnp.any(strays), state.stray + dt, 0.0)
        forgets = stray > _ANEW
        most = jnp.max(jnp.where(told, jnp.abs(apart), 0.0))
        settles = jnp.where(most > _LARGE, _SETTLES[1], _SETTLES[0])
        moving = jnp.maximum(jnp.abs(middle), _SLOWEST)
        error = rss(
            _LEVEL,
            _OF_SLIP * slip,
            _OF_BEND * (across / GRAVITY) ** 2,
            _OF_TURN / moving,
            _OF_STEER * angle**2,
            _OF_STEP * self.radius * steps / moving,
        )
        learns = told & (settled > settles) & ~jnp.any(strays)
        density = _LASTS * error**2 + 2 * SMOOTHING * (noise / moving) ** 2
        more = jnp.where(learns, dt / density, 0.0)
        kept = jnp.where(forgets, 0.0, state.known * jnp.exp(-dt / _FORGETS))
        known = jnp.maximum(kept, _PRIOR**-2) + more
        change = more / known * jnp.where(learns, apart, 0.0)
        moved = jnp.where(self.has_moved(state), 0.0, state.moved * jnp.exp(-dt / _SWIFT)) + change
        return RadiiState(state.faster + change, known, settled, stray, moved)
