"""DEBE: road grade from the driving equation, by an unscented Kalman filter."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from math import hypot
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
import jax.scipy.linalg as jsl
from jaxtyping import Array, Float, Int

from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.core.estimates import Validity
from roadstate.core.gaussian import Gaussian, Info
from roadstate.estimators.air import Air
from roadstate.estimators.astray import is_astray, led_back
from roadstate.estimators.axle_forces import held_back
from roadstate.estimators.base import Estimate, Estimator, Need, Sample, Smoothable, known_only, leaf
from roadstate.estimators.road import GradePrior
from roadstate.estimators.signals import (
    STANDSTILL_SPEED,
    Held,
    SpeedMeter,
    believable,
    random_walk_growth,
    signed_direction,
    way,
)
from roadstate.estimators.traction import UNKNOWN, TractionMeter, TractionState
from roadstate.estimators.unseen_brakes import BrakeWatch
from roadstate.filters import UKF, FilterState, GateRule
from roadstate.linalg import root, rss
from roadstate.statespace import StateSpaceModel

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_STALE = 3.0  # s without torque after which the drive counts as unknown
_SILENT = 3.0  # s without speed after which the estimate is called a prediction
_MODEL_NOISE = 0.05  # m/s²/√Hz: gusts, slip, driveline oscillation
_WANDER = 0.3  # m/s²/√s: how the drive's acceleration wanders while no torque is seen
_TORQUE_TIME = 0.1  # s: correlation time of the torque signal's noise
_BRAKE_TIME = 1.0  # s: of the error of a brake's force
_UNSEEN_BRAKE = 0.15  # m/s²: 1σ of a brake too light to be recognised, with the pedal released


class _Input(NamedTuple):
    accel: Float[Array, ""]
    gravity_share: Float[Array, ""]
    intensity: Float[Array, ""]
    age: Float[Array, ""]
    speed: Float[Array, ""]
    sensor_std: Float[Array, " m"]


class DrivingModel(StateSpaceModel):
    """x = [v_x, θ, dθ/d(distance)] and the driving equation (paper 002 eq. 37).

    m_e v̇_x = F − ½ρC_dA v_x|v_x| − m g (f_0 + f_2 v_x²) cos θ sgn v_x − m g sin θ − cornering drag, with m_e
    the mass and its rotating parts. The drive's acceleration comes in through ``u``.
    """

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    road: GradePrior
    drag: Float[Array, ""]
    rolling: Float[Array, ""]
    rolling_speed: Float[Array, ""]

    def resistance(self, speed: Float[Array, ""], grade: Float[Array, ""]) -> Float[Array, ""]:
        """Air and rolling resistance per mass (m/s²), with the sign of the speed (smooth through zero)."""
        rolling = GRAVITY * (self.rolling + self.rolling_speed * speed**2) * jnp.cos(grade)
        return self.drag * speed * jnp.abs(speed) + rolling * jnp.tanh(speed / 0.3)

    def f(self, x: Float[Array, " n"], u: _Input, dt: Float[Array, ""]) -> Float[Array, " n"]:
        """Explicit Euler in v (the noise allows no finer), exact in the road."""
        resisting = self.resistance(x[0], x[1]) + GRAVITY * jnp.sin(x[1])
        speed = x[0] + (u.accel - u.gravity_share * resisting) * dt
        road = self.road.transition(u.speed * dt) @ x[1:3]
        return jnp.concatenate([speed[None], road])

    def h(self, x: Float[Array, " n"], u: _Input) -> Float[Array, " m"]:
        """Every sensor reads the speed."""
        return jnp.full(len(self.sensors), x[0])

    def sqrt_Q(self, u: _Input, dt: Float[Array, ""]) -> Float[Array, "n n"]:
        """Force that is not known, force last seen ``age`` ago, and the road."""
        variance = u.intensity**2 * dt + _WANDER**2 * random_walk_growth(u.age, dt)
        return jnp.asarray(jsl.block_diag(root(variance)[None, None], self.road.sqrt_Q(u.speed * dt)))

    def sqrt_R(self, u: _Input) -> Float[Array, "m m"]:
        """Independent sensors."""
        return jnp.diag(u.sensor_std)

    def prior(self) -> Gaussian:
        """Any speed a road car has, and the road's own grade."""
        std = jnp.concatenate([jnp.asarray([30.0]), self.road.stationary_std])
        return Gaussian(jnp.zeros(3), jnp.diag(std))


class DEBEState(NamedTuple):
    """Filter state, held inputs, what the driveline did, and the latest validity.

    ``force_error`` is the 1σ (in units of g) that parameters not known exactly add to the grade.
    """

    filter: FilterState
    traction: TractionState
    yaw_rate: Held
    steer: Held
    accel: Held
    gear_ratio: Held
    brakes: BrakeWatch
    speed_age: Float[Array, ""]
    force_error: Float[Array, ""]
    validity: Int[Array, ""]


class DEBE(Estimator[DEBEState]):
    """Driving-equation-based estimator of road grade (paper 002's second rival, eq. 37).

    Needs speed and the drive's torque: at the wheels, or the engine's with its gear ratio or speed. While
    brakes act with a force that is not known, or a gear changes, the force's noise is inflated: the road's
    prior carries the grade on, its interval widens, and ``validity`` says why. Where no brake channel is
    mapped, brakes are recognised from ``accel_x`` if that is there: specific force is all that tires and air
    do, whatever the slope, so what falls short of the drive's is the brakes'; with neither, a drive that
    hardly pulls is taken for a possible brake.

    Beyond the paper: rotating inertia, rolling resistance growing with speed, overrun losses, and cornering
    drag a_y (l_r α_f + l_f α_r)/L from the yaw rate. Errors of mass, efficiency, drag and rolling resistance,
    and a wind, do not average out; the vehicle file's 1σ of each is part of every standard deviation given.

    Attributes:
        model: the state-space model.
        filter: the unscented filter.
        meter: how speed is read.
        traction: how force is read.
    """

    name: ClassVar[str] = "debe"
    summary: ClassVar[str] = "grade from speed and drive torque (UKF, driving equation)"
    needs: ClassVar[tuple[Need, ...]] = (
        Need("a speed", (("speed",), *((f"wheel_speed_{w}",) for w in WHEELS))),
        Need(
            "a drive torque",
            (
                ("drive_torque_fl", "drive_torque_fr"),
                ("drive_torque_rl", "drive_torque_rr"),
                ("engine_torque", "gear_ratio"),
                ("engine_torque", "engine_speed"),
                ("engine_torque",),
            ),
        ),
    )
    optional: ClassVar[tuple[str, ...]] = (
        *("yaw_rate", "steer", "steering_wheel", "accel_x", "gear_ratio", "brake"),
        *(f"{kind}_{w}" for kind in ("brake_torque", "brake_pressure") for w in WHEELS),
    )
    smoothable: ClassVar[Smoothable | None] = Smoothable("filter", "filter", ("grade", "speed"))

    channels: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    model: DrivingModel
    filter: UKF
    meter: SpeedMeter
    traction: TractionMeter
    mass: Float[Array, ""]
    cornering_drag: Float[Array, ""]
    front_share: Float[Array, ""]
    drive_relative: Float[Array, ""]
    torque_bias: Float[Array, ""]
    air: Air
    rolling_std: Float[Array, ""]
    speed_scale: Float[Array, ""]

    @property
    def sensor_units(self) -> Mapping[str, str]:
        """As :attr:`Estimator.sensor_units`."""
        return {**super().sensor_units, **self.meter.sensor_units}

    @classmethod
    def build(cls, vehicle: Vehicle, available: Collection[str], **options: Any) -> Self:
        """Compose for a vehicle and the channels there.

        Raises:
            InputError: engine torque without a gear ratio or engine speed on a car with several gears.
        """
        known_only(options, ())
        meter = SpeedMeter(vehicle, available)
        traction = TractionMeter(vehicle, available)
        tires, prior = vehicle.tires, vehicle.prior
        front_share = vehicle.geometry.cg_to_rear_axle / vehicle.wheelbase
        torque = (
            vehicle.sensors.wheel_torque if traction.source == "wheels" else vehicle.sensors.engine_torque
        )
        measured = sum(c.startswith("drive_torque") for c in traction.channels)
        model = DrivingModel(
            states=("speed", "grade", "grade_rate"),
            sensors=meter.sensors,
            road=GradePrior(leaf(prior.grade_std), leaf(prior.grade_correlation_length)),
            drag=leaf(vehicle.drag_factor / vehicle.mass),
            rolling=leaf(vehicle.rolling_resistance.coefficient),
            rolling_speed=leaf(vehicle.rolling_resistance.speed_coefficient),
        )
        used = [c for c in ("yaw_rate", "accel_x") if c in available]
        if traction.knows_brakes and "accel_x" in used:
            used.remove("accel_x")
        return cls(
            channels=tuple(dict.fromkeys((*meter.channels, *traction.channels, *used))),
            sensors=meter.sensors,
            model=model,
            filter=UKF(gate=GateRule()),
            meter=meter,
            traction=traction,
            mass=leaf(vehicle.mass),
            cornering_drag=leaf(
                front_share / tires.cornering_stiffness_front
                + (1 - front_share) / tires.cornering_stiffness_rear
            ),
            front_share=leaf(front_share),
            drive_relative=leaf(hypot(torque.relative, prior.mass_relative)),
            torque_bias=leaf(torque.bias * max(measured, 1) ** 0.5),
            air=Air(vehicle),
            rolling_std=leaf(prior.rolling_resistance_std),
            speed_scale=leaf(vehicle.sensors.wheel_speed.scale),
        )

    def init(self) -> DEBEState:
        """The prior; no sample has come."""
        empty, zero = Held.empty(), jnp.zeros(())
        validity = jnp.asarray(int(Validity.SENSOR_MISSING))
        start = self.filter.init(self.model)
        traction, brakes = self.traction.init(), BrakeWatch.none()
        return DEBEState(start, traction, empty, empty, empty, empty, brakes, empty.age, zero, validity)

    def step(self, state: DEBEState, sample: Sample, dt: Float[Array, ""]) -> tuple[DEBEState, Info]:
        """Predict with the drive's force, correct with the speed."""
        nothing, sample = jnp.full((), jnp.nan), believable(sample)
        speed, grade = state.filter.gaussian.mean[0], state.filter.gaussian.mean[1]
        yaw_rate = state.yaw_rate.take(sample.get("yaw_rate", nothing), dt)
        steer = state.steer.take(self.meter.steer(sample), dt)
        accel = state.accel.take(sample.get("accel_x", nothing), dt)
        gear = state.gear_ratio.take(sample.get("gear_ratio", nothing), dt)
        traction_state, drive = self.traction.read(state.traction, sample, speed, dt)
        lateral = speed * jnp.where(yaw_rate.age < _STALE, yaw_rate.value, 0.0)
        cornering = self.cornering_drag * lateral**2 / GRAVITY * jnp.tanh(speed / STANDSTILL_SPEED)
        known = drive.age < _STALE
        push = jnp.where(known, drive.force / self.mass, 0.0)
        # of what cornering costs an accelerometer tells what the front tires hold back, and no v_y r
        bend = held_back(lateral, jnp.where(steer.age < _STALE, steer.value, 0.0), self.front_share)
        share = self.mass / drive.inertia
        resists = self.model.resistance(speed, grade) + bend
        explained = share * (push - resists) + (1 - share) * GRAVITY * jnp.sin(grade)
        watch = state.brakes.take(accel, explained, drive.drive_force / self.mass, way(speed), dt)
        unseen = watch.unseen(drive, self.traction.knows_brakes, accel.age < _SILENT)
        unknown = unseen.act
        if not (self.traction.knows_brakes or "accel_x" in self.channels):
            unknown = watch.coasting
        braking = drive.is_braking if self.traction.knows_brakes else unknown
        stands = jnp.abs(speed) < STANDSTILL_SPEED
        intensity = rss(
            _MODEL_NOISE,
            drive.torque_std / self.mass * _TORQUE_TIME**0.5,
            drive.held_noise / self.mass,
            drive.brake_std / self.mass * _BRAKE_TIME**0.5,
            jnp.where(drive.is_shifting, UNKNOWN["shift"], 0.0),
            jnp.where(unknown | unseen.may_act, UNKNOWN["brake"], 0.0),
            jnp.where(known & ~stands, 0.0, UNKNOWN["drive"]),
        )
        speeds, speed_std = self.meter.read(
            sample,
            jnp.where(yaw_rate.age < _STALE, yaw_rate.value, 0.0),
            steer.value,
            signed_direction(gear.value),
        )
        u = _Input(
            accel=share * (push - cornering),
            gravity_share=share,
            intensity=intensity,
            age=jnp.clip(drive.age - dt, 0.0, _STALE),
            speed=speed,
            sensor_std=speed_std,
        )
        filter_state, info = self.filter.step(self.model, state.filter, u, speeds, dt)
        mean = filter_state.gaussian.mean
        astray = is_astray(filter_state.gaussian, mean[0], GRAVITY * mean[1])
        filter_state = led_back(astray, self.model.prior(), filter_state)
        speed_age = jnp.where(jnp.any(jnp.isfinite(speeds)), 0.0, state.speed_age + dt)
        validity = jnp.where(drive.is_shifting, int(Validity.GEAR_SHIFT), int(Validity.EXCITED))
        validity = jnp.where(braking, int(Validity.BRAKING), validity)
        validity = jnp.where(
            jnp.abs(filter_state.gaussian.mean[0]) < STANDSTILL_SPEED, int(Validity.STANDSTILL), validity
        )
        validity = jnp.where(known & (speed_age < _SILENT), validity, int(Validity.SENSOR_MISSING))
        validity = jnp.where(info.ok & ~astray, validity, int(Validity.DIVERGED))
        error = jnp.sqrt(
            (self.drive_relative * drive.drive_force / (self.mass * GRAVITY)) ** 2
            + (self.torque_bias * drive.lever / (self.mass * GRAVITY)) ** 2
            + (self.air.std(speed) / GRAVITY) ** 2
            + self.rolling_std**2
            + jnp.where(watch.coasting & (not self.traction.knows_brakes), _UNSEEN_BRAKE / GRAVITY, 0.0) ** 2
        )
        new = DEBEState(
            filter_state, traction_state, yaw_rate, steer, accel, gear, watch, speed_age, error, validity
        )
        return new, info

    def estimate(self, state: DEBEState) -> Estimate:
        """Grade and speed."""
        gaussian = self.filter.posterior(state.filter)
        mean, std = gaussian.mean, gaussian.std
        return Estimate(
            {"grade": mean[1], "speed": mean[0]},
            {
                "grade": rss(std[1], state.force_error),
                "speed": rss(std[0], self.speed_scale * mean[0]),
            },
            state.validity,
        )
