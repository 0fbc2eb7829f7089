"""Joint estimator of grade, bank, tire forces and friction, and of the car's own figures."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.core.estimates import Validity
from roadstate.core.gaussian import Info
from roadstate.estimators.along import BIAS, SCALE, SLOPE, SPEED, AlongInput, AlongModel
from roadstate.estimators.base import Estimate, Estimator, Need, Sample, Smoothable, leaf
from roadstate.estimators.contact_forces import AxleForces, ForceMeter, ForceMeterState
from roadstate.estimators.friction_bank import BANK, BIAS_Y, LEVER, V_Y, VIEWS, BankState, FrictionBank
from roadstate.estimators.intake import (
    ACCEL_X,
    ACCEL_Y,
    REPEATS,
    ROWS,
    SMOOTHING,
    SPIN,
    STALE,
    WHEEL_SPEEDS,
    YAW_RATE,
    Intake,
    Signals,
    SignalState,
    sensor_fault_names,
)
from roadstate.estimators.noise_learning import NoiseLearner, Unrest
from roadstate.estimators.pitch import Pitching, PitchMeter, PitchState, lean_std
from roadstate.estimators.plausibility import TORQUE, Plausibility, PlausibilityState
from roadstate.estimators.redundancy import GROUP, YAW
from roadstate.estimators.signals import STANDSTILL_SPEED
from roadstate.estimators.tire_contact import ContactState, TireContact
from roadstate.estimators.watch import Watch, WatchState
from roadstate.filters import KF, FilterState, GateRule
from roadstate.linalg import once, root

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_SILENT = 3.0  # s without a channel after which the estimate is called a prediction
_FAULTY = 0.3  # s of a refused or stuck sensor after which it is called faulty
_SURE = 0.6  # ratio of the 5 % to the 95 % bound from which on friction counts as known
_UNSEEN = 4.0  # m/s²/√Hz: of an acceleration that neither accelerometer nor torques tell
_QUANTILES = (0.05, 0.5, 0.95)
_LEAST_STEP = 1e-3  # s
_AGE = 0.1  # s by which a satellite's speed may be late
_LEAD_ERROR = 0.7  # 1σ of what is added to undo the low pass, as a share of it
_LATE = 0.01  # s: age of inertial signals, and what the body's roll adds to it
_NEVER = 1e6  # s
_AFRESH = 0.4  # s until what is slowed has forgotten a sensor that lied
_LATE_TIME = 0.5  # s: how long an error of a late signal lasts
_LEARNED = ("vertical_speed", "traction", "attitude")  # sensors whose noise is learned
_CALM = 0.1  # m/s²/√Hz: error of the torques' force beyond which it is not the usual one
_MOVING = 2.0  # m/s from which sensors err as they usually do
_PATIENCE = 300  # samples for which a spinning or locked wheel may be refused


class JointState(NamedTuple):
    """State of :class:`Joint`.

    Attributes:
        watch, signals, trust, forces, along, contact, bank, pitch, unrest: the parts'.
        speed_age: s since anything told the speed.
        doubt: s for which nothing is learnt of friction yet, since a sensor was caught.
        fault_age: (8 + m,) s for which each inertial, steering and wheel signal has been refused or stuck,
            and each of the filter's sensors refused.
        latest: what the forces were, for :meth:`Joint.estimate`.
        friction: (3, 5) 5 %, 50 % and 95 % quantiles of each view's friction.
        validity: code.
    """

    watch: WatchState
    signals: SignalState
    trust: PlausibilityState
    forces: ForceMeterState
    along: FilterState
    contact: ContactState
    bank: BankState
    pitch: PitchState
    unrest: Unrest
    speed_age: Float[Array, ""]
    doubt: Float[Array, ""]
    fault_age: Float[Array, " k"]
    latest: AxleForces
    friction: Float[Array, "3 5"]
    validity: Int[Array, ""]


class Joint(Estimator[JointState]):
    """Grade, bank, forces, friction and the car's own figures, of whatever channels there are.

    Three parts that inform each other at every sample, each exact for what it holds:

    - :class:`~roadstate.estimators.along.AlongModel`, a Kalman filter of speed and slope in which
      accelerometer, wheels, torques and satellites meet, and what they disagree by (bias, pitch and scale,
      mass, gains of drive and brakes, rolling resistance, rolling radius) is learned;
    - :class:`~roadstate.estimators.contact_forces.ForceMeter`, a balance of forces that needs no tire model;
    - :class:`~roadstate.estimators.friction_bank.FrictionBank`, which asks of every friction at once how well
      it goes with these forces, given the slip: sideslip, bank, stiffness and shape of the tires are
      estimated under each.

    Which states there are follows from the channels. Needs an accelerometer and a speed (of wheels, or a
    speed signal); with yaw rate, lateral acceleration and steering, the lateral forces and friction; with
    torques, the mass and an accelerometer's bias; with altitude or rate of climb, the grade free of bias.

    What it cannot know: how an axle's lateral force is shared by its wheels; friction that is not used: then
    the lower bound is what has been used, the upper one the prior's, and validity says ``low_excitation``;
    without torques or altitude, a bias of the accelerometer from a slope.

    Attributes:
        watch, signals, trust, forces, along, filter, contact, bank: the parts.
    """

    name: ClassVar[str] = "joint"
    summary: ClassVar[str] = "grade, bank, forces, friction, mass and biases from all channels there are"
    needs: ClassVar[tuple[Need, ...]] = (
        Need("the longitudinal accelerometer", (("accel_x",),)),
        Need("a speed", (WHEEL_SPEEDS, WHEEL_SPEEDS[2:], WHEEL_SPEEDS[:2], ("speed",))),
    )
    optional: ClassVar[tuple[str, ...]] = (
        *("accel_y", "yaw_rate", "steer", "steering_wheel", "speed", *WHEEL_SPEEDS),
        *("altitude", "vertical_speed", "pitch_rate", "gear_ratio", "engine_torque", "engine_speed", "brake"),
        *(f"{kind}_{w}" for kind in ("drive_torque", "brake_torque", "brake_pressure") for w in WHEELS),
    )
    smoothable: ClassVar[Smoothable | None] = Smoothable(
        "filter", "along", ("grade", "speed", "altitude", "mass", "accel_x_bias")
    )

    channels: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    watch: Watch
    signals: Intake
    trust: Plausibility
    forces: ForceMeter
    along: AlongModel
    filter: KF
    contact: TireContact
    bank: FrictionBank
    pitch: PitchMeter
    learner: NoiseLearner
    _learned: tuple[int, ...] = eqx.field(static=True)
    _knows_sides: bool = eqx.field(static=True)
    _sensor_std: Float[Array, " m"]
    _accel_noise: Float[Array, ""]
    _speed_scale: Float[Array, ""]
    _mass_std: Float[Array, ""]

    @property
    def sensor_units(self) -> Mapping[str, str]:
        """As :attr:`Estimator.sensor_units`; wheels are read as speeds of the car."""
        own = {**dict.fromkeys(WHEEL_SPEEDS, "m/s"), "traction": "m/s^2", "attitude": "rad"}
        return {**super().sensor_units, **{s: unit for s, unit in own.items() if s in self.sensors}}

    @classmethod
    def build(cls, vehicle: Vehicle, available: Collection[str], **options: Any) -> Self:
        """Compose for a vehicle and the channels there."""
        signals, forces = Intake(vehicle, available), ForceMeter(vehicle, available)
        model = AlongModel(vehicle, available, has_torque=forces.has_torque)
        sensors = vehicle.sensors
        noise = {
            "speed": sensors.speed.noise,
            "altitude": sensors.altitude.noise,
            "vertical_speed": sensors.vertical_speed.noise,
            "traction": 0.0,
            "attitude": 0.0,
        }
        wheel = vehicle.wheels.radius * sensors.wheel_speed.noise
        aids = tuple(c for c in ("speed", "altitude", "vertical_speed", "pitch_rate") if c in available)
        channels = tuple(dict.fromkeys((*signals.channels, *forces.channels, *aids)))
        sides = signals.has[ACCEL_Y] and signals.has[YAW_RATE]
        return cls(
            channels=channels,
            sensors=model.sensors,
            watch=Watch(channels),
            signals=signals,
            trust=Plausibility(vehicle, available),
            forces=forces,
            along=model,
            filter=KF(gate=GateRule(patience=_PATIENCE)),
            contact=TireContact(vehicle),
            bank=FrictionBank(vehicle),
            pitch=PitchMeter(vehicle),
            learner=NoiseLearner(),
            _learned=tuple(i for i, sensor in enumerate(model.sensors) if sensor in _LEARNED),
            _knows_sides=sides,
            _sensor_std=jnp.asarray(np.array([noise.get(s, wheel) for s in model.sensors])),
            _accel_noise=leaf(sensors.accel.noise_density),
            _speed_scale=leaf(0.0 if "speed" in available else sensors.wheel_speed.scale),
            _mass_std=leaf(vehicle.prior.mass_relative),
        )

    def init(self) -> JointState:
        """The prior; no sample has come."""
        zero = jnp.zeros(())
        return JointState(
            watch=self.watch.init(),
            signals=self.signals.init(),
            trust=self.trust.init(),
            forces=self.forces.init(),
            along=self.filter.init(self.along),
            contact=self.contact.init(),
            bank=self.bank.init(),
            pitch=self.pitch.init(),
            unrest=self.learner.init(len(self._learned)),
            speed_age=zero + 1e6,
            doubt=zero,
            fault_age=jnp.zeros(len(ROWS) + len(self.sensors)),
            latest=self.forces.nothing(),
            friction=self.bank.quantiles(self.bank.init(), _QUANTILES),
            validity=jnp.asarray(int(Validity.SENSOR_MISSING)),
        )

    def step(self, state: JointState, sample: Sample, dt: Float[Array, ""]) -> tuple[JointState, Info]:
        """Signals, forces, motion along the road, then what goes on across it."""
        x, (across, across_std) = state.along.gaussian.mean, self.bank.merged(state.bank)
        held, raw = self.signals.read(state.signals, sample, x[SPEED], dt)
        raw, verdict = once((raw, self.trust.verdict(state.trust)))
        seen = once(self.trust.mend(state.trust, verdict, raw, x[SPEED]))
        bias = x[BIAS] + x[SCALE] * state.latest.accel[0]
        error = jnp.stack([bias, jnp.zeros_like(bias)])
        meter, told = self.forces.read(state.forces, sample, seen, x[SPEED], error, dt)
        forces = told._replace(age=jnp.where(verdict.lies[TORQUE], _NEVER, told.age))
        contact, u, z = self._along(state, held, seen, forces, sample, across[V_Y], dt, verdict.sign(ACCEL_X))
        signal = z[self.sensors.index("speed")] if "speed" in self.sensors else jnp.full((), jnp.nan)
        is_signal = np.array([s == "speed" for s in self.sensors])
        z = jnp.where(verdict.lies[-1] & is_signal, jnp.nan, z)
        watch = once(self.watch.look(state.watch, sample, dt))
        lag = self.watch.lateness(watch, self.sensors)
        lasting = jnp.sqrt(_LATE_TIME / jnp.maximum(dt, _LEAST_STEP))
        u = u._replace(sensor_std=jnp.hypot(u.sensor_std, lag * u.smooth_accel * lasting))
        pitch = state.pitch
        if "attitude" in self.sensors:
            tilt = jnp.stack([across[BANK], across_std[BANK]]) / GRAVITY
            pitch, pitching = self.pitch.read(pitch, sample, u.turning, u.smooth_across, tilt, dt)
            u = u._replace(pitching=pitching)
        along, info = self.filter.step(self.along, state.along, u, z, dt)
        tells = np.array([s == "speed" or s in WHEEL_SPEEDS for s in self.sensors])
        if "attitude" in self.sensors:
            row = self.sensors.index("attitude")
            seems = info.innovation[row], root(info.S[row, row]), u.sensor_std[row]
            speeds = jnp.asarray(np.flatnonzero(tells))
            pull = info.innovation[speeds], root(jnp.diagonal(info.S)[speeds])
            pitch = self.pitch.judge(pitch, *seems, pull, dt)
        unrest = self._learn(state.unrest, info, u, forces, dt)
        speed, speed_std = along.gaussian.mean[SPEED], along.gaussian.std[SPEED]
        gain = u.accel - along.gaussian.mean[SLOPE] - along.gaussian.mean[BIAS]
        contact, touch = self.contact.touch(contact, seen, forces, speed, speed_std, gain, dt)
        late = self.watch.lateness(watch, WHEEL_SPEEDS) * gain / jnp.maximum(jnp.abs(speed), 1.0)
        touch = touch._replace(slip_shared=jnp.hypot(touch.slip_shared, jnp.max(jnp.abs(late))))
        bank, likelihood = once(self.bank.step(state.bank, touch, dt))
        trust = self.trust.test(state.trust, raw, told, signal, speed, held.repeats >= REPEATS, dt)
        trust, now = once((trust, self.trust.verdict(trust)))
        found = (now.lies & (~verdict.lies)) | (now.swapped & (~verdict.swapped))
        caught = jnp.any(found)
        # what was learnt from a sensor that lies may be wrong
        spoilt = jnp.any(found & (GROUP != YAW))
        along = along._replace(gaussian=self.along.doubt(along.gaussian, spoilt))
        doubt = jnp.where(jnp.any(verdict.lies) | caught, _AFRESH, state.doubt - dt)
        afresh = doubt > 0
        bank = jax.lax.cond(afresh, lambda kept: self.bank.init(), lambda kept: kept, bank)
        speed_age = jnp.where(jnp.any(jnp.isfinite(z) & tells), 0.0, state.speed_age + dt)
        refused = along.rejected > 0
        if "attitude" in self.sensors:
            refused = refused.at[self.sensors.index("attitude")].max(self.pitch.is_faulty(pitch))
        faulty = jnp.concatenate([raw.is_faulty, refused])
        fault_age = jnp.where(faulty, state.fault_age + dt, 0.0)
        friction = once(self.bank.quantiles(bank, _QUANTILES))
        new = JointState(
            watch,
            held,
            trust,
            meter,
            along,
            contact,
            bank,
            pitch,
            unrest,
            speed_age,
            doubt,
            fault_age,
            forces,
            friction,
            state.validity,
        )
        validity = self._validity(new, info)
        info = eqx.tree_at(lambda i: i.log_likelihood, info, info.log_likelihood + likelihood)
        return new._replace(validity=validity), info

    def _learn(self, unrest: Unrest, info: Info, u: AlongInput, forces: AxleForces, dt: Array) -> Unrest:
        """How noisy the sensors are, on the move and while forces are known."""
        rows = jnp.asarray(self._learned, int)
        calm = jnp.asarray([self.sensors[i] != "traction" for i in self._learned], bool)
        stated = u.sensor_std[rows] / jnp.where(calm, self.learner.scale(unrest), 1.0)
        usual = (calm | (forces.intensity < _CALM)) & (jnp.abs(u.speed) > _MOVING)
        return self.learner.learn(unrest, info.innovation[rows], stated, usual, dt)

    def _along(
        self,
        state: JointState,
        held: SignalState,
        seen: Signals,
        forces: AxleForces,
        sample: Sample,
        velocity_y: Array,
        dt: Array,
        sign: Array,
    ) -> tuple[ContactState, AlongInput, Float[Array, " m"]]:
        """Input and measurement of the filter along the road."""
        x, spread = state.along.gaussian.mean, state.along.gaussian.std[SPEED]
        speed, step = x[SPEED], jnp.maximum(dt, _LEAST_STEP)
        felt = seen.age[ACCEL_X] < STALE
        before = jnp.where(
            state.signals.age[ACCEL_X] < STALE, sign * state.signals.value[ACCEL_X], seen.value[ACCEL_X]
        )
        raw = 0.5 * (seen.value[ACCEL_X] + before)
        by_torque = forces.explained + x[BIAS] + x[SCALE] * forces.accel[0]
        known = (forces.age < STALE) & (~forces.is_brake_unknown)
        accel = jnp.where(felt, raw, jnp.where(known, by_torque, x[SLOPE] + x[BIAS]))
        intensity = jnp.where(felt, self._accel_noise, jnp.where(known, forces.intensity, _UNSEEN))
        turning = jnp.where(seen.age[YAW_RATE] < STALE, seen.smooth[YAW_RATE], 0.0)
        u = AlongInput(
            accel=accel + velocity_y * turning,
            smooth_accel=forces.accel[0],
            drive=forces.drive,
            brake=forces.brake,
            rolling=forces.rolling,
            speed=speed,
            intensity=intensity,
            smooth_across=forces.accel[1],
            turning=turning,
            pitching=Pitching(jnp.zeros(()), jnp.zeros(())),
            sensor_std=jnp.zeros(0),
        )
        parts, stds = [], []
        wheels = [i for i, w in enumerate(WHEEL_SPEEDS) if w in self.sensors]
        contact = state.contact
        if wheels:
            gain, unsure = accel - x[BIAS] - x[SLOPE], state.along.gaussian.std[SLOPE]
            contact, rim, std = self.contact.rims(
                contact, seen, forces, turning, speed, spread, gain, unsure, dt
            )
            parts.append(rim[jnp.asarray(wheels)])
            stds.append(std[jnp.asarray(wheels)])
        for name in ("speed", "altitude", "vertical_speed"):
            if name in self.sensors:
                value, std = sample[name], self._sensor_std[self.sensors.index(name)]
                if name == "speed":
                    backward = (held.gear < 0) & (value > 0)
                    value = jnp.where(backward, -value, value)
                    std = jnp.hypot(std, _AGE * forces.accel[0])
                if name == "vertical_speed":
                    std = jnp.hypot(std, _AGE * forces.accel[0] * x[SLOPE] / GRAVITY)
                parts.append(jnp.where(jnp.isfinite(value), value, jnp.nan)[None])
                stds.append(std[None])
        if self.forces.has_torque:
            told = seen.is_fresh[ACCEL_X] & (forces.age < STALE)
            more = seen.smooth[ACCEL_X] - forces.explained
            parts.append(jnp.where(told, more, jnp.nan)[None])
            both = jnp.hypot(forces.intensity, self._accel_noise)
            stds.append((both / root(step))[None])
            # whatever parts accelerometer and torques, the accelerometer's noise is no more than that
            found = self.learner.scale(state.unrest)[self._learned.index(self.sensors.index("traction"))]
            u = u._replace(intensity=jnp.where(felt, jnp.minimum(u.intensity, found * both), u.intensity))
        if "attitude" in self.sensors:
            parts.append(jnp.where(jnp.isfinite(sample["pitch_rate"]), 0.0, jnp.nan)[None])
            stds.append(lean_std(dt)[None])
        z, std = once((jnp.concatenate(parts), jnp.concatenate(stds)))
        last = len(self._learned)
        # what parts torques and accelerometer lasts for minutes, too: that is no white noise of the torques
        own = {i: k for k, i in enumerate(self._learned) if self.sensors[i] != "traction"}
        which = [own.get(i, last) for i in range(len(self.sensors))]
        std = std * jnp.append(self.learner.scale(state.unrest), 1.0)[np.array(which)]
        return contact, u._replace(sensor_std=std), z

    def _validity(self, state: JointState, info: Info) -> Int[Array, ""]:
        used = jnp.asarray([self.signals.has[i] for i in range(8)])
        oldest = jnp.max(jnp.where(used & (jnp.arange(8) < SPIN.start), state.signals.age, 0.0))
        low, _, high = state.friction
        sure = low[0] > _SURE * high[0]
        validity = jnp.where(sure, int(Validity.EXCITED), int(Validity.LOW_EXCITATION))
        validity = jnp.where(state.latest.is_shifting & ~sure, int(Validity.GEAR_SHIFT), validity)
        validity = jnp.where(state.latest.is_brake_unknown & ~sure, int(Validity.BRAKING), validity)
        stands = jnp.abs(state.along.gaussian.mean[SPEED]) < STANDSTILL_SPEED
        validity = jnp.where(stands, int(Validity.STANDSTILL), validity)
        faults = self._faults(state)
        validity = jnp.where(jnp.any(faults), int(Validity.SENSOR_FAULT), validity)
        if "attitude" in self.sensors:
            oldest = jnp.maximum(oldest, state.pitch.rate.age)
        silent = jnp.maximum(oldest, state.speed_age) > _SILENT
        silent = silent | jnp.any(faults[: len(self.channels)])
        validity = jnp.where(silent, int(Validity.SENSOR_MISSING), validity)
        return jnp.where(info.ok, validity, int(Validity.DIVERGED))

    def estimate(self, state: JointState) -> Estimate:
        """Everything, with standard deviations; friction with its 5 % and 95 % bounds."""
        values: dict[str, Array] = {}
        stds: dict[str, Array] = {}

        def tell(name: str, value: Array, std: Array) -> None:
            values[name], stds[name] = value, std

        mean, std = state.along.gaussian.mean, state.along.gaussian.std
        forces = state.latest
        sine = jnp.clip(mean[SLOPE] / GRAVITY, -0.99, 0.99)
        grade = jnp.arcsin(sine)
        tell("grade", grade, std[SLOPE] / (GRAVITY * jnp.cos(grade)))
        tell("speed", mean[SPEED], jnp.hypot(std[SPEED], self._speed_scale * mean[SPEED]))
        tell("accel_x_bias", mean[BIAS], std[BIAS])
        scale, scale_std = jnp.ones(()), self._mass_std
        if "mass" in self.along.states:
            place = self.along.place("mass")
            scale, scale_std = 1 + mean[place], std[place]
            tell("mass", self.forces.car.mass * scale, self.forces.car.mass * scale_std)
        if "altitude" in self.along.states:
            tell("altitude", mean[-2], std[-2])
        axles = forces.load.reshape(2, 2).sum(axis=1)
        side, side_std = self.bank.merged(state.bank)
        # ahead by as much as low pass, sensors and the body's roll lag, and freed of the accelerometer's bias
        # and place
        ahead = (1 + _LATE / SMOOTHING) * (forces.across - state.contact.across * axles)
        lateral = forces.across + ahead - (side[BIAS_Y] + side[LEVER] * forces.yaw_accel) / GRAVITY * axles
        used, used_std = self._used(forces, lateral, ahead, side_std[BIAS_Y])
        ages = state.signals.age
        silent = jnp.minimum(ages[ACCEL_X], 10.0) + jnp.minimum(ages[ACCEL_Y], 3.0)
        tell("friction_used", used, jnp.hypot(used_std, 0.1 * silent))
        if self._knows_sides:
            tell("velocity_y", side[V_Y], side_std[V_Y])
            bank = jnp.arcsin(jnp.clip(side[BANK] / GRAVITY, -0.99, 0.99))
            tell("bank", bank, side_std[BANK] / (GRAVITY * jnp.cos(bank)))
        for i, where in enumerate(("front", "rear")):
            load = forces.load[2 * i] + forces.load[2 * i + 1]
            along = forces.along[2 * i] + forces.along[2 * i + 1]
            rough = jnp.hypot(scale_std * along, 0.02 * load)
            unsure = 0.5 * (forces.along_std[2 * i] + forces.along_std[2 * i + 1])
            spread = jnp.where(jnp.isfinite(unsure), unsure, 1.0) * load
            tell(f"force_x_{where}", scale * along, jnp.hypot(rough, spread))
            if self._knows_sides:
                across = lateral[i]
                rough = jnp.hypot(scale_std * across, 0.015 * load)
                rough = jnp.hypot(rough, _LEAD_ERROR * ahead[i])
                rough = jnp.hypot(rough, side_std[BIAS_Y] / GRAVITY * load)
                spread = jnp.where(jnp.isfinite(forces.across_std[i]), forces.across_std[i], 1.0) * load
                tell(f"force_y_{where}", scale * across, jnp.hypot(rough, spread))
        low, middle, high = state.friction
        spread = self.bank.std(state.bank)
        for i, view in enumerate(VIEWS):
            name = f"friction_peak{view}"
            tell(name, middle[i], spread[i])
            values[f"{name}_lower"], values[f"{name}_upper"] = low[i], high[i]
        return Estimate(values, stds, state.validity, self._faults(state))

    @property
    def fault_names(self) -> tuple[str, ...]:
        """As :attr:`Estimator.fault_names`."""
        own = sensor_fault_names(self.signals.named, self.sensors)
        return (*self.watch.fault_names, *own, *self.trust.fault_names(self.signals.named))

    def _faults(self, state: JointState) -> Bool[Array, " f"]:
        watch, verdict = state.watch, self.trust.verdict(state.trust)
        found = [watch.is_silent, watch.has_spikes, state.fault_age > _FAULTY, self.trust.faults(verdict)]
        return jnp.concatenate(found)

    def _used(self, forces: AxleForces, lateral: Array, ahead: Array, bias_std: Array) -> tuple[Array, Array]:
        along, across = jnp.sum(forces.along), jnp.sum(lateral)
        load = jnp.sum(forces.load)
        used = root(along**2 + across**2) / load
        unsure = jnp.hypot(bias_std / GRAVITY, _LEAD_ERROR * jnp.sum(ahead) / load)
        return used, jnp.sqrt(0.01**2 + (0.02 * used) ** 2 + unsure**2)
