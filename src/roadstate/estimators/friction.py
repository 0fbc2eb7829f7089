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
from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.core.errors import InputError
from roadstate.core.estimates import Validity
from roadstate.core.gaussian import Info
from roadstate.estimators.base import Estimate, Estimator, Need, Sample, leaf
from roadstate.estimators.contact import NEEDS, OPTIONAL, Contact, ContactMeter, ContactState
from roadstate.estimators.friction_model import FrictionInput, FrictionModel
from roadstate.estimators.signals import Held
from roadstate.estimators.velocity import STALE
from roadstate.filters.base import Filter
from roadstate.linalg import tria
from roadstate.tires import NormalizedDugoff, TireModel
from roadstate.vehicles.figures import tire_of
from roadstate.vehicles.three_dof_contact import ThreeDofContact

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_SLOWEST = 1.5  # m/s: below it slips say nothing
_SILENT = 1.0  # s without what the contact is made of after which nothing is known
_ERROR_TIME = 0.3  # s: correlation time of what the inputs and the tire get wrong
_BIAS_TIME = 1.0  # s: the same of the accelerometers' bias, whose share in a drive's forces changes
_TIRE_SHARE = 0.1  # 1σ of a tire model's force, as a share of it
_LEAST_STEP = 1e-3  # s
_YAW_NOISE = 0.05  # rad/s/√s
_KNOWN = 0.15  # 1σ over μ up to which friction counts as determined
_USED_STD = 0.01  # of the used friction, from what the accelerometers' place and the air do
_USED_WANDER = 0.3  # 1/√s: how the used friction wanders while not measured
_NORMAL_90 = 1.6449  # two-sided 90 % of a normal distribution
_TINY = 1e-6
_ROWS = ("accel_x", "accel_y", "yaw_accel", "yaw_rate")
_GROUPS = {"front": (0, 1), "rear": (2, 3), "left": (0, 2), "right": (1, 3)}


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
    """Filter state, the contact's, the last yaw rate, the age of what is read (s), and what it said last."""

    filter: Any
    contact: ContactState
    yaw_rate: Held
    used: Held
    validity: Int[Array, ""]


class FrictionEstimator(Estimator[FrictionState]):
    """Peak friction from a_x, a_y and yaw motion, of tires whose slips, slip angles and loads are measured.

    Attributes:
        model: the state-space model.
        filter: the filter.
        meter: how the contact is read.
        settings: as built.
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
        tire: TireModel | None = None,
        filter_options: Mapping[str, Any] | None = None,
        **settings: Any,
    ) -> Self:
        """Compose for a vehicle and the channels there.

        Args:
            vehicle: geometry, mass, tires and sensors' noise are used.
            available: canonical channels with samples.
            as_printed: the paper's own settings, as far as ``settings`` does not change them.
            tire: any tire model; default the papers' normalised Dugoff with the file's stiffnesses.
            filter_options: for the filter.
            settings: fields of :class:`Settings`.

        Raises:
            InputError: a grouping or a setting that there is not.
        """
        chosen = cls.printed() if as_printed else cls.usual()
        unknown = [name for name in settings if name not in Settings._fields]
        if unknown:
            raise InputError(
                f"no setting is called '{unknown[0]}'", mend=f"known: {', '.join(Settings._fields)}"
            )
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
                normalized_tire(vehicle) if tire is None else tire,
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
            groups=_reported(family.of_wheel),
            has_own_noise=chosen.sensor_std is not None,
            sensor_std=jnp.asarray(np.array(std)),
            bias=jnp.asarray(np.array(bias)),
        )

    def init(self) -> FrictionState:
        """The prior; no sample has come."""
        empty = Held.empty()
        missing = jnp.asarray(int(Validity.SENSOR_MISSING))
        return FrictionState(self.filter.init(self.model), self.meter.init(), empty, empty, missing)

    def step(self, state: FrictionState, sample: Sample, dt: Float[Array, ""]) -> tuple[FrictionState, Info]:
        """Find the contact, then predict and correct with what is measured."""
        meter, contact = self.meter.read(state.contact, sample, dt)
        speed = contact.velocity[0]
        moves = (jnp.abs(speed) > _SLOWEST) & (contact.age < STALE)
        z = self._read(state, sample, contact, dt)
        z = jnp.where(moves & jnp.isfinite(z), z, jnp.nan)
        u = FrictionInput(contact, speed * dt, *self._noise(state, contact, dt))
        filter_state, info = self.filter.step(self.model, state.filter, u, z, dt)
        measured = jnp.isfinite(sample["accel_x"]) & jnp.isfinite(sample["accel_y"])
        force = jnp.sqrt(jnp.sum(contact.accel**2) + 1e-12) / GRAVITY
        used = state.used.take(jnp.where(measured, force, jnp.nan), dt)
        yaw_rate = state.yaw_rate.take(sample["yaw_rate"], dt)
        mean, spread = self._total(filter_state)
        validity = jnp.where(spread < _KNOWN * mean, int(Validity.EXCITED), int(Validity.LOW_EXCITATION))
        validity = jnp.where(jnp.abs(speed) < _SLOWEST, int(Validity.STANDSTILL), validity)
        validity = jnp.where(contact.age < _SILENT, validity, int(Validity.SENSOR_MISSING))
        validity = jnp.where(info.ok, validity, int(Validity.DIVERGED))
        return FrictionState(filter_state, meter, yaw_rate, used, validity), info

    def estimate(self, state: FrictionState) -> Estimate:
        """Peak friction of the car, of its groups, with bounds; and the friction used."""
        gaussian = self.filter.posterior(state.filter)
        values: dict[str, Array] = {}
        std: dict[str, Array] = {}
        used_std = _USED_STD + _USED_WANDER * jnp.sqrt(state.used.age)
        values["friction_used"], std["friction_used"] = state.used.value, used_std
        for name, wheels in self.groups:
            weights = _weights(self.model, wheels, gaussian.mean.dtype)
            mean = weights @ gaussian.mean
            spread = jnp.sqrt(jnp.sum((weights @ gaussian.factor) ** 2))
            values[name], std[name] = mean, spread
            values[f"{name}_lower"] = mean - _NORMAL_90 * spread
            values[f"{name}_upper"] = mean + _NORMAL_90 * spread
        return Estimate(values, std, state.validity)

    def _total(self, state: Any) -> tuple[Array, Array]:
        gaussian = self.filter.posterior(state)
        weights = _weights(self.model, (0, 1, 2, 3), gaussian.mean.dtype)
        return weights @ gaussian.mean, jnp.sqrt(jnp.sum((weights @ gaussian.factor) ** 2))

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

    def _noise(
        self, state: FrictionState, contact: Contact, dt: Float[Array, ""]
    ) -> tuple[Float[Array, "m m"], Float[Array, ""]]:
        """A factor of R, and the noise of ṙ: of sensors, and unless that is given, of inputs, biases, tire.

        Errors in what the tire model is told are errors in variables: noise taken for a slip looks like a
        tire that gives no force for it, which draws the friction to zero. So a row counts only as far as its
        force exceeds what such errors make of nothing: its variance grows with (2σ/force)⁴.
        """
        if self.has_own_noise:
            return jnp.diag(self.sensor_std), leaf(_YAW_NOISE)
        step = jnp.maximum(dt, _LEAST_STEP)
        value, slopes = self.model.sensitivity(self.filter.posterior(state.filter).mean, contact)
        error = jnp.sqrt(jnp.sum(slopes**2, axis=1))
        doubt = 1 + (2 * error / (jnp.abs(value) + _TINY)) ** 4
        rows = np.array([min(_ROWS.index(s), 2) for s in self.sensors])
        is_rate = jnp.asarray([s == "yaw_rate" for s in self.sensors])
        lasting = jnp.where(is_rate, 0.0, jnp.sqrt(doubt[rows] * _ERROR_TIME / step))
        own = jnp.hypot(self.sensor_std, self.bias * jnp.sqrt(_BIAS_TIME / step))
        tire = _TIRE_SHARE * value[rows] * lasting
        parts = [jnp.diag(jnp.hypot(own, tire)), slopes[rows] * lasting[:, None]]
        yaw = jnp.hypot(error[2], _TIRE_SHARE * value[2]) * jnp.sqrt(doubt[2] * _ERROR_TIME)
        return tria(jnp.concatenate(parts, axis=1)), jnp.hypot(_YAW_NOISE, yaw)


def normalized_tire(vehicle: Vehicle) -> TireModel:
    """The papers' normalised Dugoff with the vehicle file's stiffnesses, which it takes at the file's μ."""
    tires = vehicle.tires.model_copy(update={"model": NormalizedDugoff.name})
    return tire_of(vehicle.model_copy(update={"tires": tires}))


def _reported(of_wheel: tuple[int, ...]) -> tuple[tuple[str, tuple[int, ...]], ...]:
    """Quantities with their wheels: the car's, and those that the grouping tells apart."""
    found: list[tuple[str, tuple[int, ...]]] = [("friction_peak", (0, 1, 2, 3))]
    count = len(set(of_wheel))
    if count > 1:
        found += [
            (f"friction_peak_{name}", wheels)
            for name, wheels in _GROUPS.items()
            if count == len(WHEELS) or len({of_wheel[w] for w in wheels}) == 1
        ]
    if count == len(WHEELS):
        found += [(f"friction_peak_{name}", (i,)) for i, name in enumerate(WHEELS)]
    return tuple(found)


def _weights(model: FrictionModel, wheels: tuple[int, ...], dtype: Any) -> Float[Array, " n"]:
    """What a mean over wheels takes of each state."""
    weights = np.zeros(len(model.states))
    for wheel in wheels:
        weights[model.of_wheel[wheel]] += 1 / len(wheels)
    return jnp.asarray(weights, dtype)
