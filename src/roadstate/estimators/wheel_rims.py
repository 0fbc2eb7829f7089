"""What each wheel tells of the car's speed, and how far it may be believed."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.estimators import agreement
from roadstate.estimators.agreement import BEARS, DEAD_BAND, TOGETHER
from roadstate.estimators.axle_forces import AxleForces, gains_aside, steered_cosines
from roadstate.estimators.base import leaf
from roadstate.estimators.intake import SPIN, STALE, STEER, YAW_RATE, Signals
from roadstate.estimators.signals import NEVER
from roadstate.estimators.traction import LEAST_BRAKING

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

ANY = 5.0
"""m/s: 1σ of a speed that is not known yet."""
WHEEL_DELAY = 0.01
"""s: age of a wheel's speed when it comes."""
_SLIP_SHARE = 0.5  # 1σ of the slip that a wheel's force makes, as a share of it: near the limit it runs away
_SLIP_TIME = 0.5  # s: how long that lasts
_SLIP_LARGEST = 0.15
_RUNAWAY = (0.4, 3.0)  # m/s by which a wheel may leave the rest, and 1σ over what is beyond
_RACING = (5.0, 1.8, 0.5)  # m/s² by which a wheel, and all, may outrun the car, and s of mistrust then
_RACE_TIME = 1.5  # s: how long that lasts, under anti-lock brakes that hold no wheel at the car's speed
_APART = 0.02  # share of the speed by which wheels differ anyway
_LEANS = 0.015  # force over load from which on wheels may slip evenly
_CALM = 0.5  # m/s² below which a wheel has not outrun the car lately
_BELIEVES = 1.5  # s for which all wheels agree until they are believed against what is known of the speed
_SLOW = (0.25, 0.1)  # m/s: 1σ of a wheel in its dead band, and s for which that lasts
_TOOTH = (0.04, 0.12)  # m from tooth to tooth, one of which a speed is late besides, and s at the most
_LATE_ERROR = 0.5  # 1σ of that lateness, as a share of it
_SLIDES = 0.5  # m/s² by which a car on locked wheels slows down at the least
_VAGUE = 1.0  # m/s: 1σ of a speed that tells nothing of which wheel slips
_BOUND = 0.07  # of what a wheel bounds the speed by: 1σ of what it slips itself
# m/s from which on one that anti-lock brakes let go bounds the speed, and 1σ of what it is read as faster by,
# in s of what it gains on the car
_LET_GO = (0.1, 0.005)


class RimState(NamedTuple):
    """What :class:`Rims` remember.

    Attributes:
        racing: (4,) m/s² by which wheels outran the car lately.
        locked: s for which no wheel has turned.
        together: s for which all wheels have agreed on a speed and its change, or on standing still.
        rolling: m/s that wheels tell which nothing drives or brakes, or else the one that slips least; the
            car's speed if none tells anything.
        rolls: whether it is the former, and they agree.
        proof: s for which most wheels have agreed on a speed, which is enough once it has been.
        reached: m/s that a wheel has come to at least, under brakes, as the car has slowed down since; or has
            come down to at most as it is driven. The car's speed where tires bear nothing; NaN at first.
    """

    racing: Float[Array, " 4"]
    locked: Float[Array, ""]
    together: Float[Array, ""]
    rolling: Float[Array, ""]
    rolls: Bool[Array, ""]
    proof: Float[Array, ""]
    reached: Float[Array, ""]


class Motion(NamedTuple):
    """What is known of the car's motion before wheels are asked.

    Attributes:
        speed: m/s, and
        spread: its 1σ.
        accel: its rate, m/s², and
        unsure: 1σ of that.
        turning: yaw rate, rad/s.
    """

    speed: Float[Array, ""]
    spread: Float[Array, ""]
    accel: Float[Array, ""]
    unsure: Float[Array, ""]
    turning: Float[Array, ""]


class _Told(NamedTuple):
    """What wheels tell, each (4,).

    Attributes:
        rim: the car's speed, m/s.
        own: the wheel's, without slip, m/s.
        late: s by which it is late besides.
        gains: by how much more than the car it speeds up, m/s².
        known: whether it tells anything.
    """

    rim: Float[Array, " 4"]
    own: Float[Array, " 4"]
    late: Float[Array, " 4"]
    gains: Float[Array, " 4"]
    known: Bool[Array, " 4"]


class Rims(eqx.Module):
    """The car's speed by each of its wheels, freed of yaw and slip.

    A wheel whose own acceleration is not the car's spins up or locks, and is mistrusted from that moment on;
    so is one that is far from the car's speed, unless all wheels have long agreed on another. Wheels that
    nothing drives or brakes have no reason to slip: where they agree, the others are held against them, and
    they against nothing. And a tire slips as its force points: one that slows the car down turns no faster
    than the car moves, however its wheel may lock, one that pushes it no slower. As long as wheels have
    agreed on no speed at all, that is all there is to go by: they are held against the one that has slipped
    least so far.

    Attributes:
        driven: whether a drive acts on each wheel.
        radius: rolling radius, m.
        noise: 1σ of a wheel's speed, m/s.
        slip_stiffness: C_κ/F_z.
        half_track: (4,) of the wheels to the left, m.
    """

    driven: tuple[bool, ...] = eqx.field(static=True)
    radius: Float[Array, ""]
    noise: Float[Array, ""]
    slip_stiffness: Float[Array, ""]
    half_track: Float[Array, " 4"]

    def __init__(self, vehicle: Vehicle) -> None:
        self.driven = vehicle.driveline.drives
        self.radius = leaf(vehicle.wheels.radius)
        self.noise = leaf(vehicle.wheels.radius * vehicle.sensors.wheel_speed.noise)
        self.slip_stiffness = leaf(vehicle.tires.slip_stiffness)
        self.half_track = jnp.asarray(np.array(vehicle.geometry.half_tracks))

    def init(self) -> RimState:
        """No wheel has turned."""
        zero = jnp.zeros(())
        return RimState(jnp.zeros(4), zero, zero, zero, jnp.zeros((), bool), zero, jnp.full((), jnp.nan))

    def slips(self, along: Array, load: Array) -> Float[Array, " 4"]:
        """(4,) what forces F_x (4,) under loads (4,), N, make wheels slip as long as that is linear."""
        load = jnp.maximum(load, 0.1 * jnp.mean(load))
        return jnp.clip(along / (self.slip_stiffness * load), -_SLIP_LARGEST, _SLIP_LARGEST)

    def mean(self, seen: Signals) -> Float[Array, ""]:
        """Mean speed of the wheels that tell something, m/s."""
        told = seen.is_fresh[SPIN]
        return jnp.sum(self.radius * jnp.where(told, seen.value[SPIN], 0.0)) / jnp.maximum(jnp.sum(told), 1)

    def read(
        self, state: RimState, seen: Signals, forces: AxleForces, car: Motion, since: Array, dt: Array
    ) -> tuple[RimState, Float[Array, " 4"], Float[Array, " 4"]]:
        """(4,) the car's speed as each wheel tells it, and 1σ, m/s; NaN of one that no sample came of.

        Args:
            state: from :meth:`init` or the last call.
            seen: signals.
            forces: at this instant.
            car: how it moves as far as is known.
            since: (4,) s since each wheel's sample before.
            dt: s.
        """
        is_proven, bears = agreement.is_proven(state.proof), forces.over_load
        # anti-lock brakes let a wheel go that has raced lately, and it rolls as it comes to the car's speed
        let_go = is_proven & (jnp.mean(bears) * jnp.sign(car.speed) < -BEARS)
        slip = self.slips(forces.along, forces.load)
        slip = slip / jnp.where(let_go, 1 + state.racing / _RACING[0], 1.0)
        wheels = self._told(seen, slip, car)
        rim, told = wheels.rim, wheels.known
        outruns = self._outruns(wheels, car)
        racing = jnp.maximum(outruns, state.racing * jnp.exp(-dt / _RACING[2]))
        slowest = jnp.min(jnp.where(told, rim, jnp.inf))
        fastest = jnp.max(jnp.where(told, rim, -jnp.inf))
        rests = jnp.maximum(jnp.abs(slowest), jnp.abs(fastest)) < DEAD_BAND
        members, most = agreement.most(rim, told, outruns == 0.0)
        sure = agreement.is_sure(members, told, jnp.mean(bears))
        least = self._slips_least(state, wheels, forces, car, since, dt)
        least = agreement.agreed(least, members, most, sure, state.proof)
        several = jnp.sum(told) > 1
        begins = several & ~is_proven
        # what is known of the speed tells nothing: wheels are held against the one that slips least
        vague = several & (begins | (car.spread > _VAGUE))
        away = jnp.abs(rim - jnp.where(vague, least, car.speed + car.accel * dt))
        away = away - jnp.where(begins, 0.0, _RUNAWAY[0] + jnp.where(vague, 0.0, 2 * car.spread))
        away = jnp.maximum(away, 0.0)
        reached, behind = self._reaches(state, wheels, jnp.mean(bears), car, dt)
        away = jnp.where(begins, away, jnp.maximum(away, behind))
        agree = fastest - slowest < TOGETHER[0] * jnp.abs(car.speed) + TOGETHER[1]
        agree = agree & (jnp.max(jnp.where(told, outruns, 0.0)) == 0.0) & several
        agree = agree & (jnp.minimum(jnp.abs(slowest), jnp.abs(fastest)) > DEAD_BAND)
        # wheels that are locked slow the car down: one that gains speed while none turns stands still, and so
        # does one that would have come to a stop since
        locked = jnp.where(rests, state.locked + dt, 0.0)
        stands = (car.speed * car.accel > 0) | (_SLIDES * locked > jnp.abs(car.speed))
        together = jnp.where(agree | (rests & several & stands), state.together + dt, 0.0)
        away = jnp.where(together > _BELIEVES, 0.0, away)
        free, rolling, sound = self._free(rim, told & (racing < _CALM), forces)
        off = jnp.maximum(jnp.abs(rim - rolling) - _RUNAWAY[0], 0.0)
        away = jnp.where(sound, jnp.where(free, 0.0, jnp.maximum(away, off)), away)
        bounds, within = self._bounds(wheels, bears, car, let_go & ~vague)
        away = jnp.where(bounds, within, away)
        doubtful = jnp.where(bounds | begins, 0.0, racing)
        clear = jnp.any(members) | (jnp.max(jnp.where(told, racing, 0.0)) > _CALM)
        unproven = agreement.least_slip(rim, fastest - slowest, clear)
        unproven = jnp.where(begins & ~rests, unproven, 0.0)
        lasting = unproven**2 + (_SLIP_SHARE * slip * car.speed) ** 2 + (_RUNAWAY[1] * away) ** 2
        lasting = lasting + (_LATE_ERROR * wheels.late * car.accel) ** 2
        lasting = _SLIP_TIME * lasting + _RACE_TIME * (_RACING[2] * doubtful) ** 2
        slow = jnp.where(jnp.abs(wheels.own) < DEAD_BAND, _SLOW[0], 0.0)
        std = jnp.sqrt(self.noise**2 + lasting / since + slow**2 * jnp.maximum(_SLOW[1] / since, 1.0))
        proof = agreement.proves(
            jnp.where(is_proven & (car.spread > ANY), 0.0, state.proof), members, sure, dt
        )
        new = RimState(
            racing=racing,
            locked=locked,
            together=together,
            rolling=jnp.where(sound, rolling, least),
            rolls=sound,
            proof=jnp.where(sound, NEVER, proof),
            reached=reached,
        )
        return new, jnp.where(seen.is_fresh[SPIN], rim, jnp.nan), std

    def _told(self, seen: Signals, slip: Array, car: Motion) -> _Told:
        """What wheels tell that slip so."""
        spin, radius = seen.value[SPIN], self.radius
        angle = jnp.where(seen.age[STEER] < STALE, jnp.clip(seen.value[STEER], -0.9, 0.9), 0.0)
        turn = steered_cosines(jnp.cos(angle))
        # slip is over |v|: a force ahead turns a wheel of a car that backs up less fast
        own = radius * spin / (1 + slip * jnp.sign(spin))
        late = jnp.minimum(_TOOTH[0] / jnp.maximum(jnp.abs(car.speed), 1e-3), _TOOTH[1])
        late = jnp.where(jnp.abs(own) > 0, late, 0.0)
        aside = gains_aside(self.half_track, turn)
        rim = own * turn + aside * car.turning + (WHEEL_DELAY + late) * car.accel
        gains = radius * seen.rate[SPIN] * turn + aside * seen.rate[YAW_RATE] - car.accel
        return _Told(rim, own, late, gains, seen.age[SPIN] < STALE)

    def _outruns(self, wheels: _Told, car: Motion) -> Float[Array, " 4"]:
        """(4,) m/s² by which wheels speed up or slow down faster than noise makes it seem, each or all."""
        apart = jnp.abs(wheels.gains)
        alone = jnp.maximum(apart - _RACING[0] - 2 * car.unsure, 0.0)
        count = jnp.maximum(jnp.sum(wheels.known), 1)
        mean = jnp.sum(jnp.where(wheels.known, wheels.gains, 0.0)) / count
        return jnp.maximum(alone, jnp.minimum(jnp.abs(mean), apart) - _RACING[1] - 2 * car.unsure)

    def _slips_least(
        self, state: RimState, wheels: _Told, forces: AxleForces, car: Motion, since: Array, dt: Array
    ) -> Float[Array, ""]:
        """Speed that the wheel tells which slips least, m/s."""
        rim, told = wheels.rim, wheels.known
        known = (car.spread < ANY) & (jnp.sum(told) > 1) & (jnp.max(jnp.where(told, since, 0.0)) < STALE)
        known = known & ~agreement.is_proven(state.proof)
        before = jnp.where(known, state.rolling + car.accel * dt, jnp.nan)
        turns = told & ((jnp.abs(rim) > DEAD_BAND) | ~np.array(self.driven))
        turns = jnp.where(jnp.any(turns), turns, told)
        least = agreement.slips_least(rim, turns, jnp.mean(forces.over_load), before, car.unsure, dt)
        return jnp.where(jnp.isnan(least), car.speed, least)

    def _reaches(
        self, state: RimState, wheels: _Told, bears: Array, car: Motion, dt: Array
    ) -> tuple[Float[Array, ""], Float[Array, " 4"]]:
        """Speed that the wheel that slips least has come to of late, and how far (4,) others fall short, m/s.

        On ice a wheel may slip evenly for seconds, neither racing nor far from the speed as it is known.
        """
        way = jnp.where(jnp.abs(bears) > _LEANS, jnp.sign(bears), 0.0)
        within = _RUNAWAY[0] + 2 * car.spread
        rim = jnp.where(way > 0, jnp.maximum(wheels.rim, car.speed - within), wheels.rim)
        rim = jnp.where(way < 0, jnp.minimum(rim, car.speed + within), rim)
        told = wheels.known & (jnp.abs(wheels.rim) > DEAD_BAND)
        before = state.reached + car.accel * dt
        least = agreement.slips_least(rim, told, bears, before, car.unsure, dt, _LEANS)
        reached = jnp.where((way == 0) | jnp.isnan(least), car.speed, least)
        short = (wheels.rim - reached) * way
        return reached, jnp.maximum(short - _RUNAWAY[0] - _APART * jnp.abs(car.speed), 0.0)

    def _bounds(
        self, wheels: _Told, bears: Array, car: Motion, released: Array
    ) -> tuple[Bool[Array, " 4"], Float[Array, " 4"]]:
        """Which wheels turn faster than a car can be slower whose tires so bear (4,), or the other way round;
        and what they are away from its speed themselves, over :data:`_RUNAWAY`'s σ.

        Those that anti-lock brakes have ``released`` swing back to the car's speed, and are read as faster.
        """
        beyond = (car.speed - wheels.rim) * jnp.sign(bears)
        bounds = (beyond > jnp.where(released, _LET_GO[0], _RUNAWAY[0])) & (jnp.abs(bears) > BEARS)
        bounds = bounds & (car.spread < ANY) & (jnp.abs(wheels.rim) > DEAD_BAND)
        # which wheel comes how near to the car's speed is not known: a bound, and no measurement
        nears = jnp.where(released, car.spread + _LET_GO[1] * jnp.abs(wheels.gains), 0.0)
        return bounds, _BOUND * beyond + nears / _RUNAWAY[1]

    def _free(
        self, rim: Array, told: Array, forces: AxleForces
    ) -> tuple[Bool[Array, " 4"], Float[Array, ""], Bool[Array, ""]]:
        """Which wheels nothing drives or brakes, the speed they tell, and whether they agree on it."""
        brakes = (forces.age >= STALE) | forces.may_brake | (jnp.abs(forces.brake) > LEAST_BRAKING)
        free = told & ~np.array(self.driven) & ~brakes & (jnp.abs(rim) > DEAD_BAND)
        count = jnp.sum(free)
        speed = jnp.sum(jnp.where(free, rim, 0.0)) / jnp.maximum(count, 1)
        apart = jnp.max(jnp.where(free, jnp.abs(rim - speed), 0.0))
        agree = apart < 0.5 * (TOGETHER[0] * jnp.abs(speed) + TOGETHER[1])
        return free, speed, (count > 1) & agree
