"""Joint estimator of grade, bank, tire forces and friction, and of the car's own figures."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.core.estimates import Validity
from roadstate.core.gaussian import Info
from roadstate.core.kernel import once
from roadstate.estimators.agreement import is_proven, refutes
from roadstate.estimators.along import BIAS, SCALE, SLOPE, SPEED, AlongModel
from roadstate.estimators.along_input import AlongIntake
from roadstate.estimators.astray import WRONG, is_astray, outvoted
from roadstate.estimators.axle_forces import AxleForces
from roadstate.estimators.base import Estimate, Estimator, Need, Sample, Smoothable, known_only, leaf
from roadstate.estimators.contact_forces import ForceMeter, ForceMeterState
from roadstate.estimators.direction import Direction, DirectionState
from roadstate.estimators.friction_bank import BankState, FrictionBank
from roadstate.estimators.intake import (
    ACCEL_X,
    ACCEL_Y,
    REPEATS,
    ROWS,
    SPIN,
    STALE,
    WHEEL_SPEEDS,
    YAW_RATE,
    Intake,
    Signals,
    SignalState,
    sensor_fault_names,
)
from roadstate.estimators.joint_output import told, validity_of
from roadstate.estimators.loading import Loading
from roadstate.estimators.noise_learning import Unrest
from roadstate.estimators.pace import Pace
from roadstate.estimators.pitch import PitchMeter, PitchState
from roadstate.estimators.plausibility import TORQUE, Plausibility, PlausibilityState
from roadstate.estimators.radii import Radii, RadiiState
from roadstate.estimators.redundancy import GROUP, YAW
from roadstate.estimators.roll import RollMeter, RollState
from roadstate.estimators.shortfall import Shortfall
from roadstate.estimators.sideways import BANK, LEVER, V_Y
from roadstate.estimators.signals import NEVER
from roadstate.estimators.tire_contact import ContactState, TireContact
from roadstate.estimators.watch import Watch, WatchState
from roadstate.estimators.wheel_forces import WheelSharing
from roadstate.estimators.wheel_rims import RimState
from roadstate.filters import EKF, FilterState, GateRule
from roadstate.filters.base import select
from roadstate.linalg import root, rss

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_FAULTY = 0.3  # s of a refused or stuck sensor after which it is called faulty
_PAUSE = 0.2  # s: what a gap of the whole log counts for of these
_BOUNDS = (0.05, 0.95)
_TURNS = ("pitch_rate", "roll_rate")
_LEAST_STEP = 1e-3  # s
_AFRESH = 0.4  # s until what is slowed has forgotten a sensor that lied
_LATE_TIME = 0.5  # s: how long an error of a late signal lasts
_LAGS = 0.1  # s by which the accelerometer may be late when the gyroscope is no longer judged by it
_TURNS_HARD = 2.0  # m/s² across at which v_y r, without a yaw rate, may be a slope's part
_PATIENCE = 300  # samples for which a spinning or locked wheel may be refused
_CONFIRMED = 3.0  # samples of a speed signal, in a row, that wheels confirm and the filter contradicts
_ROLLED = 0.2  # s for which wheels that roll freely contradict it, which count as much as one of these


class JointState(NamedTuple):
    """State of :class:`Joint`.

    Attributes:
        watch, signals, direction, radii, trust, forces, rims, along, contact, bank, pace, pitch, roll,
            unrest, loading, shortfall: the parts'.
        speed_age: s since anything told the speed.
        against: samples of the speed signal, in a row, that the wheels confirm and the filter contradicts;
            or how many of them wheels that roll freely are worth.
        doubt: s for which nothing is learnt of friction yet, since a sensor was caught.
        fault_age: (13 + m,) s for which each inertial, steering and wheel signal has been refused or stuck,
            each wheel turned round, and each of the filter's sensors and the roll rate refused.
        latest: what the forces were, for :meth:`Joint.estimate`.
        friction: (3, 5) of each view's friction: the 5 % quantile, the likeliest, the 95 % quantile.
        validity: code.
    """

    watch: WatchState
    signals: SignalState
    direction: DirectionState
    radii: RadiiState
    trust: PlausibilityState
    forces: ForceMeterState
    rims: RimState
    along: FilterState
    contact: ContactState
    bank: BankState
    pace: Pace
    pitch: PitchState
    roll: RollState
    unrest: Unrest
    loading: Loading
    shortfall: Shortfall
    speed_age: Float[Array, ""]
    against: Float[Array, ""]
    doubt: Float[Array, ""]
    fault_age: Float[Array, " k"]
    latest: AxleForces
    friction: Float[Array, "3 5"]
    validity: Int[Array, ""]


class Joint(Estimator[JointState]):
    """Grade, bank, forces, friction and the car's own figures, of whatever channels there are.

    Three parts that inform each other at every sample, each exact for what it holds:

    - :class:`~roadstate.estimators.along.AlongModel`, an extended Kalman filter of speed and slope in which
      accelerometer, wheels, torques and satellites meet, and what they disagree by (bias, pitch and scale,
      mass, gains of drive and brakes, drag, wind, rolling resistance and radius) is learned;
    - :class:`~roadstate.estimators.contact_forces.ForceMeter`, a balance of forces that needs no tire model;
    - :class:`~roadstate.estimators.friction_bank.FrictionBank`, which asks of every friction at once how well
      it goes with these forces, given the slip: sideslip, bank, stiffness and shape of the tires are
      estimated under each.

    Which states there are follows from the channels. Needs an accelerometer and a speed (of wheels, or a
    speed signal); with yaw rate, lateral acceleration and steering, the lateral forces and friction; with
    torques, the mass and an accelerometer's bias; with altitude or rate of climb, the grade free of bias;
    with a roll rate, a bank apart from a slide.

    What it cannot know: friction that is not used (then the lower bound is what has been used, the upper one
    the prior's, and validity says ``low_excitation``); without torques or altitude, a bias from a slope.

    Attributes:
        watch, signals, direction, radii, trust, forces, along, filter, contact, bank, pitch, roll, inputs,
            sharing: parts.
        knows_sides: whether there are a lateral acceleration and a yaw rate.
        speed_scale: 1σ of the speed's scale.
        mass_std: 1σ of the mass, as a share, before anything is learnt.
    """

    name: ClassVar[str] = "joint"
    summary: ClassVar[str] = "grade, bank, forces, friction, mass and biases from all channels there are"
    needs: ClassVar[tuple[Need, ...]] = (
        Need("the longitudinal accelerometer", (("accel_x",),)),
        Need("a speed", (WHEEL_SPEEDS, WHEEL_SPEEDS[2:], WHEEL_SPEEDS[:2], ("speed",))),
    )
    optional: ClassVar[tuple[str, ...]] = (
        *("accel_y", "yaw_rate", "steer", "steering_wheel", "speed", *WHEEL_SPEEDS),
        *("altitude", "vertical_speed", *_TURNS, "gear_ratio", "engine_torque", "engine_speed", "brake"),
        *(f"{kind}_{w}" for kind in ("drive_torque", "brake_torque", "brake_pressure") for w in WHEELS),
    )
    smoothable: ClassVar[Smoothable | None] = Smoothable(
        "filter", "along", ("grade", "speed", "altitude", "mass", "accel_x_bias")
    )

    channels: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    watch: Watch
    signals: Intake
    direction: Direction
    radii: Radii
    trust: Plausibility
    forces: ForceMeter
    along: AlongModel
    filter: EKF
    contact: TireContact
    bank: FrictionBank
    pitch: PitchMeter
    roll: RollMeter
    inputs: AlongIntake
    sharing: WheelSharing
    knows_sides: bool = eqx.field(static=True)
    speed_scale: Float[Array, ""]
    mass_std: Float[Array, ""]

    @property
    def sensor_units(self) -> Mapping[str, str]:
        """As :attr:`Estimator.sensor_units`; wheels are read as speeds of the car."""
        own = {**dict.fromkeys(WHEEL_SPEEDS, "m/s"), "traction": "m/s^2", "attitude": "rad"}
        return {**super().sensor_units, **{s: unit for s, unit in own.items() if s in self.sensors}}

    @classmethod
    def build(cls, vehicle: Vehicle, available: Collection[str], **options: Any) -> Self:
        """Compose for a vehicle and the channels there."""
        known_only(options, ())
        signals, forces = Intake(vehicle, available), ForceMeter(vehicle, available)
        model = AlongModel(vehicle, available, torque_of=forces.torque_of)
        aids = tuple(c for c in ("speed", "altitude", "vertical_speed", *_TURNS) if c in available)
        channels = tuple(dict.fromkeys((*signals.channels, *forces.channels, *aids)))
        return cls(
            channels=channels,
            sensors=model.sensors,
            watch=Watch(channels),
            signals=signals,
            direction=Direction(vehicle, signals.channels),
            radii=Radii(vehicle, available),
            trust=Plausibility(vehicle, available),
            forces=forces,
            along=model,
            filter=EKF(gate=GateRule(patience=_PATIENCE)),
            contact=TireContact(vehicle),
            bank=FrictionBank(vehicle, available),
            pitch=PitchMeter(vehicle),
            roll=RollMeter(vehicle),
            inputs=AlongIntake(vehicle, model.sensors, available, knows_brakes=forces.knows_brakes),
            sharing=WheelSharing.of(vehicle),
            knows_sides=signals.has[ACCEL_Y] and signals.has[YAW_RATE],
            speed_scale=leaf(0.0 if "speed" in available else vehicle.sensors.wheel_speed.scale),
            mass_std=leaf(vehicle.prior.mass_relative),
        )

    def init(self) -> JointState:
        """The prior; no sample has come."""
        zero = jnp.zeros(())
        return JointState(
            watch=self.watch.init(),
            signals=self.signals.init(),
            direction=self.direction.init(),
            radii=self.radii.init(),
            trust=self.trust.init(),
            forces=self.forces.init(),
            rims=self.inputs.rims.init(),
            along=self.filter.init(self.along),
            contact=self.contact.init(),
            bank=self.bank.init(),
            pace=Pace.start(),
            pitch=self.pitch.init(),
            roll=self.roll.init(),
            unrest=self.inputs.start(),
            loading=Loading.none(self.along.gains(self.along.prior())),
            shortfall=Shortfall.none(),
            speed_age=zero + NEVER,
            against=zero,
            doubt=zero,
            fault_age=jnp.zeros(len(ROWS) + len(WHEEL_SPEEDS) + len(self.sensors) + 1),
            latest=self.forces.nothing(),
            friction=self._friction(self.bank.init()),
            validity=jnp.asarray(int(Validity.SENSOR_MISSING)),
        )

    def step(self, state: JointState, sample: Sample, dt: Float[Array, ""]) -> tuple[JointState, Info]:
        """Signals, forces, motion along the road, then what goes on across it."""
        x, (across, across_std) = state.along.gaussian.mean, state.pace.merged(self.bank, state.bank)
        watch = once(self.watch.look(state.watch, sample, x[SPEED], dt))
        sample = self.watch.without_frozen(watch, sample)
        held, raw = self.signals.read(state.signals, sample, x[SPEED], dt)
        verdict, slides = self.trust.verdict(state.trust), state.trust.slide.lasts > 0
        direction, raw, way = self.direction.turn(
            state.direction, raw, sample, held.gear, state.along.gaussian, verdict.sign(ACCEL_X), dt
        )
        raw, verdict, way = once((self.radii.even(state.radii, raw), verdict, way))
        seen = once(self.trust.mend(state.trust, verdict, raw, x[SPEED]))
        bias = x[BIAS] + x[SCALE] * state.latest.lean.lasting
        error = jnp.stack([bias, jnp.zeros_like(bias)])
        rolls = self.inputs.rims.mean(seen)
        moving = self.inputs.moving(state, sample, seen, rolls)
        lightness = self.along.lightness(x)
        meter, balance = self.forces.read(state.forces, sample, seen, moving, error, x[SLOPE], lightness, dt)
        forces = balance._replace(age=jnp.where(verdict.lies[TORQUE], NEVER, balance.age))
        sideslip = jnp.stack([across[V_Y], across_std[V_Y]])
        rims, u, z = self.inputs.read(state, seen, forces, sample, sideslip, dt, verdict.sign(ACCEL_X), way)
        steps = self.watch.step(state.watch, WHEEL_SPEEDS)
        pushed = jnp.where(forces.may_brake, forces.accel[0], 0.0)
        white = self.contact.white(seen)
        radii = self.radii.learn(state.radii, seen, u.slip, pushed, u.turning, steps, white, dt)
        signal = z[self.sensors.index("speed")] if "speed" in self.sensors else jnp.full((), jnp.nan)
        is_signal = np.array([s == "speed" for s in self.sensors])
        stuck = is_signal & self.watch.is_stuck(watch, x[SPEED])
        z = jnp.where(verdict.lies[-1] & is_signal | stuck, jnp.nan, z)
        lag, since = self.watch.lateness(watch, self.sensors), self.watch.since(watch, self.sensors)
        lasting = jnp.sqrt(_LATE_TIME / jnp.clip(since, _LEAST_STEP, _LATE_TIME))
        alike = root(self.watch.alike(watch, self.sensors))
        u = u._replace(sensor_std=rss(alike * u.sensor_std, lag * u.gaining * lasting))
        pitch = state.pitch
        if "attitude" in self.sensors:
            tilt = jnp.stack([across[BANK], across_std[BANK]]) / GRAVITY
            pitch, pitching = self.pitch.read(pitch, sample, u.turning, u.smooth_across, tilt, dt)
            u = u._replace(pitching=pitching)
            is_attitude = np.array([s == "attitude" for s in self.sensors])
            z = jnp.where(is_attitude & (pitch.gyro.rate.age > 0), jnp.nan, z)
        along, info = self.filter.step(self.along, state.along, u, z, dt)
        tells = np.array([s == "speed" or s in WHEEL_SPEEDS for s in self.sensors])
        if "attitude" in self.sensors:
            row = self.sensors.index("attitude")
            seems = info.innovation[row], root(info.S[row, row]), u.sensor_std[row]
            speeds = jnp.asarray(np.flatnonzero(tells))
            pull = info.innovation[speeds], root(jnp.diagonal(info.S)[speeds])
            late = self.watch.lateness(watch, ("accel_x",))[0] > _LAGS
            unknown = (seen.age[YAW_RATE] >= STALE) & (jnp.abs(u.smooth_across) > _TURNS_HARD)
            excused = late | unknown | slides | ~self.radii.is_known(radii)
            moves = along.gaussian.mean[SPEED], u.smooth_across, excused
            pitch = self.pitch.judge(pitch, *seems, pull, *moves, dt)
        unrest = self.inputs.learn(state, info, u, forces, dt)
        loading = self.along.loading(state.loading, state.along.gaussian, along.gaussian, u, dt)
        shortfall = self.inputs.falls_short(state, info, u, forces, dt)
        speed = along.gaussian.mean[SPEED]
        rolling = self.along.rolling(along.gaussian, speed)
        gain = self.along.speeds_up(along.gaussian.mean, u)
        since = jnp.where(state.speed_age < NEVER, dt, NEVER)
        roll, banking = state.roll, jnp.asarray([0.0, jnp.inf])
        if "roll_rate" in self.channels:
            sine = along.gaussian.mean[SLOPE] / GRAVITY
            # how fast that changes in a spin, no yaw acceleration tells
            unsure = jnp.where(slides, 1.0, across_std[V_Y])
            sideslip = jnp.stack([across[V_Y], unsure])
            ahead = jnp.stack([across[LEVER], across_std[LEVER]])
            roll, banking = self.roll.read(roll, sample, seen, sine, speed, sideslip, ahead, dt)
        contact, touch = self.contact.touch(
            state.contact, seen, forces, speed, rolling, gain, GRAVITY * banking, slides, since
        )
        late = self.watch.lateness(watch, WHEEL_SPEEDS) * gain / jnp.maximum(jnp.abs(speed), 1.0)
        touch = touch._replace(slip_shared=rss(touch.slip_shared, jnp.max(jnp.abs(late))))
        pace, bank, likelihood = once(state.pace.weigh(self.bank, state.bank, touch, dt))
        share = 1 + rolling[0]
        if "wheel_radius" in self.along.states:
            raw = raw.scaled(jnp.ones(8).at[SPIN].set(share))
        heavier = 1 - self.along.lightness(along.gaussian.mean)
        heavy = balance._replace(explained=balance.explained - heavier * self.along.moved(u))
        trust = self.trust.test(
            state.trust, raw, heavy, signal, speed, across[V_Y], held.repeats >= REPEATS, dt
        )
        trust, now = once((trust, self.trust.verdict(trust)))
        found = (now.lies & (~verdict.lies)) | (now.swapped != verdict.swapped)
        # the car was taken to go backward as its wheels told
        turned = jnp.any((held.sense < 0) & (state.signals.sense == 0))
        turned = (turned | direction.is_refuted(state.direction)) & (rolls * speed < 0)
        trust = once(select(turned, self.trust.init(), trust))
        moved = self.radii.has_moved(radii)
        caught = jnp.any(found) | turned | moved | self.roll.contradicts(roll)
        rolls = jnp.where(jnp.any(seen.is_fresh[SPIN]), share * rims.rolling, speed)
        against = state.against
        if "speed" in self.channels and any(self.signals.has[SPIN]):
            rims_say = share * self.inputs.rims.radius * seen.value[SPIN], seen.is_fresh[SPIN]
            against = outvoted(against, sample["speed"], *rims_say, rolls, speed, forces.accel[0])
        contradicted = jnp.where(jnp.abs(rolls - speed) > WRONG, state.against + dt / _ROLLED, 0.0)
        against = jnp.where(rims.rolls, contradicted, against)
        astray = is_astray(along.gaussian, speed, along.gaussian.mean[SLOPE])
        spread, bears = along.gaussian.std[SPEED], jnp.mean(forces.over_load)
        refuted = ~is_proven(rims.proof) & refutes(rolls, bears, speed, spread)
        lost = (against >= _CONFIRMED) | turned | astray | refuted
        # what was learnt from a sensor that lies may be wrong
        spoilt = jnp.any(found & (GROUP != YAW)) | self._freezes(state, held, raw) | lost | moved
        begin = jnp.where(lost, rolls, speed)
        along = along._replace(gaussian=self.along.doubt(along.gaussian, spoilt, begin))
        doubt = jnp.where(jnp.any(verdict.lies) | caught, _AFRESH, state.doubt - dt)
        afresh = (doubt > 0) | ~self.bank.is_sound(bank)
        pace, bank = once(select(afresh, (Pace.start(), self.bank.init()), (pace, bank)))
        speed_age = jnp.where(jnp.any(jnp.isfinite(z) & tells), 0.0, state.speed_age + dt)
        refused = (along.rejected > 0) | stuck
        if "attitude" in self.sensors:
            refused = refused.at[self.sensors.index("attitude")].max(self.pitch.is_faulty(pitch))
        faulty = jnp.concatenate([raw.is_faulty, held.sense < 0, refused, self.roll.is_faulty(roll)[None]])
        fault_age = jnp.where(faulty, state.fault_age + jnp.minimum(dt, _PAUSE), 0.0)
        friction = once(self._friction(bank))
        new = JointState(
            watch, held, direction, radii, trust, meter, rims, along, contact, bank, pace, pitch, roll,
            unrest, loading, shortfall, speed_age, jnp.where(lost, 0.0, against), doubt, fault_age, forces,
            friction, state.validity,
        )  # fmt: skip
        validity = validity_of(self, new, self._faults(new), info.ok)
        info = eqx.tree_at(lambda i: i.log_likelihood, info, info.log_likelihood + likelihood)
        return new._replace(validity=validity), info

    def _freezes(self, state: JointState, held: SignalState, raw: Signals) -> Bool[Array, ""]:
        """Whether just now all wheels turn out to repeat themselves, which made the slope seem steep."""
        frozen = raw.is_faulty[SPIN] & (held.repeats[SPIN] >= REPEATS)
        has = np.array(self.signals.has[SPIN])
        before = jnp.max(jnp.where(has, state.fault_age[SPIN], 0.0)) > 0
        return jnp.all(frozen | ~has) & bool(has.any()) & ~before

    def _friction(self, bank: BankState) -> Float[Array, "3 5"]:
        low, high = self.bank.quantiles(bank, _BOUNDS)
        return jnp.stack([low, jnp.clip(self.bank.likeliest(bank), low, high), high])

    def estimate(self, state: JointState) -> Estimate:
        """Everything, with standard deviations; friction with its 5 % and 95 % bounds."""
        return told(self, state, self._faults(state))

    @property
    def fault_names(self) -> tuple[str, ...]:
        """As :attr:`Estimator.fault_names`."""
        own = sensor_fault_names(self.signals.named, self.sensors)
        rolls = "roll_rate: it and accel_y contradict each other, or it jumps as no car does"
        return (*self.watch.fault_names, *own, rolls, *self.trust.fault_names(self.signals.named))

    def _faults(self, state: JointState) -> Bool[Array, " f"]:
        verdict = self.trust.verdict(state.trust)
        found = self.watch.faults(state.watch), state.fault_age > _FAULTY, self.trust.faults(verdict)
        return jnp.concatenate(found)
