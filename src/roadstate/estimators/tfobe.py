"""TFOBE: road grade from tire forces, by two stacked unscented Kalman filters."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
import jax.scipy.linalg as jsl
import numpy as np
from jaxtyping import Array, Float, Int

from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.core.estimates import Validity
from roadstate.core.gaussian import Gaussian, Info, Reason
from roadstate.core.kernel import once
from roadstate.estimators.astray import is_astray, led_back
from roadstate.estimators.base import Estimate, Estimator, Need, Sample, Smoothable, known_only, leaf
from roadstate.estimators.force_observer import FELT, ForceObserver, Forces, ForceState, meter_sample
from roadstate.estimators.road import GradePrior
from roadstate.estimators.signals import STANDSTILL_SPEED, SpeedMeter, believable, span
from roadstate.estimators.tire_forces import DRIVE_GAIN, FORCE_X, FORCE_Y, YAW_RATE
from roadstate.filters import FilterState, GateRule
from roadstate.filters.base import is_finite
from roadstate.filters.marginal import MarginalUKF
from roadstate.linalg import root, rss
from roadstate.statespace import StateSpaceModel
from roadstate.vehicles import ThreeDofForces

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_SILENT = 3.0  # s without a channel after which the estimate is called a prediction
_SLIP_ERROR = 0.2  # 1σ of a slip reckoned from the force, as a share of it
_LARGEST_SLIP = 0.1  # beyond which slip does not grow with force as it does here
_SLIP_ANGLE_ERROR = (0.003, 0.15)  # rad, and share: 1σ of the rear slip angle reckoned from the force
_MODEL_TIME = 1.0  # s: correlation time of these errors
_LATERAL = 0.3  # m/s²/√Hz: what a bank does to v_y
_YAW = 0.3  # rad/s²/√Hz: what forces do not tell of ṙ


class _GradeInput(NamedTuple):
    forces: Float[Array, " 10"]
    speed: Float[Array, ""]
    intensity: Float[Array, ""]
    sensor_std: Float[Array, " m"]


class GradeModel(StateSpaceModel):
    """x = [v_x, v_y, r, θ, dθ/d(distance)] under tire forces that are given (paper 002 eqs. 32–36).

    Attributes:
        vehicle: planar motion under given forces.
        road: how the grade changes.
    """

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    vehicle: ThreeDofForces
    road: GradePrior

    @property
    def nonlinear(self) -> tuple[str, ...]:
        """All but the rate of the grade."""
        return self.states[:4]

    def f(self, x: Float[Array, " 5"], u: _GradeInput, dt: Float[Array, ""]) -> Float[Array, " 5"]:
        """Explicit Euler in the motion, exact in the road."""
        car = eqx.tree_at(lambda v: v.grade, self.vehicle, x[3])
        motion = x[:3] + dt * car.derivative(x[:3], u.forces)
        return jnp.concatenate([motion, self.road.transition(u.speed * dt) @ x[3:]])

    def h(self, x: Float[Array, " 5"], u: _GradeInput) -> Float[Array, " m"]:
        """Each axle's speed, yaw rate, lateral velocity."""
        return jnp.stack([x[{"yaw_rate": 2, "velocity_y": 1}.get(sensor, 0)] for sensor in self.sensors])

    def sqrt_Q(self, u: _GradeInput, dt: Float[Array, ""]) -> Float[Array, "5 5"]:
        """White errors of the specific force and of the yaw moment, and the road."""
        rest = jnp.asarray([_LATERAL, _YAW], u.intensity.dtype)
        white = jnp.concatenate([u.intensity[None], rest])
        return jnp.asarray(jsl.block_diag(jnp.diag(white * root(dt)), self.road.sqrt_Q(u.speed * dt)))

    def sqrt_R(self, u: _GradeInput) -> Float[Array, "m m"]:
        """Independent sensors."""
        return jnp.diag(u.sensor_std)

    def prior(self) -> Gaussian:
        """Any motion a road car has, and the road's own grade."""
        std = jnp.concatenate([jnp.asarray([30.0, 1.0, 0.5]), self.road.stationary_std])
        return Gaussian(jnp.zeros(5), jnp.diag(std))


class TFOBEState(NamedTuple):
    """Both layers, the time since a wheel was seen (s), the latest errors and validity.

    ``slow`` is the 1σ (m/s²) of that part of the specific force's error that does not average out,
    ``velocity_y_error`` that of the lateral velocity (m/s).
    """

    forces: ForceState
    grade: FilterState
    speed_age: Float[Array, ""]
    slow: Float[Array, ""]
    velocity_y_error: Float[Array, ""]
    validity: Int[Array, ""]


class TFOBE(Estimator[TFOBEState]):
    """Tire-force-observation-based estimator of road grade (paper 002).

    The lower layer (:class:`~roadstate.estimators.tire_forces.TireForceModel`) finds the tires' forces from
    torques, wheel speeds, accelerations and yaw rate, the upper one the grade under them, from how the speed
    really changes: θ shows in what forces say less v̇_x. So force has two witnesses: the accelerometer, whose
    scale is good and whose zero is not (bias, mounting), and the torques, of which the opposite is true
    (mass, gains); what they disagree by is learned, and each mends the other.

    Beyond the paper: v_x is measured above and known below (as printed, nothing measures it and it drifts);
    wheel speeds are freed of the slip that the forces make; v_y is read from the rear axle, v_y = l_r r −
    v_x F_yr/C_r; the grade is a road's (:class:`~roadstate.estimators.road.GradePrior`); wheels' rolling
    resistance; bias, scale and gains; noises for any step, from the vehicle file.

    Needs the speeds of all wheels, both accelerometers, yaw rate, steering and a drive torque, at the wheels
    or at the engine with its gear. Brake torques or pressures if there; brakes that no channel tells of are
    recognised from the accelerometer. Assumes an IMU near the centre of gravity and a road without sudden
    bank. What it cannot know: how an axle's lateral force is shared by its wheels (by load, and σ says so);
    what of the force comes from a wrong mass; an error that torques and accelerometer share.

    Standard deviations: of the grade, the upper filter's and that part of the specific force's error that the
    slow states explain, which does not average out; of forces also what is not known of the mass.

    Attributes:
        observer: the lower layer.
        model: the upper layer's state-space model.
        filter: its filter.
        meter: how speed is read.
    """

    name: ClassVar[str] = "tfobe"
    summary: ClassVar[str] = "grade and tire forces from wheel speeds, torques and accelerations (two UKFs)"
    needs: ClassVar[tuple[Need, ...]] = (
        Need("the speeds of all wheels", (tuple(f"wheel_speed_{w}" for w in WHEELS),)),
        Need("accelerometers and yaw rate", (FELT,)),
        Need("the steering angle", (("steer",), ("steering_wheel",))),
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
        "brake",
        *(f"{kind}_{w}" for kind in ("brake_torque", "brake_pressure") for w in WHEELS),
    )
    smoothable: ClassVar[Smoothable | None] = Smoothable("filter", "grade", ("grade", "speed", "velocity_y"))

    channels: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    observer: ForceObserver
    model: GradeModel
    filter: MarginalUKF
    meter: SpeedMeter
    yaw_noise: Float[Array, ""]
    slip_stiffness: Float[Array, ""]
    rear_stiffness: Float[Array, ""]
    speed_scale: Float[Array, ""]
    mass_share: Float[Array, ""]
    mass_std: Float[Array, ""]

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
        meter, observer = SpeedMeter(vehicle, available), ForceObserver(vehicle, available)
        prior, sensors = vehicle.prior, vehicle.sensors
        model = GradeModel(
            states=("speed", "velocity_y", "yaw_rate", "grade", "grade_rate"),
            sensors=(*meter.sensors, "yaw_rate", "velocity_y"),
            vehicle=ThreeDofForces.from_vehicle(vehicle),
            road=GradePrior(leaf(prior.grade_std), leaf(prior.grade_correlation_length)),
        )
        torque = observer.torque_relative
        both = max(float(np.hypot(prior.mass_relative, torque)), 1e-9)
        return cls(
            channels=tuple(dict.fromkeys((*meter.channels, *observer.channels))),
            sensors=(*observer.model.sensors, *meter.sensors),
            observer=observer,
            model=model,
            filter=MarginalUKF(gate=GateRule()),
            meter=meter,
            yaw_noise=leaf(sensors.yaw_rate.noise),
            slip_stiffness=leaf(vehicle.tires.slip_stiffness),
            rear_stiffness=leaf(vehicle.axle_cornering_stiffness[1]),
            speed_scale=leaf(sensors.wheel_speed.scale),
            mass_share=leaf((prior.mass_relative / both) ** 2),
            mass_std=leaf(prior.mass_relative * torque / both),
        )

    def init(self) -> TFOBEState:
        """The prior; no sample has come."""
        return TFOBEState(
            forces=self.observer.init(),
            grade=self.filter.init(self.model),
            speed_age=jnp.full((), 1e6),
            slow=self.observer.model.slow_std[0],
            velocity_y_error=jnp.ones(()),
            validity=jnp.asarray(int(Validity.SENSOR_MISSING)),
        )

    def step(self, state: TFOBEState, sample: Sample, dt: Float[Array, ""]) -> tuple[TFOBEState, Info]:
        """Forces first, then the grade under them."""
        x, sample = state.grade.gaussian.mean, believable(sample)
        lower, forces, seen = self.observer.step(state.forces, sample, self.meter.steer(sample), x[0], dt)
        before, now = state.forces.filter.gaussian.mean, lower.filter.gaussian.mean
        since = span(state.forces.held["yaw_rate"].age, dt, _MODEL_TIME)
        u, z, error = self._upper(forces, sample, before, now, x, since)
        grade, told = self.filter.step(self.model, state.grade, u, z, dt)
        mean = grade.gaussian.mean
        astray = is_astray(grade.gaussian, mean[0], GRAVITY * mean[3]) | ~is_finite(lower.filter.gaussian)
        # what the lower layer has learnt may come from what led the upper one there
        lower = lower._replace(filter=led_back(astray, self.observer.model.prior(), lower.filter))
        grade = led_back(astray, self.model.prior(), grade)
        speed_age = jnp.where(jnp.any(forces.is_seen), 0.0, state.speed_age + dt)
        validity = jnp.where(forces.is_shifting, int(Validity.GEAR_SHIFT), int(Validity.EXCITED))
        validity = jnp.where(forces.is_brake_unknown, int(Validity.BRAKING), validity)
        stands = jnp.abs(grade.gaussian.mean[0]) < STANDSTILL_SPEED
        validity = jnp.where(stands, int(Validity.STANDSTILL), validity)
        silent = jnp.maximum(forces.age, speed_age) >= _SILENT
        validity = jnp.where(silent, int(Validity.SENSOR_MISSING), validity)
        validity = jnp.where(seen.ok & told.ok & ~astray, validity, int(Validity.DIVERGED))
        turning = error * grade.gaussian.mean[2]
        slow = rss(forces.slow_std, turning)
        new = TFOBEState(lower, grade, speed_age, slow, error, validity)
        return new, _joined(seen, told, len(self.meter.sensors))

    def _upper(
        self,
        forces: Forces,
        sample: Sample,
        before: Float[Array, " 16"],
        now: Float[Array, " 16"],
        x: Float[Array, " 5"],
        since: Float[Array, ""],
    ) -> tuple[_GradeInput, Float[Array, " m"], Float[Array, ""]]:
        """Input and measurement of the upper layer, and the 1σ of the lateral velocity's error (m/s).

        Args:
            forces: of this instant.
            sample: the channels.
            before, now: means of the lower layer.
            x: mean of the upper one, so far.
            since: s that a sample of the yaw rate counts for.
        """
        speed, vehicle = x[0], self.model.vehicle
        between = 0.5 * (before + now)
        load = jnp.maximum(forces.load, 0.1 * jnp.mean(forces.load))
        along = now[FORCE_X] / (self.slip_stiffness * load)
        slip = jnp.clip(along, -_LARGEST_SLIP, _LARGEST_SLIP)
        # slip is over |v|: a force ahead turns a wheel of a car that backs up less fast
        rolling = forces.wheel_speed / (1 + slip * jnp.sign(forces.wheel_speed))
        rolling = jnp.where(forces.is_seen, rolling, jnp.nan)
        direction = jnp.ones_like(speed)
        metered = meter_sample(sample, rolling, self.meter)
        speeds, std = self.meter.read(metered, now[YAW_RATE], forces.steer, direction)
        angle = now[FORCE_Y.start + 1] / self.rear_stiffness
        error = jnp.abs(speed) * rss(_SLIP_ANGLE_ERROR[0], _SLIP_ANGLE_ERROR[1] * angle) + 0.01
        lasting = jnp.sqrt(_MODEL_TIME / since)
        seen = jnp.isfinite(sample["yaw_rate"])
        lateral = jnp.where(seen, now[YAW_RATE] * vehicle.cg_to_rear_axle - jnp.abs(speed) * angle, jnp.nan)
        yaw_rate = jnp.where(seen, sample["yaw_rate"], jnp.nan)
        sides = 0.5 * jnp.repeat(between[FORCE_Y], 2)
        steer = jnp.stack([forces.steer, jnp.zeros_like(speed)])
        u = _GradeInput(
            forces=jnp.concatenate([steer, between[FORCE_X], sides]),
            speed=speed,
            intensity=forces.intensity,
            sensor_std=jnp.concatenate([std, jnp.stack([self.yaw_noise, error * lasting])]),
        )
        return u, jnp.concatenate([speeds, jnp.stack([yaw_rate, lateral])]), error

    def estimate(self, state: TFOBEState) -> Estimate:
        """Grade, motion and forces."""
        upper = self.filter.posterior(state.grade)
        mean, std = upper.mean, upper.std
        extra = jnp.stack([self.speed_scale * mean[0], state.velocity_y_error, state.slow / GRAVITY])
        own = jnp.sqrt(std[jnp.asarray([0, 1, 3])] ** 2 + extra**2)
        lower = state.forces.filter.gaussian
        F, spread = self.observer.by_wheel_and_axle(state.forces)
        relative = self.mass_std**2 + (self.mass_share * lower.std[DRIVE_GAIN]) ** 2
        factor = 1 - self.mass_share * lower.mean[DRIVE_GAIN]
        names = ("speed", "velocity_y", "grade", *self.observer.quantities)
        values = once(jnp.concatenate([mean[jnp.asarray([0, 1, 3])], factor * F]))
        stds = once(jnp.concatenate([own, jnp.sqrt(spread**2 + relative * F**2)]))
        return Estimate(
            {name: values[i] for i, name in enumerate(names)},
            {name: stds[i] for i, name in enumerate(names)},
            state.validity,
        )


def _joined(lower: Info, upper: Info, speeds: int) -> Info:
    """What both layers tell, of the sensors that are the car's own."""
    keep = slice(0, speeds)
    zero = jnp.zeros((lower.innovation.shape[0], speeds))
    reasons = jnp.maximum(lower.reason, upper.reason)
    idle = (reasons == Reason.NO_MEASUREMENT) & (lower.reason != upper.reason)  # one layer only
    return Info(
        innovation=jnp.concatenate([lower.innovation, upper.innovation[keep]]),
        S=jnp.block([[lower.S, zero], [zero.T, upper.S[keep, keep]]]),
        nis=lower.nis + upper.nis,
        log_likelihood=lower.log_likelihood + upper.log_likelihood,
        gate=jnp.concatenate([lower.gate, upper.gate[keep]]),
        ok=lower.ok & upper.ok,
        reason=jnp.where(idle, jnp.minimum(lower.reason, upper.reason), reasons),
    )
