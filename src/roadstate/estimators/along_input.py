"""What a car's signals tell the filter of its motion along the road, and how well."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from roadstate.core.constants import GRAVITY
from roadstate.core.gaussian import Info
from roadstate.core.kernel import once
from roadstate.estimators.along import BIAS, SLOPE, SPEED, AlongInput
from roadstate.estimators.axle_forces import AxleForces
from roadstate.estimators.base import Sample, leaf
from roadstate.estimators.contact_forces import CALM
from roadstate.estimators.intake import (
    ACCEL_X,
    ACCEL_Y,
    SMOOTHING,
    SPIN,
    STALE,
    WHEEL_SPEEDS,
    YAW_RATE,
    Signals,
)
from roadstate.estimators.noise_learning import NoiseLearner, Unrest
from roadstate.estimators.pitch import Pitching, lean_std
from roadstate.estimators.shortfall import Shortfall
from roadstate.estimators.sideways import SLOWEST
from roadstate.estimators.signals import NEVER, signed, span, way
from roadstate.estimators.traction import UNKNOWN
from roadstate.estimators.wheel_rims import ANY, Motion, Rims, RimState
from roadstate.linalg import root, rss

if TYPE_CHECKING:
    from roadstate.estimators.joint import JointState
    from roadstate.vehicles import Vehicle

_UNSEEN = 4.0  # m/s²/√Hz: of an acceleration that neither accelerometer nor torques tell
# m/s² per s of a gap in the log, and m/s²: 1σ of how the car sped up between the samples on either side
_BETWEEN = (0.5, 2.0)
_LOST = 1.0  # m/s: 1σ from which on the speed is lost
_HILLY = 0.08  # slope on which that changes the rate of climb
_FIRST = 0.01  # s that the first sample of all counts for
_AGE = 0.1  # s by which a receiver's rate of climb may be late
_JITTER = 0.02  # s: 1σ of what its speed is later or earlier than usual
_LEARNED = ("vertical_speed", "traction", "attitude")  # sensors whose noise is learned
_SIDEWAYS = 0.9  # of the speed may be v_y at the most
# m/s: 1σ of v_y beyond which v_y r is no slope's to bear; and √s: it errs as white noise of that many times
_SLIDES = (0.05, 2.0)
_BEND_TIME = 2.0  # s for which a bend lasts, and what r² pulls an accelerometer by that is not in the middle
_RECEIVED = ("latitude", "vertical_speed")  # channels that only a satellite receiver gives
_UNHEARD = 1.0  # s without a speed, which accelerations alone carry on no further
_MOVING = 2.0  # m/s from which sensors err as they usually do


class AlongIntake(eqx.Module):
    """Input, measurement and their noise for :class:`~roadstate.estimators.along.AlongModel`.

    Attributes:
        sensors: the model's.
        learned: places of those whose noise is learned.
        over_ground: whether the speed signal is a receiver's: level and where the car goes, not along its x.
        watches_brakes: whether torques tell of the drive, and nothing of brakes.
        rims: what each wheel tells of the speed.
        learner: of the noise.
        sensor_std: (m,) 1σ of a sample, as the vehicle file says.
        accel_noise: of the longitudinal accelerometer, m/s²/√Hz.
        ahead: of the centre of gravity sits the accelerometer, and 1σ of it, m.
        pitching: what a body that leans for good adds to a specific force, as a share of it.
    """

    sensors: tuple[str, ...] = eqx.field(static=True)
    learned: tuple[int, ...] = eqx.field(static=True)
    over_ground: bool = eqx.field(static=True)
    watches_brakes: bool = eqx.field(static=True)
    rims: Rims
    learner: NoiseLearner
    sensor_std: Float[Array, " m"]
    accel_noise: Float[Array, ""]
    ahead: Float[Array, " 2"]
    pitching: Float[Array, ""]

    def __init__(
        self, vehicle: Vehicle, sensors: tuple[str, ...], available: Collection[str], *, knows_brakes: bool
    ) -> None:
        own = vehicle.sensors
        self.over_ground = any(c in available for c in _RECEIVED)
        self.watches_brakes = "traction" in sensors and not knows_brakes
        noise = {
            "speed": own.speed.noise,
            "altitude": own.altitude.noise,
            "vertical_speed": own.vertical_speed.noise,
            "traction": 0.0,
            "attitude": 0.0,
        }
        wheel = vehicle.wheels.radius * own.wheel_speed.noise
        self.sensors = sensors
        self.learned = tuple(i for i, sensor in enumerate(sensors) if sensor in _LEARNED)
        self.rims, self.learner = Rims(vehicle), NoiseLearner()
        self.sensor_std = jnp.asarray(np.array([noise.get(s, wheel) for s in sensors]))
        self.accel_noise = leaf(own.accel.noise_density)
        self.ahead = jnp.asarray([own.accel.ahead, own.accel.ahead_std])
        self.pitching = leaf(GRAVITY * vehicle.body.pitch_gradient)

    def start(self) -> Unrest:
        """No innovation has come yet."""
        return self.learner.init(len(self.learned))

    def learn(self, state: JointState, info: Info, u: AlongInput, forces: AxleForces, dt: Array) -> Unrest:
        """How noisy the sensors are, as innovations say on the move and while forces are known."""
        unrest = state.unrest
        rows = jnp.asarray(self.learned, int)
        calm = jnp.asarray([self.sensors[i] != "traction" for i in self.learned], bool)
        stated = u.sensor_std[rows] / jnp.where(calm, self.learner.scale(unrest), 1.0)
        known = (forces.intensity < CALM) & ~state.shortfall.is_brake
        usual = (calm | known) & (jnp.abs(u.speed) > _MOVING)
        return self.learner.learn(unrest, info.innovation[rows], stated, usual, dt)

    def falls_short(
        self, state: JointState, info: Info, u: AlongInput, forces: AxleForces, dt: Array
    ) -> Shortfall:
        """What traction's innovation says of brakes that no channel tells of; nothing if one does.

        Who pulls away with less than foreseen has got in more than has been learnt yet, rather than brakes.
        """
        if not self.watches_brakes:
            return state.shortfall
        row = self.sensors.index("traction")
        load = state.loading.unsure * jnp.maximum(u.drive * way(u.speed), 0.0)
        std = root(jnp.maximum(info.S[row, row] - u.sensor_std[row] ** 2, 0.0) + forces.held**2 + load**2)
        return state.shortfall.take(info.innovation[row], std, way(u.speed), dt)

    def white(self, unrest: Unrest, forces: AxleForces) -> Float[Array, " 3"]:
        """White error of the accelerometer, of what torques tell of the wheels, and of wind, m/s²/√Hz.

        Whatever parts accelerometer and torques, none of them has more than that.

        Args:
            unrest: what has been learned of it.
            forces: of the instant.
        """
        torque = root(forces.intensity**2 - forces.gust**2)
        stated = jnp.stack([self.accel_noise, torque, forces.gust])
        found = self.learner.scale(unrest)[self.learned.index(self.sensors.index("traction"))]
        return jnp.minimum(stated, found * jnp.linalg.norm(stated))

    def moving(self, state: JointState, sample: Sample, seen: Signals, rolls: Array) -> Float[Array, ""]:
        """The speed at which air resists the car, and brakes slow or hold it, m/s.

        Before the filter knows of any, what wheels, or else a receiver, say; 0 where none has been heard for
        so long that the car may stand as well, or roll back, and brakes push either way.

        Args:
            state: of the whole, before this sample.
            sample: the channels.
            seen: signals of this instant.
            rolls: mean speed of the wheels, m/s.
        """
        other = sample["speed"] if "speed" in self.sensors else jnp.zeros(())
        told = jnp.any(seen.is_fresh[SPIN])
        first = jnp.where(told, rolls, jnp.where(jnp.isfinite(other), other, 0.0))
        known = state.along.gaussian
        lost = (state.speed_age > _UNHEARD) & (jnp.abs(known.mean[SPEED]) < 2 * known.std[SPEED])
        return jnp.where(state.speed_age < NEVER, jnp.where(lost, 0.0, known.mean[SPEED]), first)

    def read(
        self,
        state: JointState,
        seen: Signals,
        forces: AxleForces,
        sample: Sample,
        sideslip: Float[Array, " 2"],
        dt: Array,
        sign: Array,
        direction: Array,
    ) -> tuple[RimState, AlongInput, Float[Array, " m"]]:
        """Input and measurement of the filter.

        Args:
            state: of the whole, before this sample.
            seen: signals of this instant.
            forces: of this instant.
            sample: the channels, of which satellites' and the pitch rate are read.
            sideslip: v_y and its 1σ, m/s.
            dt: s.
            sign: by which the last sample of the longitudinal accelerometer is to be multiplied.
            direction: what an unsigned speed is to be multiplied by; NaN where that is not known.
        """
        x, spread = state.along.gaussian.mean, state.along.gaussian.std[SPEED]
        speed = x[SPEED]
        since = _since(state.signals.age, dt)
        felt = seen.age[ACCEL_X] < STALE
        turns = seen.age[YAW_RATE] < STALE
        before = sign * state.signals.value[ACCEL_X]
        before = before + jnp.where(turns, self.ahead[0] * seen.value[YAW_RATE] ** 2, 0.0)
        before = jnp.where(state.signals.age[ACCEL_X] < STALE, before, seen.value[ACCEL_X])
        raw = 0.5 * (seen.value[ACCEL_X] + before)
        lean = forces.lean.ahead(SMOOTHING)
        raw = lean.freed(raw, self.pitching)
        by_torque = ~felt & (forces.age < STALE) & (~forces.is_brake_unknown)
        accel = jnp.where(felt, raw, jnp.where(by_torque, forces.explained, x[SLOPE] + x[BIAS]))
        intensity = jnp.where(felt, self.accel_noise, jnp.where(by_torque, forces.intensity, _UNSEEN))
        between = jnp.clip(_BETWEEN[0] * (dt - STALE), 0.0, _BETWEEN[1]) * root(dt)
        # not what wheels make of it, one of which may spin
        bends = (seen.age[ACCEL_Y] < STALE) & (jnp.abs(speed) > SLOWEST)
        aside = seen.smooth[ACCEL_Y] / jnp.where(bends, speed, 1.0)
        turning = jnp.where(bends, aside, 0.0)
        turning = jnp.where(turns, seen.smooth[YAW_RATE], turning)
        u = AlongInput(
            accel=accel + sideslip[0] * turning,
            by_torque=by_torque,
            gaining=forces.accel[0] - x[SLOPE],
            lean=lean.accel,
            lasting=lean.lasting,
            drive=forces.drive,
            brake=forces.brake,
            rolling=forces.rolling,
            lever=forces.lever,
            turned=forces.turned,
            speed=speed,
            passing=speed + way(speed) * jnp.maximum(spread - _LOST, 0.0),
            intensity=intensity,
            smooth_across=forces.accel[1],
            turning=turning,
            pitching=Pitching(jnp.zeros(()), jnp.zeros(())),
            loading=state.loading,
            undulation=state.undulation,
            tilting=jnp.zeros(2),
            slip=self.rims.slips(forces.steady, forces.load),
            sensor_std=jnp.zeros(0),
        )
        swung = (2 * _BEND_TIME) ** 0.5 * self.ahead[1] * turning**2
        parts, stds = [], []
        wheels = [i for i, w in enumerate(WHEEL_SPEEDS) if w in self.sensors]
        rims = state.rims
        if wheels:
            gain = accel - x[SLOPE] - jnp.where(by_torque, 0.0, x[BIAS])
            car = Motion(speed, spread, gain, state.along.gaussian.std[SLOPE], turning)
            rims, rim, std = self.rims.read(rims, seen, forces, car, since[SPIN], dt)
            rim, std = rim[jnp.asarray(wheels)], std[jnp.asarray(wheels)]
            parts.append(rim)
            stds.append(std)
            # what a wheel's radius is off by is a share of the speed, which wheels tell at first
            heard = jnp.isfinite(rim)
            mean = jnp.sum(jnp.where(heard, rim, 0.0)) / jnp.maximum(jnp.sum(heard), 1)
            anew = (spread > ANY) & jnp.any(heard)
            u = u._replace(speed=jnp.where(anew, mean, speed), passing=jnp.where(anew, mean, u.passing))
        for name in ("speed", "altitude", "vertical_speed"):
            if name in self.sensors:
                value, std = sample[name], self.sensor_std[self.sensors.index(name)]
                if name == "speed":
                    value = signed(value, direction)
                    if self.over_ground:
                        value, unsure = _ahead(value, x[SLOPE], sideslip)
                        std = rss(std, unsure)
                    std = rss(std, _JITTER * u.gaining)
                if name == "vertical_speed":
                    swell = _AGE * u.gaining * x[SLOPE] / GRAVITY
                    std = rss(std, swell, _HILLY * between * root(dt))
                parts.append(jnp.where(jnp.isfinite(value), value, jnp.nan)[None])
                stds.append(std[None])
        if "traction" in self.sensors:
            told = seen.is_fresh[ACCEL_X] & (forces.age < STALE)
            more = forces.lean.freed(seen.smooth[ACCEL_X], self.pitching) - forces.explained
            parts.append(jnp.where(told, more, jnp.nan)[None])
            both = rss(forces.intensity, self.accel_noise, swung)
            both = jnp.where(state.shortfall.is_brake, UNKNOWN["brake"], both)
            stds.append((both / root(since[ACCEL_X]))[None])
            u = u._replace(intensity=jnp.where(felt, self.white(state.unrest, forces)[0], u.intensity))
        # where the car slides far, what is not known of v_y r is no slope
        slides = _SLIDES[1] * jnp.maximum(sideslip[1] - _SLIDES[0], 0.0) * jnp.abs(turning)
        u = u._replace(intensity=rss(u.intensity, between, slides, swung))
        if "attitude" in self.sensors:
            parts.append(jnp.zeros(1))  # where a pitch rate comes that is believed
            stds.append(lean_std(state.pitch, _since(state.pitch.gyro.rate.age, dt))[None])
        z, std = once((jnp.concatenate(parts), jnp.concatenate(stds)))
        last = len(self.learned)
        # what parts torques and accelerometer lasts for minutes, too: that is no white noise of the torques
        own = {i: k for k, i in enumerate(self.learned) if self.sensors[i] != "traction"}
        which = [own.get(i, last) for i in range(len(self.sensors))]
        std = std * jnp.append(self.learner.scale(state.unrest), 1.0)[np.array(which)]
        return rims, u._replace(sensor_std=std), z


def _since(age: Array, dt: Array) -> Array:
    """As :func:`~roadstate.estimators.signals.span`; of channels that nothing has come of, too."""
    return jnp.where(age < NEVER, span(age, dt, STALE), _FIRST)


def _ahead(
    speed: Float[Array, ""], slope: Float[Array, ""], sideslip: Float[Array, " 2"]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """v_x of a speed over level ground, and 1σ of what v_y leaves unsure of it.

    Args:
        speed: m/s, NaN where none is told.
        slope: g times the grade's sine, m/s².
        sideslip: v_y and its 1σ, m/s.
    """
    is_told = jnp.isfinite(speed)
    level = root(1 - jnp.clip(slope / GRAVITY, -0.5, 0.5) ** 2)
    whole = jnp.where(is_told, speed, 0.0) / level
    aside = jnp.clip(sideslip[0] / jnp.maximum(jnp.abs(whole), 1.0), -_SIDEWAYS, _SIDEWAYS)
    ahead = whole * root(1 - aside**2)
    return jnp.where(is_told, ahead, jnp.nan), jnp.abs(aside) * sideslip[1]
