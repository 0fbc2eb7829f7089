"""Where wheels and axles meet the road: how each tire slips."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from roadstate.core.constants import GRAVITY
from roadstate.estimators.axle_forces import AxleForces, by_axle, gains_aside, steered_cosines
from roadstate.estimators.base import leaf
from roadstate.estimators.force_balance import SWAY_ARM
from roadstate.estimators.intake import ACCEL_Y, SMOOTHING, SPIN, STALE, STEER, YAW_RATE, Signals
from roadstate.estimators.sideways import SLIP_ERROR, Touch
from roadstate.estimators.wheel_rims import WHEEL_DELAY
from roadstate.linalg import root, rss

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_SLIP_LAG = 0.025  # s by which force and slip are not of the same moment: 1σ
_SWIFT_TIME = 0.05  # s for which a slip that has changed fast counts as one that still does
_CALM = 0.2  # 1/s: how fast a slip may change without a bump
_SENSED = 0.005  # s by which a signal is older than when it comes
_USUAL = 0.0997  # variance that the low pass leaves of samples at 100 Hz, which other figures include
_TEETH = 0.2  # rad/s: 1σ of a wheel's sample by teeth out of place
_YIELDS = 0.01  # s: lag of the force behind the angle that suspension and steering add to the tire's
_LAG_ERROR = 0.015  # s: 1σ of that lag
# 1σ of forces along and across, low-passed, over g and load, as a share of the lesser of what a rough road
# shakes the accelerometers by both ways: tires bear more and less as they bounce
_SHAKEN = (1.3, 4.1)


class ContactState(NamedTuple):
    """What a :class:`TireContact` remembers.

    Attributes:
        angle, across: (2,) the axles' slip angles but for v_y, and their F_y/F_z, both slowed.
        lateral: what v̇_y would be on a level road and without biases, as slow as the angles, m/s².
        along, slip: (4,) F_x/F_z and slip of the wheels, slowed.
        swift: (4,) square of how fast the wheels' slips change or, fading, have changed, 1/s².
    """

    angle: Float[Array, " 2"]
    across: Float[Array, " 2"]
    lateral: Float[Array, ""]
    along: Float[Array, " 4"]
    slip: Float[Array, " 4"]
    swift: Float[Array, " 4"]


class TireContact(eqx.Module):
    """Slips of wheels and axles, from signals, forces and the car's speed.

    Attributes:
        radius: rolling radius, m.
        noise: 1σ of a wheel's speed, m/s.
        relaxation: relaxation length, m.
        places: (2,) of the axles ahead of the centre of gravity, m.
        height: of the centre of gravity over the road, m.
        sway: m by which the tires are left behind to the left as the body leans, per m/s² across.
        half_track: (4,) of the wheels to the left, m.
        shake: 1σ of white noise in a sample of the accelerometer, over g.
    """

    radius: Float[Array, ""]
    noise: Float[Array, ""]
    relaxation: Float[Array, ""]
    places: Float[Array, " 2"]
    height: Float[Array, ""]
    sway: Float[Array, ""]
    half_track: Float[Array, " 4"]
    shake: Float[Array, ""]

    def __init__(self, vehicle: Vehicle) -> None:
        geometry = vehicle.geometry
        self.radius = leaf(vehicle.wheels.radius)
        self.noise = leaf(vehicle.wheels.radius * vehicle.sensors.wheel_speed.noise)
        self.relaxation = leaf(vehicle.tires.relaxation_length)
        self.places = jnp.asarray([geometry.cg_to_front_axle, -geometry.cg_to_rear_axle])
        self.height = leaf(geometry.cg_height)
        self.sway = leaf(SWAY_ARM * geometry.cg_height * vehicle.body.roll_gradient)
        self.half_track = jnp.asarray(np.array(geometry.half_tracks))
        self.shake = leaf(vehicle.sensors.accel.noise_density / GRAVITY / (2 * SMOOTHING * _USUAL) ** 0.5)

    def init(self) -> ContactState:
        """Straight ahead and rolling."""
        two, four = jnp.zeros(2), jnp.zeros(4)
        return ContactState(two, two, jnp.zeros(()), four, four, four)

    def white(self, seen: Signals) -> Float[Array, " 4"]:
        """(4,) 1σ of white noise in the wheels' smooth speeds, m/s, beyond what samples at 100 Hz leave."""
        noise = jnp.maximum(seen.noise[SPIN] - _USUAL, 0.0)
        # one sample's error is the next's, turned round: of samples in a row the low pass leaves none
        teeth = seen.noise[SPIN] * jnp.minimum(noise / _USUAL, 1.0)
        return root(self.noise**2 * noise + (_TEETH * self.radius) ** 2 * teeth)

    def touch(
        self,
        state: ContactState,
        seen: Signals,
        forces: AxleForces,
        speed: Array,
        rolling: tuple[Array, Array],
        accel: Array,
        slope: Array,
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
            slope: sine of the road's.
            banking, spins: as :class:`~roadstate.estimators.sideways.Touch` has them.
            dt: s.
        """
        moving = jnp.maximum(jnp.abs(speed), 1.0)
        steer = jnp.stack([seen.smooth[STEER] * jnp.sign(speed), jnp.zeros_like(speed)])
        load = jnp.maximum(forces.load, 0.05 * jnp.mean(forces.load))
        axles = by_axle(load)
        across = forces.across / axles
        sways = jnp.where(seen.age[ACCEL_Y] < STALE, self.sway * seen.rate[ACCEL_Y], 0.0)
        # on a slope a car that turns about the vertical rolls, too, and at the road moves aside otherwise
        places = self.places + self.height * slope
        now = steer - (places * seen.smooth[YAW_RATE] + sways) / moving
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
        ahead = speed - (late[SPIN] + WHEEL_DELAY) * accel
        ground = (ahead - gains_aside(self.half_track, turn) * seen.smooth[YAW_RATE]) / turn
        ground = jnp.where(jnp.abs(ground) < 1.0, jnp.where(ground < 0, -1.0, 1.0), ground)
        slip = jnp.clip((radius * seen.smooth[SPIN] - ground) / jnp.abs(ground), -1.0, 10.0)
        # a wheel that hops is no surer of its slip at the turning points
        square = ((slip - state.slip) / SMOOTHING) ** 2
        fading = state.swift * jnp.exp(-dt / _SWIFT_TIME)
        swift = jnp.maximum(square, fading - _CALM**2)
        slip_noise = self.white(seen) / jnp.abs(ground)
        stale = seen.age[SPIN] > STALE
        unknown = jnp.where(stale, jnp.inf, 0.0)
        steered = jnp.where(seen.age[STEER] < STALE, 0.0, jnp.asarray([jnp.inf, 0.0]))
        # anti-lock brakes shake a car along, swift steering across, but only a rough road both ways
        shaken = jnp.asarray(_SHAKEN, load.dtype) * jnp.min(forces.shaken) / GRAVITY
        # the fewer samples, the less the low pass takes off their noise
        white = self.shake * root(seen.noise[ACCEL_Y])
        # an error of the loads that lasts is no noise: the friction that is found errs by as much
        bounces = forces.load_std[0]
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
            slip_std=rss(SLIP_ERROR, _SLIP_LAG * root(swift)),
            slip_noise=slip_noise,
            slip_shared=rolling[1],
            across_std=rss(forces.across_std, _LAG_ERROR * across_rate, bounces * across) + steered,
            along_std=rss(forces.along_std, _LAG_ERROR * along_rate, bounces * along) + unknown,
            split_std=forces.along_std,
            shaken=shaken.at[1].set(rss(shaken[1], white)),
            load=load / jnp.mean(load),
            lag=lag + late[YAW_RATE],
            banking=banking,
            spins=spins,
        )
        memory = ContactState(
            angle=angle,
            lateral=slowed,
            across=state.across + keep * (across - state.across),
            along=state.along + keep * (along - state.along),
            slip=state.slip + keep * (slip - state.slip),
            swift=jnp.maximum(square, fading),
        )
        return memory, touch
