"""From samples to tire forces: what TFOBE's lower layer is fed with, and how far it is believed."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.core.gaussian import Info
from roadstate.estimators.air import Air
from roadstate.estimators.axle_forces import held_back
from roadstate.estimators.base import Sample, leaf
from roadstate.estimators.signals import (
    STANDSTILL_SPEED,
    Held,
    SpeedMeter,
    signed,
    signed_direction,
    span,
    way,
)
from roadstate.estimators.tire_forces import (
    BRAKE_RELATIVE,
    FORCE_X,
    FORCE_Y,
    SLOW,
    ForceInput,
    TireForceModel,
)
from roadstate.estimators.traction import UNKNOWN, Traction, TractionMeter, TractionState
from roadstate.estimators.unseen_brakes import BrakeWatch
from roadstate.filters import FilterState, GateRule
from roadstate.filters.marginal import MarginalUKF
from roadstate.linalg import rss

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

FELT = ("accel_x", "accel_y", "yaw_rate")
_STALE = 0.5  # s without a torque or an acceleration after which it counts as unknown
_TORQUE_TIME = 0.1  # s: correlation time of the torque signals' noise
_TORQUE_DELAY = 0.03  # s by which a torque signal may be late
_JERK = (3.0, 15.0)  # m/s²/√s: how the longitudinal specific force wanders; about to stand
_CRAWL = 1.0  # m/s under which a brake's torque may be anything up to what it could be
_SMOOTHING = 0.15  # s: low pass of the torques that gains multiply
_UNEVEN = 0.01  # m/s²/√Hz: what the road's unevenness does to the force that torques tell
_GUST = 3.0  # m/s/√Hz: a wind that varies by 1 m/s over 5 s
_SHARE_ERROR = (0.1, 0.02)  # of an axle's lateral force, and of load: 1σ of its distribution to the sides
_CG_ERROR = 0.02  # 1σ of the share of an axle in the lateral force


class ForceState(NamedTuple):
    """State of a :class:`ForceObserver`.

    ``smooth`` (10,) are drive and brake torques of each wheel (N·m) and the specific force along and across
    (m/s²), low-passed.
    """

    filter: FilterState
    traction: TractionState
    held: dict[str, Held]
    brakes: BrakeWatch
    smooth: Float[Array, " 10"]


class Forces(NamedTuple):
    """What the lower layer says at one instant.

    Attributes:
        u: what it knew.
        steer: mean front road-wheel angle, rad.
        load: (4,) vertical loads, N.
        accel: (2,) specific force along and across, m/s².
        slow_std: 1σ of that part of the first one's error that does not average out, m/s².
        intensity: of the rest of it, m/s²/√Hz.
        wheel_speed: (4,) with the sign of the direction, rad/s, 0 where missing.
        is_seen: (4,) whether a wheel speed is there.
        age: s since the channel silent for the longest was seen, wheels excepted.
        is_shifting, is_brake_unknown: as :class:`~roadstate.estimators.traction.Traction`.
    """

    u: ForceInput
    steer: Float[Array, ""]
    load: Float[Array, " 4"]
    accel: Float[Array, " 2"]
    slow_std: Float[Array, ""]
    intensity: Float[Array, ""]
    wheel_speed: Float[Array, " 4"]
    is_seen: Bool[Array, " 4"]
    age: Float[Array, ""]
    is_shifting: Bool[Array, ""]
    is_brake_unknown: Bool[Array, ""]


class ForceObserver(eqx.Module):
    """The lower layer: :class:`TireForceModel` with its filter, fed from canonical channels.

    Attributes:
        channels: canonical channels read.
        model: the state-space model.
        filter: its filter.
    """

    channels: tuple[str, ...] = eqx.field(static=True)
    torque_relative: float = eqx.field(static=True)
    model: TireForceModel
    filter: MarginalUKF
    _traction: TractionMeter
    _lean: Float[Array, " 3"]
    _accel_noise: Float[Array, ""]
    _sample_std: Float[Array, " 2"]
    _driven: Float[Array, " 4"]
    _largest_torque: Float[Array, ""]
    _air: Air
    _tilt: Float[Array, ""]

    def __init__(self, vehicle: Vehicle, available: Collection[str]) -> None:
        traction, sensors = TractionMeter(vehicle, available), vehicle.sensors
        torque = sensors.wheel_torque if traction.source == "wheels" else sensors.engine_torque
        measured = any(c.startswith("brake_torque") for c in traction.channels)
        self.channels = (*traction.channels, *FELT)
        self.torque_relative = torque.relative
        self.model = TireForceModel(vehicle, torque.relative, torque.relative if measured else BRAKE_RELATIVE)
        self.filter = MarginalUKF(gate=GateRule())
        self._traction = traction
        body = vehicle.body
        self._lean = jnp.asarray(1 + GRAVITY * np.array([body.pitch_gradient, body.roll_gradient, 0.0]))
        self._accel_noise = leaf(sensors.accel.noise_density)
        self._sample_std = jnp.asarray(np.array([sensors.yaw_rate.noise, sensors.wheel_speed.noise]))
        driven = np.array(vehicle.driveline.drives)
        self._driven = jnp.asarray(driven / driven.sum())
        self._largest_torque = leaf(0.7 * vehicle.mass * GRAVITY * vehicle.wheels.radius)
        self._air, self._tilt = Air(vehicle), leaf(sensors.accel.bias / GRAVITY)

    def init(self) -> ForceState:
        """The prior; no sample has come."""
        held = {name: Held.empty() for name in (*FELT, "steer", "gear_ratio")}
        start = self.filter.init(self.model)
        return ForceState(start, self._traction.init(), held, BrakeWatch.none(), jnp.zeros(10))

    def step(
        self,
        state: ForceState,
        sample: Sample,
        steer: Float[Array, ""],
        speed: Float[Array, ""],
        dt: Float[Array, ""],
    ) -> tuple[ForceState, Forces, Info]:
        """Take a sample ``dt`` after the last.

        Args:
            state: from :meth:`init` or the last call.
            sample: the channels at this instant.
            steer: mean front road-wheel angle, rad, NaN where missing.
            speed: m/s, the upper layer's estimate so far.
            dt: s.
        """
        nothing = jnp.full((), jnp.nan)
        fresh = {**{name: sample[name] for name in FELT}, "steer": steer}
        fresh["gear_ratio"] = sample.get("gear_ratio", nothing)
        held = {name: state.held[name].take(value, dt) for name, value in fresh.items()}
        traction, drive = self._traction.read(state.traction, sample, speed, dt)
        torque = jnp.clip(drive.drive_torque, -self._largest_torque, self._largest_torque)
        braking = jnp.minimum(drive.brake_torque, self._largest_torque) * jnp.tanh(speed / STANDSTILL_SPEED)
        lag = -jnp.expm1(-dt / _SMOOTHING)
        smooth = state.smooth[:8] + lag * (jnp.concatenate([torque, braking]) - state.smooth[:8])
        car = self.model.vehicle
        radius, mass = car.wheel_radius[0], car.mass
        push = jnp.sum(torque) / (radius * mass)
        gentle = jnp.sum(smooth[:4]) / (radius * mass)
        angle = jnp.clip(held["steer"].value, -0.9, 0.9)
        drag = car.drag(speed) / mass
        bend = held_back(held["accel_y"].value / self._lean[1], angle, car.cg_to_rear_axle / car.wheelbase)
        coefficient = car.rolling_coefficient(speed)
        rolls = jnp.tanh(speed / STANDSTILL_SPEED)
        turns_up = (drive.inertia / mass - 1) * state.smooth[8]  # but for what a slope does to it
        explained = push - drag - bend - GRAVITY * coefficient * rolls - turns_up
        brakes = state.brakes.take(held["accel_x"], explained, gentle, way(speed), dt)
        unseen = brakes.unseen(drive, self._traction.knows_brakes, held["accel_x"].age < _STALE)
        turning = jnp.stack([sample[f"wheel_speed_{w}"] for w in WHEELS])
        seen = jnp.isfinite(turning)
        turning = jnp.where(seen, turning, 0.0)  # a NaN would spoil the derivative by any factor of it
        turning = signed(turning, signed_direction(held["gear_ratio"].value))
        jump = torque - braking - smooth[:4] + smooth[4:]
        noise = self._torque_noise(drive, jump, unseen.may_act, speed)
        step = span(jnp.stack([state.held[n].age for n in FELT[:2]]), dt, _STALE)
        load = self._load(state)
        rolling = load * radius * rolls
        u = ForceInput(
            gain=self.model.gain(angle),
            drag=drag,
            torque=torque - braking - coefficient * rolling,
            drive_torque=state.smooth[:4],
            brake_torque=state.smooth[4:8],
            accel_x=state.smooth[8],
            rolling=rolling,
            engine=drive.engine * self._driven,
            torque_noise=noise,
            force_noise=jnp.abs(jump) / (radius * _SMOOTHING**0.5),
            jerk=jnp.where(jnp.abs(speed) < _CRAWL, _JERK[1], _JERK[0]),
            sensor_std=jnp.concatenate(
                [self._accel_noise / jnp.sqrt(step), self._sample_std[jnp.asarray([0, 1, 1, 1, 1])]]
            ),
        )
        felt = jnp.stack([held[n].value for n in FELT]) / self._lean
        seen = jnp.concatenate([jnp.stack([held[n].age == 0 for n in FELT]), seen])
        z = jnp.where(seen, jnp.concatenate([felt, turning]), jnp.nan)
        filtered, info = self.filter.step(self.model, state.filter, u, z, dt)
        accel = self.model.specific_force(filtered.gaussian.mean, u)
        rows = filtered.gaussian.factor[FORCE_X.start :, :SLOW]
        slow = jnp.sqrt(
            jnp.sum(jnp.sum(u.gain[0][:, None] * rows, axis=0) ** 2)
            + self._air.std(speed) ** 2
            + (self._tilt * accel[1]) ** 2
        )
        by_torque = jnp.sqrt(jnp.sum(noise**2)) / (radius * mass)
        by_accel = jnp.where(held["accel_x"].age < _STALE, self._accel_noise, 10 * UNKNOWN["brake"])
        forces = Forces(
            u=u,
            steer=angle,
            load=load,
            accel=accel,
            slow_std=slow,
            intensity=by_torque * by_accel / rss(by_torque, by_accel),
            wheel_speed=turning,
            is_seen=seen[len(FELT) :],
            age=jnp.max(jnp.stack([drive.age, *(h.age for n, h in held.items() if n != "gear_ratio")])),
            is_shifting=drive.is_shifting,
            is_brake_unknown=unseen.act,
        )
        smooth = jnp.concatenate([smooth, state.smooth[8:] + lag * (accel - state.smooth[8:])])
        return ForceState(filtered, traction, held, brakes, smooth), forces, info

    def _load(self, state: ForceState) -> Float[Array, " 4"]:
        """(4,) vertical loads under the smoothed specific force, N."""
        return self.model.vehicle.wheel_loads(state.smooth[8], state.smooth[9])

    def _torque_noise(
        self,
        drive: Traction,
        jump: Float[Array, " 4"],
        may_brake: Bool[Array, ""],
        speed: Float[Array, ""],
    ) -> Float[Array, " 4"]:
        """Intensity of what is not known of each wheel's torque, N·m/√Hz.

        Args:
            drive: what drives the car.
            jump: (4,) torque less its smoothed value, N·m.
            may_brake: brakes act, or may, with a torque that no channel tells.
            speed: m/s.
        """
        car = self.model.vehicle
        rim = car.mass * car.wheel_radius[0]
        is_open = jnp.where(drive.is_shifting, UNKNOWN["shift"], 0.0)
        lost = jnp.where(drive.age < _STALE, is_open, UNKNOWN["drive"]) * rim
        white = rss(drive.torque_std * _TORQUE_TIME**0.5, drive.held_noise) * car.wheel_radius[0]
        # what does not depend on the torques, gusts at first: twice the relative change of the wind
        gust = 2 * car.drag(speed) / car.mass / jnp.maximum(jnp.abs(speed), 1.0) * _GUST
        model = rss(_UNEVEN, gust) * rim
        late = jump * (_TORQUE_DELAY / _SMOOTHING * _TORQUE_TIME**0.5)
        # a wheel that stands is held by any torque up to its brake's
        held = jnp.where(jnp.abs(speed) < _CRAWL, UNKNOWN["brake"], 0.0)
        brake = jnp.where(may_brake, UNKNOWN["brake"], held) * rim
        return jnp.sqrt(0.25 * (model**2 + brake**2) + late**2 + self._driven * (white**2 + lost**2))

    quantities: ClassVar[tuple[str, ...]] = tuple(
        f"force_{axis}_{where}" for axis in ("x", "y") for where in (*WHEELS, "front", "rear")
    )
    """Names of what :meth:`by_wheel_and_axle` gives."""

    def by_wheel_and_axle(self, state: ForceState) -> tuple[Float[Array, " 12"], Float[Array, " 12"]]:
        """Forces (12,) and their 1σ in N, in the order of :attr:`quantities`, for a car of the file's mass.

        Nothing tells an axle's lateral force on its left wheel from that on its right: it is distributed as
        the load is, and the standard deviations of the wheels say so.
        """
        load, gaussian = self._load(state), state.filter.gaussian
        axle_load = load.reshape(2, 2).sum(axis=1)
        share = load / jnp.maximum(jnp.repeat(axle_load, 2), 1.0)
        mean, rows = gaussian.mean, gaussian.factor
        along, across = mean[FORCE_X], mean[FORCE_Y]
        along_rows, across_std = rows[FORCE_X], gaussian.std[FORCE_Y]
        axles = along.reshape(2, 2).sum(axis=1)
        axle_std = jnp.sqrt(jnp.sum(along_rows.reshape(2, 2, -1).sum(axis=1) ** 2, axis=1))
        across_std = rss(across_std, _CG_ERROR * jnp.sum(across) * jnp.ones(2))
        whole = jnp.repeat(across, 2)
        split = rss(_SHARE_ERROR[0] * whole, _SHARE_ERROR[1] * load)
        wheel_std = rss(share * jnp.repeat(across_std, 2), split)
        values = jnp.concatenate([along, axles, share * whole, across])
        return values, jnp.concatenate([gaussian.std[FORCE_X], axle_std, wheel_std, across_std])


def meter_sample(sample: Sample, wheels: Float[Array, " 4"], meter: SpeedMeter) -> Sample:
    """The sample a speed meter reads, with these wheel speeds (rad/s)."""
    rolling = {f"wheel_speed_{w}": wheels[i] for i, w in enumerate(WHEELS)}
    return {**{c: sample[c] for c in meter.channels}, **rolling}
