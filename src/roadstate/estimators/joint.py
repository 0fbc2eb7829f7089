"""Joint estimator of grade, bank, tire forces and friction, and of the car's own figures."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.core.estimates import Validity
from roadstate.core.gaussian import Info
from roadstate.core.kernel import once
from roadstate.estimators.along import BIAS, SCALE, SLOPE, AlongModel
from roadstate.estimators.along_input import AlongIntake
from roadstate.estimators.axle_forces import AxleForces
from roadstate.estimators.banked import pressed
from roadstate.estimators.base import Estimate, Estimator, Need, Sample, Smoothable, known_only, leaf
from roadstate.estimators.contact_forces import ForceMeter, ForceMeterState
from roadstate.estimators.direction import Direction, DirectionState
from roadstate.estimators.friction_bank import BankState, FrictionBank
from roadstate.estimators.intake import (
    ACCEL_Y,
    ROWS,
    WHEEL_SPEEDS,
    YAW_RATE,
    Intake,
    Signals,
    SignalState,
    sensor_fault_names,
)
from roadstate.estimators.joint_motion import Along, move
from roadstate.estimators.joint_output import told, validity_of
from roadstate.estimators.joint_reading import Reading, read
from roadstate.estimators.joint_recovery import recover
from roadstate.estimators.loading import Loading
from roadstate.estimators.noise_learning import Unrest
from roadstate.estimators.pace import Pace
from roadstate.estimators.pitch import PitchMeter, PitchState
from roadstate.estimators.plausibility import TORQUE, Plausibility, PlausibilityState
from roadstate.estimators.radii import Radii, RadiiState
from roadstate.estimators.roll import RollMeter, RollState
from roadstate.estimators.shortfall import Shortfall
from roadstate.estimators.sideways import BANK, LEVER
from roadstate.estimators.signals import NEVER
from roadstate.estimators.tire_contact import ContactState, TireContact
from roadstate.estimators.undulation import Undulation
from roadstate.estimators.watch import Watch, WatchState
from roadstate.estimators.wheel_forces import WheelSharing
from roadstate.estimators.wheel_rims import RimState
from roadstate.filters import EKF, FilterState, GateRule
from roadstate.linalg import rss

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_FAULTY = 0.3  # s of a refused or stuck sensor after which it is called faulty
_PAUSE = 0.2  # s: what a gap of the whole log counts for of these
_BOUNDS = (0.05, 0.95)
_TURNS = ("pitch_rate", "roll_rate")
_PATIENCE = 300  # samples for which a spinning or locked wheel may be refused


class JointState(NamedTuple):
    """State of :class:`Joint`.

    Attributes:
        watch, signals, direction, radii, trust, forces, rims, along, contact, bank, pace, pitch, roll,
            unrest, loading, undulation, shortfall: the parts'.
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
    undulation: Undulation
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
            undulation=Undulation.none(),
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
        across = state.pace.merged(self.bank, state.bank)
        reading = read(self, state, sample, dt)
        sample, seen, x = reading.sample, reading.seen, state.along.gaussian.mean
        bias = x[BIAS] + x[SCALE] * state.latest.lean.lasting
        error = jnp.stack([bias, jnp.zeros_like(bias)])
        moving = self.inputs.moving(state, sample, seen, reading.rolls)
        lightness = self.along.lightness(x)
        heave = self._heave(state, across, seen, moving)
        meter, balance = self.forces.read(
            state.forces, sample, seen, moving, error, x[SLOPE], heave, lightness, dt
        )
        age = jnp.where(reading.verdict.lies[TORQUE], NEVER, balance.age)
        forces = balance._replace(age=age)
        moved = move(self, state, reading, forces, across, dt)
        along, info, u, speed = moved.filter, moved.info, moved.u, moved.speed
        unrest = self.inputs.learn(state, info, u, forces, dt)
        loading = self.along.loading(state.loading, state.along.gaussian, along.gaussian, u, dt)
        shortfall = self.inputs.falls_short(state, info, u, forces, dt)
        roll, banking = self._banking(state, reading, moved, across, dt)
        gain = self.along.speeds_up(along.gaussian.mean, u)
        rolling = self.along.rolling(along.gaussian, speed)
        since = jnp.where(state.speed_age < NEVER, dt, NEVER)
        contact, touch = self.contact.touch(
            state.contact,
            seen,
            forces,
            speed,
            rolling,
            gain,
            moved.sine,
            GRAVITY * banking,
            reading.slides,
            since,
        )
        late = self.watch.lateness(reading.watch, WHEEL_SPEEDS) * gain / jnp.maximum(jnp.abs(speed), 1.0)
        touch = touch._replace(slip_shared=rss(touch.slip_shared, jnp.max(jnp.abs(late))))
        pace, bank, likelihood = once(state.pace.weigh(self.bank, state.bank, touch, dt))
        sound = recover(self, state, reading, moved, balance, (pace, bank), roll, dt)
        new = JointState(
            watch=reading.watch,
            signals=reading.held,
            direction=reading.direction,
            radii=moved.radii,
            trust=sound.trust,
            forces=meter,
            rims=moved.rims,
            along=sound.along,
            contact=contact,
            bank=sound.bank,
            pace=sound.pace,
            pitch=moved.pitch,
            roll=roll,
            unrest=unrest,
            loading=loading,
            undulation=sound.undulation,
            shortfall=shortfall,
            speed_age=jnp.where(moved.tells, 0.0, state.speed_age + dt),
            against=sound.against,
            doubt=sound.doubt,
            fault_age=self._fault_age(state, reading, moved, roll, dt),
            latest=forces,
            friction=once(self._friction(sound.bank)),
            validity=state.validity,
        )
        validity = validity_of(self, new, self._faults(new), info.ok)
        info = eqx.tree_at(lambda i: i.log_likelihood, info, info.log_likelihood + likelihood)
        return new._replace(validity=validity), info

    def _heave(
        self, state: JointState, across: tuple[Array, Array], seen: Signals, speed: Array
    ) -> Float[Array, " 3"]:
        """By what share tires bear more where the road bends up or leans, and 1σ of either."""
        gaussian = state.along.gaussian
        heave = self.along.heave(gaussian, speed)
        slope = jnp.stack([gaussian.mean[SLOPE], gaussian.std[SLOPE]])
        bank = jnp.stack([across[0][BANK], across[1][BANK]]) if self.knows_sides else jnp.zeros(2)
        leans = pressed(speed, seen.smooth[YAW_RATE], slope, bank)
        return jnp.stack([heave[0] + leans[0], heave[1], leans[1]])

    def _banking(
        self, state: JointState, reading: Reading, moved: Along, across: tuple[Array, Array], dt: Array
    ) -> tuple[RollState, Float[Array, " 2"]]:
        """State of the roll meter, and the bank that it tells with its 1σ, rad."""
        if "roll_rate" not in self.channels:
            return state.roll, jnp.asarray([0.0, jnp.inf])
        # how fast v_y changes in a spin, no yaw acceleration tells
        unsure = jnp.where(reading.slides, 1.0, moved.sideslip[1])
        sideslip = jnp.stack([moved.sideslip[0], unsure])
        ahead = jnp.stack([across[0][LEVER], across[1][LEVER]])
        return self.roll.read(
            state.roll, reading.sample, reading.seen, moved.sine, moved.speed, sideslip, ahead, dt
        )

    def _fault_age(
        self, state: JointState, reading: Reading, moved: Along, roll: RollState, dt: Array
    ) -> Float[Array, " k"]:
        refused = (moved.filter.rejected > 0) | moved.stuck
        if "attitude" in self.sensors:
            refused = refused.at[self.sensors.index("attitude")].max(self.pitch.is_faulty(moved.pitch))
        turned = reading.held.sense < 0
        faulty = [reading.raw.is_faulty, turned, refused, self.roll.is_faulty(roll)[None]]
        return jnp.where(jnp.concatenate(faulty), state.fault_age + jnp.minimum(dt, _PAUSE), 0.0)

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
