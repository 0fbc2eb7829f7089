"""What the friction estimators share: the model, its noise, and what they say; a method adds its filter."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from roadstate.assembly.rows import Grouping, grouped
from roadstate.core.channels import did_you_mean
from roadstate.core.constants import GRAVITY
from roadstate.core.errors import InputError
from roadstate.core.estimates import Validity
from roadstate.core.gaussian import Info
from roadstate.core.kernel import once
from roadstate.estimators.astray import unspoilt
from roadstate.estimators.base import Estimate, Estimator, Need, Sample, known_only, leaf
from roadstate.estimators.contact import NEEDS, OPTIONAL, Contact, ContactMeter, ContactState
from roadstate.estimators.friction_groups import (
    NORMAL_90,
    USED_STD,
    mean_friction,
    mean_weights,
    reported,
    used_std,
    validity_of,
    within_reason,
)
from roadstate.estimators.friction_model import FrictionInput, FrictionModel
from roadstate.estimators.friction_states import share_learned
from roadstate.estimators.signals import Held, believable, span
from roadstate.estimators.velocity import STALE
from roadstate.filters.base import Filter
from roadstate.linalg import rss, tria
from roadstate.tires import NormalizedDugoff, TireModel, all_tires
from roadstate.vehicles.figures import tire_of
from roadstate.vehicles.three_dof_contact import ThreeDofContact

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_SLOWEST = 1.5  # m/s: below it slips say nothing
_ERROR_TIME = 0.3  # s: correlation time of what the inputs and the tire get wrong
_DRIFT_TIME = 1.0  # s: the same of velocities and steering, whose errors drift
_BIAS_TIME = 1.0  # s: the same of the accelerometers' bias, whose share in a drive's forces changes
_TIRE_SHARE = 0.1  # 1σ of a tire model's force, as a share of it, of what changes from manoeuvre to manoeuvre
_DOUBTLESS = 0.04  # keeps the doubt about a force that is nothing but error below 10⁴ times its variance
_LEAST_STEP = 1e-3  # s
_YAW_NOISE = 0.05  # rad/s/√s
_FIRM_TIME = 0.1  # s that a force must last to prove friction: what kerbs and noise do is no tire's
_PROVEN_WAY = 20.0  # m over which it is forgotten how much friction was used
_LEAST = 0.1  # no road that a car drives on has less
_TINY = 1e-6
_ROWS = ("accel_x", "accel_y", "yaw_accel", "yaw_rate")


class Settings(NamedTuple):
    """How a friction filter is set.

    Attributes:
        grouping: which wheels share a friction.
        mean: prior mean of μ.
        shared_std, own_std: 1σ of the prior, of the part that all groups share and of each group's own.
        shared_walk, own_walk: 1σ of the random walk over 1 m of way, likewise.
        step_std: 1σ of each group's own random walk over one step, whatever its length: √Q of the papers.
        sensor_std: 1σ of every sensor's sample in its SI unit: √R of the papers; ``None`` has it from the
            vehicle file, with what inputs and tire get wrong.
        uses_rate: integrate the yaw rate and read it as it is; else read ṙ, by differences if need be.
        direct: read v_x and v_y as measured, where they are, and free nothing of pitch and roll.
    """

    grouping: Grouping = "front_rear"
    mean: float = 0.8
    shared_std: float = 0.3
    own_std: float = 0.1
    shared_walk: float = 0.01
    own_walk: float = 0.003
    step_std: float = 0.0
    sensor_std: float | None = None
    uses_rate: bool = True
    direct: bool = False


class FrictionState(NamedTuple):
    """Filter state, the contact's, last yaw rate, friction used now, specific force along and across over g
    without what shakes the car (2,), friction proven lately by that, what the tire may get lastingly wrong
    (share of the friction), v_x, v_y and their σ (4,), validity.
    """

    filter: Any
    contact: ContactState
    yaw_rate: Held
    used: Held
    firm: Float[Array, " 2"]
    proven: Float[Array, ""]
    tire: Float[Array, ""]
    velocity: Float[Array, " 4"]
    validity: Int[Array, ""]


class Told(NamedTuple):
    """What a sample tells the filter: the model's input, z, and the contact's new state."""

    u: FrictionInput
    z: Float[Array, " m"]
    contact: ContactState


class FrictionEstimator(Estimator[FrictionState]):
    """Peak friction from a_x, a_y and yaw motion, of tires whose slips, slip angles and loads are measured.

    Attributes:
        model: the state-space model.
        filter: the filter.
        meter: how the contact is read.
        groups: quantities with their wheels.
        has_own_noise: the noise is given, and nothing is added to it.
        sensor_std: 1σ of each sensor's sample, in its unit.
        bias: 1σ of its bias.
        accel_bias: of an accelerometer, m/s².
        file_friction: the friction at which the vehicle file's stiffnesses hold.
    """

    needs: ClassVar[tuple[Need, ...]] = NEEDS
    optional: ClassVar[tuple[str, ...]] = (*OPTIONAL, "yaw_accel")

    channels: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    model: FrictionModel
    filter: Filter[Any]
    meter: ContactMeter
    groups: tuple[tuple[str, tuple[int, ...]], ...] = eqx.field(static=True)
    has_own_noise: bool = eqx.field(static=True)
    sensor_std: Float[Array, " m"]
    bias: Float[Array, " m"]
    accel_bias: Float[Array, ""]
    file_friction: Float[Array, ""]

    @classmethod
    @abstractmethod
    def printed(cls) -> Settings:
        """The settings that the paper prints."""

    @classmethod
    @abstractmethod
    def make_filter(cls, settings: Settings, *, as_printed: bool, **options: Any) -> Filter[Any]:
        """The filter, as printed or as we would set it."""

    @classmethod
    def usual(cls) -> Settings:
        """The settings without ``as_printed``."""
        return Settings()

    @classmethod
    def build(
        cls,
        vehicle: Vehicle,
        available: Collection[str],
        *,
        as_printed: bool = False,
        tire: TireModel | str | None = None,
        filter_options: Mapping[str, Any] | None = None,
        **settings: Any,
    ) -> Self:
        """Compose for a vehicle and the channels there.

        Args:
            vehicle: geometry, mass, tires and sensors' noise are used.
            available: canonical channels with samples.
            as_printed: the paper's own settings, as far as ``settings`` does not change them.
            tire: any tire model, or the name of one that the vehicle file has figures for; default the
                papers' normalised Dugoff. Only that one makes force proportional to friction.
            filter_options: for the filter.
            settings: fields of :class:`Settings`.

        Raises:
            InputError: a grouping or a setting that there is not.
        """
        chosen = cls.printed() if as_printed else cls.usual()
        known_only(settings, Settings._fields)
        chosen = chosen._replace(**settings)
        meter = ContactMeter(vehicle, available, direct=chosen.direct)
        family = grouped("friction", chosen.grouping, "grouping")
        sensors = ["accel_x", "accel_y"]
        if chosen.uses_rate:
            sensors += ["yaw_rate", *(["yaw_accel"] if "yaw_accel" in available else [])]
        else:
            sensors.append("yaw_accel")
        file = vehicle.sensors
        stds = {
            "accel_x": 10 * file.accel.noise_density,
            "accel_y": 10 * file.accel.noise_density,
            "yaw_rate": file.yaw_rate.noise,
            "yaw_accel": file.yaw_accel.noise if "yaw_accel" in available else 150 * file.yaw_rate.noise,
        }
        std = [chosen.sensor_std if chosen.sensor_std is not None else stds[s] for s in sensors]
        bias = [file.accel.bias if s.startswith("accel") else 0.0 for s in sensors]
        model = FrictionModel(
            states=(*family.rows, *(("yaw_rate",) if chosen.uses_rate else ())),
            sensors=tuple(sensors),
            of_wheel=family.of_wheel,
            vehicle=ThreeDofContact.from_vehicle(
                vehicle,
                tire if isinstance(tire, TireModel) else normalized_tire(vehicle, tire),
                # it is a moment on the wheel, and in the slip already
                rolling_resistance=0.0,
                rolling_resistance_speed=0.0,
            ),
            wheel_radius=jnp.full(4, vehicle.wheels.radius),
            mean=leaf(chosen.mean),
            std=jnp.asarray([chosen.shared_std, chosen.own_std]),
            walk=jnp.asarray([chosen.shared_walk, chosen.own_walk]),
            step_std=jnp.asarray([0.0, chosen.step_std]),
        )
        told = ("yaw_accel",) if "yaw_accel" in available else ()
        return cls(
            channels=tuple(dict.fromkeys((*meter.channels, *told))),
            sensors=tuple(sensors),
            model=model,
            filter=cls.make_filter(chosen, as_printed=as_printed, **dict(filter_options or {})),
            meter=meter,
            groups=reported(family.of_wheel),
            has_own_noise=chosen.sensor_std is not None,
            sensor_std=jnp.asarray(np.array(std)),
            bias=jnp.asarray(np.array(bias)),
            accel_bias=leaf(file.accel.bias),
            file_friction=leaf(vehicle.tires.friction),
        )

    def init(self) -> FrictionState:
        """The prior; no sample has come."""
        empty = Held.empty()
        missing = jnp.asarray(int(Validity.SENSOR_MISSING))
        unknown = jnp.asarray([0.0, 0.0, 30.0, 1.0])
        start = self.filter.init(self.model)
        zero = empty.value
        return FrictionState(
            start, self.meter.init(), empty, empty, jnp.zeros(2), zero, zero, unknown, missing
        )

    def told(self, state: FrictionState, sample: Sample, dt: Float[Array, ""]) -> Told:
        """What the model is given at a sample, ``dt`` (s) after the last."""
        known = jnp.stack(self._friction(state.filter, "friction_peak"))
        meter, contact = self.meter.read(state.contact, sample, dt, known)
        speed = contact.velocity[0]
        moves = (jnp.abs(speed) > _SLOWEST) & (contact.age < STALE)
        z = self._read(state, sample, contact, dt)
        z = jnp.where(moves & jnp.isfinite(z), z, jnp.nan)
        return Told(once(self._input(state, contact, dt)), z, meter)

    def step(self, state: FrictionState, sample: Sample, dt: Float[Array, ""]) -> tuple[FrictionState, Info]:
        """Find the contact, then predict and correct with what is measured."""
        sample = believable(sample)
        u, z, meter = self.told(state, sample, dt)
        contact, speed = u.contact, u.contact.velocity[0]
        filter_state, info = self.filter.step(self.model, state.filter, u, z, dt)
        measured = jnp.isfinite(sample["accel_x"]) & jnp.isfinite(sample["accel_y"])
        force = jnp.sqrt(jnp.sum(contact.accel**2) + 1e-12) / GRAVITY
        used = state.used.take(jnp.where(measured, force, jnp.nan), dt)
        proven = state.proven * jnp.exp(-jnp.abs(u.distance) / _PROVEN_WAY)
        change = contact.accel / GRAVITY - state.firm
        firm = state.firm - jnp.where(measured, jnp.expm1(-dt / _FIRM_TIME), 0.0) * change
        bears = rss(firm[0], firm[1]) - NORMAL_90 * rss(USED_STD, self.accel_bias / GRAVITY)
        proven = jnp.where(measured, jnp.maximum(proven, bears), proven)
        yaw_rate = state.yaw_rate.take(sample["yaw_rate"], dt)
        tire = self._learned(state, filter_state, u, dt)
        mean, spread = self._friction(filter_state, "friction_peak")
        spread = jnp.sqrt(spread**2 + (tire * mean) ** 2)
        stands = jnp.abs(speed) < _SLOWEST
        validity = validity_of(mean, spread, stands=stands, age=contact.age, ok=info.ok)
        speed_std = rss(contact.std[0], self.meter.speed_scale * speed)
        velocity = jnp.append(contact.velocity[:2], jnp.stack([speed_std, contact.std[1]]))
        new = FrictionState(filter_state, meter, yaw_rate, used, firm, proven, tire, velocity, validity)
        return unspoilt(
            new, self.init(), self.filter.posterior(filter_state), used.value, proven, tire, velocity
        ), info

    def estimate(self, state: FrictionState) -> Estimate:
        """Peak friction of the car, of its groups, with bounds; and the friction used.

        A bound lies within what any road can have; that of the whole car is no lower than what was used along
        the last metres.
        """
        values: dict[str, Array] = {}
        std: dict[str, Array] = {}
        values["friction_used"], std["friction_used"] = state.used.value, used_std(state.used)
        for i, name in enumerate(("speed", "velocity_y")):
            values[name], std[name] = state.velocity[i], state.velocity[2 + i]
        for name, _ in self.groups:
            mean, spread = self._friction(state.filter, name)
            spread = jnp.sqrt(spread**2 + (state.tire * mean) ** 2)
            proven = state.proven if name == "friction_peak" and not self.has_own_noise else 0.0
            values[name], low, high = within_reason(mean, spread, proven)
            std[name], values[f"{name}_lower"], values[f"{name}_upper"] = spread, low, high
        return Estimate(values, std, state.validity)

    def weights(self, quantity: str, like: Array) -> Float[Array, " n"]:
        """What the mean friction of a quantity's wheels takes of each state; ``like`` the states, (n,)."""
        return mean_weights(self.model.of_wheel, dict(self.groups)[quantity], like)

    def _friction(self, state: Any, quantity: str) -> tuple[Array, Array]:
        """Mean and 1σ of a quantity."""
        wheels = dict(self.groups)[quantity]
        return mean_friction(self.filter.posterior(state), self.model.of_wheel, wheels)

    def _read(
        self, state: FrictionState, sample: Sample, contact: Contact, dt: Float[Array, ""]
    ) -> Float[Array, " m"]:
        """z, NaN where no sample came."""
        nothing = jnp.full((), jnp.nan)
        rows = {
            "accel_x": jnp.where(jnp.isfinite(sample["accel_x"]), contact.accel[0], nothing),
            "accel_y": jnp.where(jnp.isfinite(sample["accel_y"]), contact.accel[1], nothing),
            "yaw_rate": sample["yaw_rate"],
        }
        if "yaw_accel" in self.channels:
            rows["yaw_accel"] = sample["yaw_accel"]
        else:
            elapsed = state.yaw_rate.age + dt
            fresh = (elapsed > _LEAST_STEP) & (elapsed < STALE)
            change = sample["yaw_rate"] - state.yaw_rate.value
            rows["yaw_accel"] = jnp.where(fresh, change / jnp.where(fresh, elapsed, 1.0), nothing)
        return jnp.stack([rows[sensor] for sensor in self.sensors])

    def _input(self, state: FrictionState, contact: Contact, dt: Float[Array, ""]) -> FrictionInput:
        """The model's input, with the noise of sensors and, unless that is given, of inputs, biases, tire.

        Errors in what the tire model is told are errors in variables: noise taken for a slip looks like a
        tire that gives no force for it, which draws the friction to zero. So a row counts only as far as its
        force exceeds what such errors make of nothing: its variance grows with (2σ/force)⁴.
        """
        distance, model = contact.velocity[0] * dt, self.model
        x = self.filter.posterior(state.filter).mean
        if self.has_own_noise:
            shares = model.wheel_shares(jnp.ones(4, x.dtype), contact) if model.is_proportional else None
            return FrictionInput(contact, distance, jnp.diag(self.sensor_std), leaf(_YAW_NOISE), shares)
        step = span(state.contact.held["accel_y"].age, dt, STALE)
        # noise is judged by a friction that a road can have: near zero, no force would exceed its own noise
        x = jnp.maximum(x, _LEAST)
        shares, slopes = once(model.sensitivity(x, contact))
        weights = model.friction(x) if model.is_proportional else jnp.ones(4, x.dtype)
        value = jnp.sum(shares[:, :4] * weights, axis=1) + shares[:, 4]
        error = jnp.sqrt(jnp.sum(slopes**2, axis=1) + _TINY**2)
        doubt = 1 + (4 * error**2 / (value**2 + _DOUBTLESS * error**2)) ** 2
        drifting = np.sqrt(_DRIFT_TIME / _ERROR_TIME)
        slopes = slopes * jnp.asarray([drifting] * 3 + [1.0] * 4, slopes.dtype)
        columns = jnp.concatenate([slopes, _TIRE_SHARE * jnp.diag(value)], axis=1)
        rows = np.array([min(_ROWS.index(s), 2) for s in self.sensors])
        is_rate = jnp.asarray([s == "yaw_rate" for s in self.sensors])
        lasting = jnp.where(is_rate, 0.0, jnp.sqrt(doubt[rows] * _ERROR_TIME / step))[:, None]
        own = jnp.sqrt(self.sensor_std**2 + self.bias**2 * (_BIAS_TIME / step))
        sqrt_R = tria(jnp.concatenate([jnp.diag(own), columns[rows] * lasting], axis=1))
        yaw = jnp.sqrt(_YAW_NOISE**2 + doubt[2] * _ERROR_TIME * jnp.sum(columns[2] ** 2))
        mean, spread = self._friction(state.filter, "friction_peak")
        # more was used than there was: the road is another
        jump = jnp.where(state.proven > mean + NORMAL_90 * spread, model.std[0], 0.0)
        return FrictionInput(contact, distance, sqrt_R, yaw, shares if model.is_proportional else None, jump)

    def _learned(
        self, state: FrictionState, filter_state: Any, u: FrictionInput, dt: Float[Array, ""]
    ) -> Float[Array, ""]:
        """Mean of the model's ``tire_error`` over the samples that made the estimate, by what each added."""
        if self.has_own_noise:
            return state.tire
        before, after = (self.filter.posterior(f) for f in (state.filter, filter_state))
        weights = self.weights("friction_peak", before.mean)
        share = share_learned(before, after, self.model.sqrt_Q(u, dt), weights)
        error = self.model.feigned(weights @ before.mean / self.file_friction, u.contact)
        return state.tire + share * (error - state.tire)


def normalized_tire(vehicle: Vehicle, model: str | None = None) -> TireModel:
    """The papers' normalised Dugoff, or another model, with the vehicle file's stiffnesses.

    Raises:
        InputError: the vehicle file has no figures for it, or there is none of that name.
    """
    name = NormalizedDugoff.name if model is None else model
    if name not in all_tires():
        raise InputError(f"no tire model is called '{name}'", mend=did_you_mean(name, all_tires()))
    tires = vehicle.tires.model_copy(update={"model": name})
    return tire_of(vehicle.model_copy(update={"tires": tires}))
