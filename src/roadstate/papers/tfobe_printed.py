"""The three grade estimators of paper 002 with its own equations and noises."""

from __future__ import annotations

from collections.abc import Collection
from math import sqrt
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.assembly import AssembledModel, assemble
from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.core.estimates import Validity
from roadstate.core.gaussian import Gaussian, Info
from roadstate.estimators import Estimate, Estimator, Need, Sample
from roadstate.estimators.base import leaf
from roadstate.estimators.signals import Held, SpeedMeter
from roadstate.estimators.tfobe import TFOBE
from roadstate.estimators.traction import TractionMeter, TractionState
from roadstate.filters import KF, UKF, FilterState
from roadstate.linalg import root
from roadstate.statespace import StateSpaceModel
from roadstate.vehicles import SevenDofForces, ThreeDofForces

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

STEP = 0.01
"""s: the paper prints covariances per step, but not its step."""
_KILO = 1000.0  # N: the printed Q_F lets forces change at all only where they are in kN
_R, _Q = 1e-2, 1e-4  # of the upper layer; KMBE's and DEBE's, which are not printed, are taken to be the same


def _density(variance: float, unit: float = 1.0) -> float:
    return unit * sqrt(variance / STEP)


class _Drive(NamedTuple):
    accel: Float[Array, ""]


class SlopeModel(StateSpaceModel):
    """x = [v_x, s]: v̇_x = u − g sin θ − resistances, and the speed is measured (eqs. 37, 38).

    Attributes:
        drag, rolling: ½ρC_dA/m (1/m) and f; zero for eq. 38, whose s is g sin θ; that of eq. 37 is θ.
        is_angle: whether s is θ.
    """

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    is_angle: bool = eqx.field(static=True)
    drag: Float[Array, ""]
    rolling: Float[Array, ""]

    def f(self, x: Float[Array, " 2"], u: _Drive, dt: Float[Array, ""]) -> Float[Array, " 2"]:
        """Explicit Euler."""
        slope = x[1]
        if self.is_angle:
            slope = GRAVITY * (jnp.sin(x[1]) + self.rolling * jnp.cos(x[1])) + self.drag * x[0] ** 2
        return jnp.stack([x[0] + dt * (u.accel - slope), x[1]])

    def h(self, x: Float[Array, " 2"], u: _Drive) -> Float[Array, " 1"]:
        """The speed."""
        return x[:1]

    def sqrt_Q(self, u: _Drive, dt: Float[Array, ""]) -> Float[Array, "2 2"]:
        """Printed per step."""
        return _density(_Q) * root(dt) * jnp.eye(2)

    def sqrt_R(self, u: _Drive) -> Float[Array, "1 1"]:
        """One sensor."""
        return jnp.full((1, 1), _R**0.5)

    def prior(self) -> Gaussian:
        """Not printed."""
        return Gaussian(jnp.zeros(2), jnp.diag(jnp.asarray([30.0, 0.1 if self.is_angle else 1.0])))


class _SlopeState(NamedTuple):
    filter: FilterState
    accel: Held
    traction: TractionState | None


class PrintedSlope(Estimator[_SlopeState]):
    """KMBE (eq. 38, KF) or DEBE (eq. 37, UKF) of paper 002: no turning, no inertia of wheels, no pitch.

    Attributes:
        traction: for DEBE.
    """

    name: ClassVar[str] = "debe"
    summary: ClassVar[str] = "KMBE and DEBE as printed"
    needs: ClassVar[tuple[Need, ...]] = ()
    channels: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    model: SlopeModel
    filter: KF | UKF
    meter: SpeedMeter
    traction: TractionMeter | None
    mass: Float[Array, ""]

    @classmethod
    def build(cls, vehicle: Vehicle, available: Collection[str], **options: Any) -> Self:
        """For ``method`` ``kmbe`` or ``debe``."""
        dynamic = options["method"] == "debe"
        meter = SpeedMeter(vehicle, [c for c in available if c != "gear_ratio"])
        traction = TractionMeter(vehicle, available) if dynamic else None
        drag = vehicle.drag_factor / vehicle.mass
        model = SlopeModel(
            states=("speed", "grade" if dynamic else "specific_grade"),
            sensors=("speed",),
            is_angle=dynamic,
            drag=leaf(drag if dynamic else 0.0),
            rolling=leaf(vehicle.rolling_resistance.coefficient if dynamic else 0.0),
        )
        more = traction.channels if traction is not None else ("accel_x",)
        return cls(
            channels=tuple(dict.fromkeys((*meter.channels, *more))),
            sensors=("speed",),
            model=model,
            filter=UKF() if dynamic else KF(),
            meter=meter,
            traction=traction,
            mass=leaf(vehicle.mass),
        )

    def init(self) -> _SlopeState:
        """Not printed."""
        traction = None if self.traction is None else self.traction.init()
        return _SlopeState(self.filter.init(self.model), Held.empty(), traction)

    def step(self, state: _SlopeState, sample: Sample, dt: Float[Array, ""]) -> tuple[_SlopeState, Info]:
        """As :meth:`Estimator.step`."""
        zero, traction = jnp.zeros(()), state.traction
        accel = state.accel.take(sample.get("accel_x", jnp.full((), jnp.nan)), dt)
        push = accel.value
        if self.traction is not None and traction is not None:
            traction, drive = self.traction.read(traction, sample, state.filter.gaussian.mean[0], dt)
            push = drive.force / self.mass
        speeds, _ = self.meter.read(sample, zero, zero, zero + 1)
        new, info = self.filter.step(self.model, state.filter, _Drive(push), jnp.mean(speeds)[None], dt)
        return _SlopeState(new, accel, traction), info

    def estimate(self, state: _SlopeState) -> Estimate:
        """Grade and speed."""
        mean, std = state.filter.gaussian.mean, state.filter.gaussian.std
        angle, spread = mean[1], std[1]
        if not self.model.is_angle:
            angle, spread = jnp.arcsin(jnp.clip(mean[1] / GRAVITY, -0.99, 0.99)), std[1] / GRAVITY
        values = {"grade": angle, "speed": mean[0]}
        return Estimate(values, {"grade": spread, "speed": std[0]}, jnp.asarray(int(Validity.EXCITED)))


class _State(NamedTuple):
    forces: FilterState
    grade: FilterState
    traction: TractionState
    steer: Held
    begun: Float[Array, ""]


class PrintedTFOBE(Estimator[_State]):
    """TFOBE as printed: eqs. 26–31 below, 32–36 above, Q_F, R_F, Q_θ, R_θ per step of 0.01 s, Euler.

    The printed R_θ has two entries for three sensors; all three get them. Neither layer measures v_x; both
    start at the speed that the wheels tell.
    """

    name: ClassVar[str] = "tfobe"
    summary: ClassVar[str] = "TFOBE as printed"
    needs: ClassVar[tuple[Need, ...]] = TFOBE.needs
    channels: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    accel: tuple[str, str] = eqx.field(static=True)
    below: AssembledModel
    above: AssembledModel
    filter: UKF
    meter: SpeedMeter
    traction: TractionMeter
    radius: Float[Array, ""]

    @classmethod
    def build(cls, vehicle: Vehicle, available: Collection[str], **options: Any) -> Self:
        """Compose for a vehicle and the channels there.

        Option ``below`` is the longitudinal acceleration that the lower layer takes, ``kinematic_accel_x``
        (which the paper's simulator prints) or ``accel_x``. Where there are no kinematic accelerations, the
        lower layer takes ``accel_x`` and the upper one measures the speed.
        """
        meter, traction = SpeedMeter(vehicle, available), TractionMeter(vehicle, available)
        spins, motion = tuple(f"wheel_speed_{w}" for w in WHEELS), ("speed", "velocity_y", "yaw_rate")
        state_noise = {"speed": _density(_Q), "velocity_y": _density(_Q), "wheel_speed": _density(_Q)}
        start = {"speed": (0.0, 1.0), "velocity_y": (0.0, 0.1), "yaw_rate": (0.0, 0.1)}
        below = assemble(
            SevenDofForces.from_vehicle(vehicle),
            states=(*motion, "wheel_speed"),
            parameters=("force_x", "force_y"),
            sensors=("accel_x", "accel_y", "yaw_rate", "wheel_speed"),
            noise=state_noise
            | {
                "yaw_rate": _density(8e-5),
                "force_x": _density(1e-6, _KILO),
                "force_y": _density(1e-5, _KILO),
            },
            sensor_noise=dict.fromkeys(("accel_x", "accel_y", "yaw_rate", "wheel_speed"), 1e-2),
            prior=start | {"wheel_speed": (0.0, 100.0), "force_x": (0.0, _KILO), "force_y": (0.0, _KILO)},
        )
        is_simulated = "kinematic_accel_x" in available
        seen = (
            ("kinematic_accel_x", "kinematic_accel_y", "yaw_rate") if is_simulated else ("speed", "yaw_rate")
        )
        above = assemble(
            ThreeDofForces.from_vehicle(vehicle),
            states=motion,
            parameters=("grade",),
            sensors=seen,
            noise=dict.fromkeys((*motion, "grade"), _density(_Q)),
            sensor_noise=dict.fromkeys(seen, _R**0.5),
            prior=start | {"grade": (0.0, 0.1)},
        )
        felt = options.get("below", seen[0]) if is_simulated else "accel_x"
        used = ("yaw_rate", *(seen if is_simulated else ()), felt, "accel_y", *spins)
        return cls(
            channels=tuple(dict.fromkeys((*meter.channels, *traction.channels, *used))),
            sensors=("accel_x", "accel_y", "yaw_rate", *spins),
            accel=(felt, "accel_y"),
            below=below,
            above=above,
            filter=UKF(),
            meter=meter,
            traction=traction,
            radius=leaf(vehicle.wheels.radius),
        )

    def init(self) -> _State:
        """Speeds are those of the first sample."""
        start = self.filter.init(self.below), self.filter.init(self.above)
        return _State(*start, self.traction.init(), Held.empty(), jnp.zeros(()))

    def step(self, state: _State, sample: Sample, dt: Float[Array, ""]) -> tuple[_State, Info]:
        """As :meth:`Estimator.step`."""
        spin = jnp.stack([sample[f"wheel_speed_{w}"] for w in WHEELS])
        speed = self.radius * jnp.mean(spin)

        def begun(filtered: FilterState) -> FilterState:
            mean = filtered.gaussian.mean
            first = jnp.where((state.begun == 0) & jnp.isfinite(speed), speed, mean[0])
            started: FilterState = eqx.tree_at(lambda s: s.gaussian.mean, filtered, mean.at[0].set(first))
            return started

        traction, drive = self.traction.read(state.traction, sample, speed, dt)
        steer = state.steer.take(self.meter.steer(sample), dt)
        u = {"steer": steer.value, "steer_rear": jnp.zeros(())}
        torques = {f"drive_torque_{w}": drive.drive_torque[i] for i, w in enumerate(WHEELS)}
        torques |= {f"brake_torque_{w}": drive.brake_torque[i] for i, w in enumerate(WHEELS)}
        felt = jnp.stack([sample[self.accel[0]], sample[self.accel[1]], sample["yaw_rate"]])
        z = jnp.concatenate([felt, spin])
        forces, info = self.filter.step(self.below, begun(state.forces), u | torques, z, dt)
        F = forces.gaussian.mean[7:]
        u |= {f"force_{a}_{w}": F[4 * j + i] for j, a in enumerate("xy") for i, w in enumerate(WHEELS)}
        told = {**sample, "speed": speed}
        seen = jnp.stack([told[name] for name in self.above.sensors])
        grade, _ = self.filter.step(self.above, begun(state.grade), u, seen, dt)
        return _State(forces, grade, traction, steer, jnp.ones(())), info

    def estimate(self, state: _State) -> Estimate:
        """Grade, motion and forces."""
        upper, lower = state.grade.gaussian, state.forces.gaussian
        values = {"grade": upper.mean[3], "speed": upper.mean[0], "velocity_y": upper.mean[1]}
        stds = {"grade": upper.std[3], "speed": upper.std[0], "velocity_y": upper.std[1]}
        for j, axis in enumerate("xy"):
            for i, wheel in enumerate(WHEELS):
                place = 7 + 4 * j + i
                values[f"force_{axis}_{wheel}"] = lower.mean[place]
                stds[f"force_{axis}_{wheel}"] = lower.std[place]
        return Estimate(values, stds, jnp.asarray(int(Validity.EXCITED)))
