"""Where wheels and axles meet the road: the speed each wheel tells, and how each tire slips."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core.constants import GRAVITY
from roadstate.estimators import agreement
from roadstate.estimators.agreement import BEARS, DEAD_BAND, TOGETHER
from roadstate.estimators.axle_forces import AxleForces, by_axle, steered_cosines
from roadstate.estimators.base import leaf
from roadstate.estimators.intake import ACCEL_Y, SMOOTHING, SPIN, STALE, STEER, YAW_RATE, Signals
from roadstate.estimators.sideways import SLIP_ERROR, Touch
from roadstate.estimators.signals import NEVER
from roadstate.estimators.traction import LEAST_BRAKING
from roadstate.linalg import root, rss

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

ANY = 5.0
"""m/s: 1σ of a speed that is not known yet."""
_SLIP_SHARE = 0.5  # 1σ of the slip that a wheel's force makes, as a share of it: near the limit it runs away
_SLIP_TIME = 0.5  # s: how long that lasts
_SLIP_LARGEST = 0.15
_SLIP_LAG = 0.025  # s by which force and slip are not of the same moment: 1σ
_RUNAWAY = (0.4, 3.0)  # m/s by which a wheel may leave the rest, and 1σ over what is beyond
_RACING = (5.0, 1.8, 0.5)  # m/s² by which a wheel, and all, may outrun the car, and s of mistrust then
_RACE_TIME = 1.5  # s: how long that lasts, under anti-lock brakes that hold no wheel at the car's speed
_CALM = 0.5  # m/s² below which a wheel has not outrun the car lately
_BELIEVES = 1.5  # s for which all wheels agree until they are believed against what is known of the speed
_SLOW = (0.25, 0.1)  # m/s: 1σ of a wheel in its dead band, and s for which that lasts
_WHEEL_DELAY = 0.01  # s: age of a wheel's speed when it comes
_SENSED = 0.005  # s by which a signal is older than when it comes
_USUAL = 0.0997  # variance that the low pass leaves of samples at 100 Hz, which other figures include
_TEETH = 0.2  # rad/s: 1σ of a wheel's sample by teeth out of place
_TOOTH = (0.04, 0.12)  # m from tooth to tooth, one of which a speed is late besides, and s at the most
_LATE_ERROR = 0.5  # 1σ of that lateness, as a share of it
_YIELDS = 0.01  # s: lag of the force behind the angle that suspension and steering add to the tire's
_SWAY_ARM = 0.85  # of the centre of gravity over the axis that the body rolls about, over its height
_LAG_ERROR = 0.015  # s: 1σ of that lag
_SLIDES = 0.5  # m/s² by which a car on locked wheels slows down at the least
_VAGUE = 1.0  # m/s: 1σ of a speed that tells nothing of which wheel slips
_BOUND = 0.07  # of what a wheel bounds the speed by: 1σ of what it slips itself
# m/s from which on one that anti-lock brakes let go bounds the speed, and 1σ of what it is read as faster by,
# in s of what it gains on the car
_LET_GO = (0.1, 0.005)
# 1σ of forces along and across, low-passed, over g and load, as a share of the lesser of what a rough road
# shakes the accelerometers by both ways: tires bear more and less as they bounce
_SHAKEN = (1.05, 3.3)


class ContactState(NamedTuple):
    """What a :class:`TireContact` remembers.

    Attributes:
        angle, across: (2,) the axles' slip angles but for v_y, and their F_y/F_z, both slowed.
        lateral: what v̇_y would be on a level road and without biases, as slow as the angles, m/s².
        along, slip: (4,) F_x/F_z and slip of the wheels, slowed.
        racing: (4,) m/s² by which wheels outran the car lately.
        locked: s for which no wheel has turned.
        together: s for which all wheels have agreed on a speed and its change, or on standing still.
        rolling: m/s that wheels tell which nothing drives or brakes, or else the one that slips least.
        rolls: whether it is the former, and they agree.
        proof: s for which most wheels have agreed on a speed, which is enough once it has been.
    """

    angle: Float[Array, " 2"]
    across: Float[Array, " 2"]
    lateral: Float[Array, ""]
    along: Float[Array, " 4"]
    slip: Float[Array, " 4"]
    racing: Float[Array, " 4"]
    locked: Float[Array, ""]
    together: Float[Array, ""]
    rolling: Float[Array, ""]
    rolls: Bool[Array, ""]
    proof: Float[Array, ""]


class TireContact(eqx.Module):
    """Slips of wheels and axles, from signals, forces and the car's speed.

    Attributes:
        radius: rolling radius, m.
        noise: 1σ of a wheel's speed, m/s.
        slip_stiffness: C_κ/F_z.
        relaxation: relaxation length, m.
        places: (2,) of the axles ahead of the centre of gravity, m.
        sway: m by which the tires are left behind to the left as the body leans, per m/s² across.
        half_track: (4,) of the wheels to the left, m.
        driven: whether a drive acts on each wheel.
    """

    driven: tuple[bool, ...] = eqx.field(static=True)
    radius: Float[Array, ""]
    noise: Float[Array, ""]
    slip_stiffness: Float[Array, ""]
    relaxation: Float[Array, ""]
    places: Float[Array, " 2"]
    sway: Float[Array, ""]
    half_track: Float[Array, " 4"]

    def __init__(self, vehicle: Vehicle) -> None:
        geometry, tires = vehicle.geometry, vehicle.tires
        self.driven = vehicle.driveline.drives
        self.radius = leaf(vehicle.wheels.radius)
        self.noise = leaf(vehicle.wheels.radius * vehicle.sensors.wheel_speed.noise)
        self.slip_stiffness, self.relaxation = leaf(tires.slip_stiffness), leaf(tires.relaxation_length)
        self.places = jnp.asarray([geometry.cg_to_front_axle, -geometry.cg_to_rear_axle])
        self.sway = leaf(_SWAY_ARM * geometry.cg_height * vehicle.body.roll_gradient)
        self.half_track = jnp.asarray(np.array(geometry.half_tracks))

    def init(self) -> ContactState:
        """Straight ahead and rolling."""
        two, four = jnp.zeros(2), jnp.zeros(4)
        zero = jnp.zeros(())
        return ContactState(two, two, zero, four, four, four, zero, zero, zero, jnp.zeros((), bool), zero)

    def slips(self, along: Array, load: Array) -> Float[Array, " 4"]:
        """(4,) what forces F_x (4,) under loads (4,), N, make wheels slip as long as that is linear."""
        load = jnp.maximum(load, 0.1 * jnp.mean(load))
        return jnp.clip(along / (self.slip_stiffness * load), -_SLIP_LARGEST, _SLIP_LARGEST)

    def white(self, seen: Signals) -> Float[Array, " 4"]:
        """(4,) 1σ of white noise in the wheels' smooth speeds, m/s, beyond what samples at 100 Hz leave."""
        noise = jnp.maximum(seen.noise[SPIN] - _USUAL, 0.0)
        # one sample's error is the next's, turned round: of samples in a row the low pass leaves none
        teeth = seen.noise[SPIN] * jnp.minimum(noise / _USUAL, 1.0)
        return root(self.noise**2 * noise + (_TEETH * self.radius) ** 2 * teeth)

    def rims(
        self,
        state: ContactState,
        seen: Signals,
        forces: AxleForces,
        turning: Array,
        speed: Array,
        spread: Array,
        accel: Array,
        unsure: Array,
        since: Array,
        dt: Array,
    ) -> tuple[ContactState, Float[Array, " 4"], Float[Array, " 4"]]:
        """(4,) the car's speed as each wheel tells it, freed of yaw and slip, and 1σ, m/s.

        A wheel whose own acceleration is not the car's spins up or locks, and is mistrusted from that moment
        on; so is one that is far from the car's speed, unless all wheels have long agreed on another. Wheels
        that nothing drives or brakes have no reason to slip: where they agree, the others are held against
        them, and they against nothing. And a tire slips as its force points: one that slows the car down
        turns no faster than the car moves, however its wheel may lock, one that pushes it no slower. As long
        as wheels have agreed on no speed at all, that is all there is to go by: they are held against the
        one that has slipped least so far.

        Args:
            state: from :meth:`init` or the last call.
            seen: signals.
            forces: at this instant.
            turning: yaw rate, rad/s.
            speed: m/s, and
            spread: its 1σ.
            accel: its rate, m/s², and
            unsure: 1σ of that.
            since: (4,) s since each wheel's sample before.
            dt: s.
        """
        radius = self.radius
        slip = self.slips(forces.along, forces.load)
        # anti-lock brakes let a wheel go that has raced lately, and it rolls as it comes to the car's speed
        is_proven = agreement.is_proven(state.proof)
        bears = forces.over_load
        let_go = is_proven & (jnp.mean(bears) * jnp.sign(speed) < -BEARS)
        slip = slip / jnp.where(let_go, 1 + state.racing / _RACING[0], 1.0)
        angle = jnp.where(seen.age[STEER] < STALE, jnp.clip(seen.value[STEER], -0.9, 0.9), 0.0)
        turn = steered_cosines(jnp.cos(angle))
        # slip is over |v|: a force ahead turns a wheel of a car that backs up less fast
        rolling = radius * seen.value[SPIN] / (1 + slip * jnp.sign(seen.value[SPIN]))
        late = jnp.minimum(_TOOTH[0] / jnp.maximum(jnp.abs(speed), 1e-3), _TOOTH[1])
        late = jnp.where(jnp.abs(rolling) > 0, late, 0.0)
        rim = rolling * turn + self.half_track * turning + (_WHEEL_DELAY + late) * accel
        gains = radius * seen.rate[SPIN] * turn + self.half_track * seen.rate[YAW_RATE]
        apart = jnp.abs(gains - accel)
        outruns = jnp.maximum(apart - _RACING[0] - 2 * unsure, 0.0)
        told = seen.age[SPIN] < STALE
        several = jnp.sum(told) > 1
        mean = jnp.sum(jnp.where(told, gains - accel, 0.0)) / jnp.maximum(jnp.sum(told), 1)
        outruns = jnp.maximum(outruns, jnp.minimum(jnp.abs(mean), apart) - _RACING[1] - 2 * unsure)
        racing = jnp.maximum(outruns, state.racing * jnp.exp(-dt / _RACING[2]))
        slowest = jnp.min(jnp.where(told, rim, jnp.inf))
        fastest = jnp.max(jnp.where(told, rim, -jnp.inf))
        known = (spread < ANY) & several & (jnp.max(jnp.where(told, since, 0.0)) < STALE)
        before = jnp.where(known & ~is_proven, state.rolling + accel * dt, jnp.nan)
        turns = told & ((jnp.abs(rim) > DEAD_BAND) | ~np.array(self.driven))
        turns = jnp.where(jnp.any(turns), turns, told)
        least = agreement.slips_least(rim, turns, jnp.mean(bears), before, unsure, dt)
        members, most = agreement.most(rim, told, outruns == 0.0)
        sure = agreement.is_sure(members, told, jnp.mean(bears))
        least = agreement.agreed(least, members, most, sure, state.proof)
        begins = several & ~is_proven
        # what is known of the speed tells nothing: wheels are held against the one that slips least
        vague = several & (begins | (spread > _VAGUE))
        away = jnp.abs(rim - jnp.where(vague, least, speed + accel * dt))
        away = away - jnp.where(begins, 0.0, _RUNAWAY[0] + jnp.where(vague, 0.0, 2 * spread))
        away = jnp.maximum(away, 0.0)
        agree = fastest - slowest < TOGETHER[0] * jnp.abs(speed) + TOGETHER[1]
        agree = agree & (jnp.max(jnp.where(told, outruns, 0.0)) == 0.0) & several
        agree = agree & (jnp.minimum(jnp.abs(slowest), jnp.abs(fastest)) > DEAD_BAND)
        # wheels that are locked slow the car down: one that gains speed while none turns stands still, and so
        # does one that would have come to a stop since
        rests = jnp.maximum(jnp.abs(slowest), jnp.abs(fastest)) < DEAD_BAND
        locked = jnp.where(rests, state.locked + dt, 0.0)
        agree = agree | (rests & several & ((speed * accel > 0) | (_SLIDES * locked > jnp.abs(speed))))
        together = jnp.where(agree, state.together + dt, 0.0)
        away = jnp.where(together > _BELIEVES, 0.0, away)
        free, rolling_speed, sound = self._free(rim, told & (racing < _CALM), forces)
        off = jnp.maximum(jnp.abs(rim - rolling_speed) - _RUNAWAY[0], 0.0)
        away = jnp.where(sound, jnp.where(free, 0.0, jnp.maximum(away, off)), away)
        beyond, released = (speed - rim) * jnp.sign(bears), let_go & ~vague
        bounds = (beyond > jnp.where(released, _LET_GO[0], _RUNAWAY[0])) & (jnp.abs(bears) > BEARS)
        bounds = bounds & (spread < ANY) & (jnp.abs(rim) > DEAD_BAND)
        # which wheel comes how near to the car's speed is not known: a bound, and no measurement
        nears = jnp.where(released, spread + _LET_GO[1] * apart, 0.0)
        away = jnp.where(bounds, _BOUND * beyond + nears / _RUNAWAY[1], away)
        doubtful = jnp.where(bounds | begins, 0.0, racing)
        clear = jnp.any(members) | (jnp.max(jnp.where(told, racing, 0.0)) > _CALM)
        unproven = agreement.least_slip(rim, fastest - slowest, clear)
        unproven = jnp.where(begins & ~rests, unproven, 0.0)
        lasting = unproven**2 + (_SLIP_SHARE * slip * speed) ** 2 + (_RUNAWAY[1] * away) ** 2
        lasting = lasting + (_LATE_ERROR * late * accel) ** 2
        lasting = _SLIP_TIME * lasting + _RACE_TIME * (_RACING[2] * doubtful) ** 2
        proof = agreement.proves(jnp.where(is_proven & (spread > ANY), 0.0, state.proof), members, sure, dt)
        slow = jnp.where(jnp.abs(rolling) < DEAD_BAND, _SLOW[0], 0.0)
        noise = self.noise
        std = jnp.sqrt(noise**2 + lasting / since + slow**2 * jnp.maximum(_SLOW[1] / since, 1.0))
        return (
            state._replace(
                racing=racing,
                locked=locked,
                together=together,
                rolling=jnp.where(sound, rolling_speed, least),
                rolls=sound,
                proof=jnp.where(sound, NEVER, proof),
            ),
            jnp.where(seen.is_fresh[SPIN], rim, jnp.nan),
            std,
        )

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

    def touch(
        self,
        state: ContactState,
        seen: Signals,
        forces: AxleForces,
        speed: Array,
        rolling: tuple[Array, Array],
        accel: Array,
        banking: Array,
        spins: Array,
        dt: Array,
    ) -> tuple[ContactState, Touch]:
        """How the tires touch the road.

        Args:
            state: from :meth:`init` or the last call.
            seen: signals.
            forces: at this instant.
            speed: m/s.
            rolling: by what share the rolling radius exceeds the file's, and 1σ of a slip of all wheels.
            accel: its rate, m/s².
            banking, spins: as :class:`~roadstate.estimators.sideways.Touch` has them.
            dt: s.
        """
        moving = jnp.maximum(jnp.abs(speed), 1.0)
        steer = jnp.stack([seen.smooth[STEER] * jnp.sign(speed), jnp.zeros_like(speed)])
        load = jnp.maximum(forces.load, 0.05 * jnp.mean(forces.load))
        axles = by_axle(load)
        across = forces.across / axles
        sways = jnp.where(seen.age[ACCEL_Y] < STALE, self.sway * seen.rate[ACCEL_Y], 0.0)
        now = steer - (self.places * seen.smooth[YAW_RATE] + sways) / moving
        lag = self.relaxation / moving + _YIELDS
        radius = self.radius * (1 + rolling[0])
        late = seen.lag + _SENSED
        along = forces.along / load
        across_rate = (across - state.across) / SMOOTHING
        along_rate = (along - state.along) / SMOOTHING
        keep = -jnp.expm1(-dt / SMOOTHING)
        follows = -jnp.expm1(-dt / jnp.maximum(lag, 1e-3))
        angle = state.angle + follows * (now - state.angle)
        # of samples in steps of dt it is late by less than of a signal without
        lag = dt * (1 / jnp.maximum(follows, 1e-6) - 1)
        # what v_y gains while the low pass and then the tires lag
        gains = seen.smooth[ACCEL_Y] - speed * seen.smooth[YAW_RATE]
        slowed = state.lateral + follows * (gains - state.lateral)
        lateral = (late[YAW_RATE] * gains + lag * slowed) / (late[YAW_RATE] + lag)
        turn = steered_cosines(jnp.cos(seen.smooth[STEER]))
        # as late as the wheels' speeds are
        ground = (
            speed - (late[SPIN] + _WHEEL_DELAY) * accel - self.half_track * seen.smooth[YAW_RATE]
        ) / turn
        ground = jnp.where(jnp.abs(ground) < 1.0, jnp.where(ground < 0, -1.0, 1.0), ground)
        slip = jnp.clip((radius * seen.smooth[SPIN] - ground) / jnp.abs(ground), -1.0, 10.0)
        slip_rate = (slip - state.slip) / SMOOTHING
        slip_noise = self.white(seen) / jnp.abs(ground)
        stale = seen.age[SPIN] > STALE
        unknown = jnp.where(stale, jnp.inf, 0.0)
        steered = jnp.where(seen.age[STEER] < STALE, 0.0, jnp.asarray([jnp.inf, 0.0]))
        # anti-lock brakes shake a car along, swift steering across, but only a rough road both ways
        shaken = jnp.asarray(_SHAKEN, load.dtype) * jnp.min(forces.shaken) / GRAVITY
        touch = Touch(
            speed=speed,
            accel_y=seen.value[ACCEL_Y],
            yaw_rate=seen.value[YAW_RATE],
            yaw_accel=seen.rate[YAW_RATE],
            lateral=lateral,
            angle=angle,
            across=across,
            along=along,
            slip=jnp.where(stale, 0.0, slip),
            slip_std=rss(SLIP_ERROR, _SLIP_LAG * slip_rate),
            slip_noise=slip_noise,
            slip_shared=rolling[1],
            across_std=rss(forces.across_std, _LAG_ERROR * across_rate) + steered,
            along_std=rss(forces.along_std, _LAG_ERROR * along_rate) + unknown,
            split_std=forces.along_std,
            shaken=shaken,
            bears=load / jnp.repeat(axles, 2),
            lag=lag + late[YAW_RATE],
            banking=banking,
            spins=spins,
        )
        memory = state._replace(
            angle=angle,
            lateral=slowed,
            across=state.across + keep * (across - state.across),
            along=state.along + keep * (along - state.along),
            slip=state.slip + keep * (slip - state.slip),
        )
        return memory, touch
