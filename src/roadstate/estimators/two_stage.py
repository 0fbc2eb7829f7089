"""Two stages to friction: tire forces by H∞ filters, then friction by an adaptive UKF (paper 000)."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from roadstate.assembly.rows import grouped
from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.core.estimates import Validity
from roadstate.core.gaussian import Info
from roadstate.core.kernel import once
from roadstate.estimators.astray import unspoilt
from roadstate.estimators.base import Estimate, Estimator, Need, Sample, known_only, leaf
from roadstate.estimators.contact import NEEDS, OPTIONAL, Contact, ContactMeter, ContactState
from roadstate.estimators.force_filter import (
    SLOWEST,
    Direct,
    ForceFilter,
    ForceState,
    Moving,
    from_channels,
)
from roadstate.estimators.friction_groups import (
    ALL_WHEELS,
    mean_friction,
    mean_weights,
    reported,
    used_std,
    validity_of,
    within_reason,
)
from roadstate.estimators.friction_of_forces import YAW_NOISE, ForcesInput, FrictionOfForces
from roadstate.estimators.friction_states import share_learned
from roadstate.estimators.signals import Held, believable, span
from roadstate.estimators.two_stage_settings import PRINTED, Settings, first_stage, second_stage
from roadstate.estimators.velocity import STALE
from roadstate.filters.base import Filter
from roadstate.linalg import product, root, rss
from roadstate.tires import NormalizedDugoff, TireModel
from roadstate.vehicles import ThreeDofForces
from roadstate.vehicles.kinematics import to_body, wheel_steer

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_ERROR_TIME = 0.3  # s: how long what is not white noise lasts
_BIAS_TIME = 1.0  # s: the same of the accelerometers' bias, whose share in a drive's forces changes
_TIRE_SHARE = 0.1  # 1σ of a tire model's force, as a share of it
_LEAST_FRICTION = 0.02
_TINY = 1e-6
_MOST_DOUBT = 30.0
_LEAST_STEP = 1e-3  # s


class TwoStageState(NamedTuple):
    """The contact's, a smoothed yaw rate, both stages', the friction used, what the tire may get lastingly
    wrong (share of each group's friction), and how far to trust it all.
    """

    contact: ContactState
    yaw_rate: Held
    forces: ForceState
    friction: Any
    used: Held
    tire: Float[Array, " g"]
    validity: Int[Array, ""]


class TwoStage(Estimator[TwoStageState]):
    """Tire forces and peak friction in two stages (paper 000).

    A tire model says what forces F⁰ slips, slip angles and loads make at μ = 1; H∞ filters smooth them; an
    adaptive UKF finds the friction for which μ F⁰ explains a_x, a_y and ṙ, and learns how noisy these are.

    It needs speed, lateral velocity (measured, or observed), steering, wheel speeds, accelerations and yaw
    rate. It assumes a flat road, a known car, and a tire model that is right up to a tenth of its force; with
    the default tire, the normalised Dugoff, also that a tire's stiffness grows with friction: a real tire's
    does not, so that μ comes out too high on slippery roads until the tires near their limit.
    With any other tire only that part of a force counts which answers to friction.
    It cannot know the friction of an axle on which nothing acts, such as the front one of a truck with rear
    drive before it steers: then the interval stays wide, and all that is said of this axle comes from the
    other one, as far as the prior lets both have friction in common. Three accelerations do not determine
    four frictions: with the grouping ``four`` intervals stay wide too.

    Attributes:
        model: of the second stage.
        filter: of the second stage.
        forces: the first stage.
        body: planar motion under given forces.
        meter: how the contact is read.
        groups: quantities of friction with their wheels.
        sensor_noise: (m,) white noise: accelerometers' density, others' 1σ.
        bias: (3,) 1σ of the error that a_x, a_y, ṙ are measured with for long.
        tire_share: 1σ of a tire model's force, as a share of it.
        known_friction: see :class:`Settings`.
        file_friction: the friction at which the vehicle file's stiffnesses hold.
    """

    name: ClassVar[str] = "two-stage"
    summary: ClassVar[str] = "tire forces (H-infinity), then peak friction (adaptive UKF)"
    needs: ClassVar[tuple[Need, ...]] = NEEDS
    optional: ClassVar[tuple[str, ...]] = (*OPTIONAL, "yaw_accel")

    channels: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    model: FrictionOfForces
    filter: Filter[Any]
    forces: ForceFilter
    body: ThreeDofForces
    meter: ContactMeter
    groups: tuple[tuple[str, tuple[int, ...]], ...] = eqx.field(static=True)
    takes_direct: bool = eqx.field(static=True)
    sensor_noise: Float[Array, " m"]
    bias: Float[Array, " 3"]
    tire_share: Float[Array, ""]
    known_friction: Float[Array, ""] | None
    file_friction: Float[Array, ""]

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
            as_printed: the paper's own settings (for those it does not print, its page in the documentation
                says what was taken), as far as ``settings`` does not change them.
            tire: any tire model; default the paper's normalised Dugoff with the file's stiffnesses.
            filter_options: for the second stage's :class:`~roadstate.filters.adaptive.AdaptiveNoise`.
            settings: fields of :class:`Settings`.

        Raises:
            InputError: a grouping or a setting that there is not.
        """
        known_only(settings, Settings._fields)
        chosen = (PRINTED if as_printed else Settings())._replace(**settings)
        meter = ContactMeter(vehicle, available, direct=chosen.direct, steer_std=chosen.steer_std[0])
        family = grouped("friction", chosen.grouping, "grouping")
        has_yaw_accel = "yaw_accel" in available
        sensors = ("accel_x", "accel_y", "yaw_accel" if has_yaw_accel else "yaw_rate")
        file = vehicle.sensors
        last = file.yaw_accel.noise if has_yaw_accel else file.yaw_rate.noise
        noise = np.array([file.accel.noise_density, file.accel.noise_density, last])
        model = FrictionOfForces(
            states=(*family.rows, *(() if has_yaw_accel else ("yaw_rate",))),
            sensors=sensors,
            of_wheel=family.of_wheel,
            mean=leaf(chosen.mean),
            std=jnp.asarray([chosen.shared_std, chosen.own_std]),
            walk=jnp.asarray([chosen.shared_walk, chosen.own_walk]),
            step_std=jnp.asarray([0.0, chosen.step_std]),
        )
        body = ThreeDofForces.from_vehicle(vehicle)
        if as_printed:  # one track, no air
            body = body.with_parameters({"track_front": 0.0, "track_rear": 0.0, "drag_area": 0.0})
        known = chosen.known_friction
        told = ("yaw_accel",) if has_yaw_accel else ()
        return cls(
            channels=tuple(dict.fromkeys((*meter.channels, *told))),
            sensors=sensors,
            model=model,
            filter=second_stage(chosen, as_printed, dict(filter_options or {})),
            forces=first_stage(vehicle, chosen, as_printed, meter.direct, tire),
            body=body,
            meter=meter,
            groups=reported(family.of_wheel),
            takes_direct=chosen.sensor_std is None,
            sensor_noise=jnp.asarray(noise if chosen.sensor_std is None else np.full(3, chosen.sensor_std)),
            bias=jnp.asarray(np.array([file.accel.bias, file.accel.bias, 0.0])),
            tire_share=leaf(_TIRE_SHARE),
            known_friction=None if known is None else leaf(known),
            file_friction=leaf(vehicle.tires.friction),
        )

    def init(self) -> TwoStageState:
        """The prior; no sample has come."""
        return TwoStageState(
            self.meter.init(),
            Held.empty(),
            self.forces.init(),
            self.filter.init(self.model),
            Held.empty(),
            jnp.zeros(len(self.groups)),
            jnp.asarray(int(Validity.SENSOR_MISSING)),
        )

    def step(self, state: TwoStageState, sample: Sample, dt: Float[Array, ""]) -> tuple[TwoStageState, Info]:
        """Find the contact, the forces, then the friction."""
        sample = believable(sample)
        meter, contact = self.meter.read(state.contact, sample, dt)
        contact = once(contact)
        before = self._wheel_friction(state)
        effects = once(self._effects(contact.steer))
        moving, yaw_rate = self._moving(state, sample, contact, effects, before, dt)
        ahead, forces, direct, ok = self.forces.step(
            state.forces, contact, moving if self.takes_direct else None, before, dt
        )
        speed = contact.velocity[0]
        moves = (jnp.abs(speed) > SLOWEST) & (contact.age < STALE)
        rows = [
            jnp.where(jnp.isfinite(sample["accel_x"]), contact.accel[0], jnp.nan),
            jnp.where(jnp.isfinite(sample["accel_y"]), contact.accel[1], jnp.nan),
            sample[self.sensors[2]],
        ]
        known = ahead if self.takes_direct else forces
        since = span(state.contact.held["accel_y"].age, dt, STALE)
        u, moved = once(self._input(contact, effects, known, direct, before, since, dt))
        z = jnp.stack(rows) - moved
        z = jnp.where(moves & jnp.isfinite(z), z, jnp.nan)
        friction, info = self.filter.step(self.model, state.friction, u, z, dt)
        measured = jnp.isfinite(sample["accel_x"]) & jnp.isfinite(sample["accel_y"])
        force = jnp.sqrt(jnp.sum(contact.accel**2) + 1e-12) / GRAVITY
        used = state.used.take(jnp.where(measured, force, jnp.nan), dt)
        tire = self._learned(state, friction, u, self.forces.forces(known), contact, dt)
        after = self.filter.posterior(friction)
        mean, spread = mean_friction(after, self.model.of_wheel, ALL_WHEELS)
        spread = rss(spread, tire[0] * mean)
        stands = jnp.abs(speed) < SLOWEST
        validity = validity_of(mean, spread, stands=stands, age=contact.age, ok=info.ok & ok)
        new = TwoStageState(meter, yaw_rate, forces, friction, used, tire, validity)
        return unspoilt(new, self.init(), after, forces, used.value, tire), info

    def estimate(self, state: TwoStageState) -> Estimate:
        """Forces of wheels and axles, peak friction of the car and its groups with bounds, friction used."""
        gaussian = self.filter.posterior(state.friction)
        values: dict[str, Array] = {"friction_used": state.used.value}
        std: dict[str, Array] = {"friction_used": used_std(state.used)}
        for i, (name, wheels) in enumerate(self.groups):
            mean, spread = mean_friction(gaussian, self.model.of_wheel, wheels)
            spread = rss(spread, self.tire_share * mean, state.tire[i] * mean)
            values[name], low, high = within_reason(mean, spread)
            std[name], values[f"{name}_lower"], values[f"{name}_upper"] = spread, low, high
        force, error = self.forces.everywhere(state.forces)
        friction = self.model.friction(gaussian.mean)
        doubt = self.model.friction(gaussian.std)
        if self.known_friction is not None:
            friction, doubt = jnp.zeros_like(friction) + self.known_friction, jnp.zeros_like(doubt)
        mu, sigma = (jnp.concatenate([a, a, a[0::2], a[0::2]]) for a in (friction, doubt))
        spread = jnp.sqrt((mu * error) ** 2 + (sigma * force) ** 2 + (self.tire_share * mu * force) ** 2)
        for i, (axis, place) in enumerate(
            (a, p) for places in (WHEELS, ("front", "rear")) for a in "xy" for p in places
        ):
            values[f"force_{axis}_{place}"], std[f"force_{axis}_{place}"] = mu[i] * force[i], spread[i]
        return Estimate(values, std, state.validity)

    def _moving(
        self,
        state: TwoStageState,
        sample: Sample,
        contact: Contact,
        effects: Float[Array, "3 8"],
        friction: Float[Array, " 4"],
        dt: Float[Array, ""],
    ) -> tuple[Moving, Held]:
        """v̇_x, v̇_y and ṙ (as the forces would have it where it is not measured), and a smoothed yaw rate.

        v̇_y = a_y − v_x r: with the yaw rate as measured its noise, times the speed, would count most.
        """
        v, noise, step = contact.velocity, self.sensor_noise, jnp.maximum(dt, _LEAST_STEP)
        forces = jnp.concatenate([friction, friction]) * self.forces.forces(state.forces)
        yaw_accel = jnp.sum(effects[2] * forces)
        accel = noise[1] / jnp.sqrt(step)
        yaw_std = YAW_NOISE / jnp.sqrt(step)
        if self.sensors[2] == "yaw_accel":
            told = sample["yaw_accel"]
            seen = jnp.isfinite(told)
            yaw_accel, yaw_std = jnp.where(seen, told, yaw_accel), jnp.where(seen, noise[2], yaw_std)
        # of a Kalman filter: with white noise on r and on ṙ its time constant is the quotient of both
        noisy = jnp.maximum(self.forces.white_std[7], _TINY)
        gain = jnp.where(state.yaw_rate.age < STALE, -jnp.expm1(-step * yaw_std / noisy), 1.0)
        ahead = state.yaw_rate.value + yaw_accel * dt
        away = sample["yaw_rate"] - ahead
        here = jnp.isfinite(away)  # a gain times NaN would spoil its derivative
        yaw_rate = state.yaw_rate.take(jnp.where(here, ahead + gain * jnp.where(here, away, 0), jnp.nan), dt)
        spread = root(0.5 * gain * self.forces.white_std[7] ** 2 + (yaw_std * step) ** 2 / (2 * gain))
        rate = [contact.accel[0] + v[1] * v[2], contact.accel[1] - v[0] * yaw_rate.value, yaw_accel]
        std = jnp.stack([accel, rss(accel, v[0] * spread), yaw_std])
        return Moving(jnp.stack(rate), std), yaw_rate

    def _effects(self, steer: Float[Array, ""]) -> Float[Array, "3 8"]:
        """What 1 N of each wheel's F_x, then of each wheel's F_y, does to a_x, a_y and ṙ."""
        body, place, one = self.body, self.body.wheel_positions, jnp.ones(4)
        angle = wheel_steer(steer)
        along, across = to_body(one, 0 * one, angle), to_body(0 * one, one, angle)
        x, y = jnp.concatenate([along.x, across.x]), jnp.concatenate([along.y, across.y])
        moment = jnp.tile(place.x, 2) * y - jnp.tile(place.y, 2) * x
        return jnp.stack([x / body.mass, y / body.mass, moment / body.yaw_inertia])

    def _wheel_friction(self, state: TwoStageState) -> Float[Array, " 4"]:
        return jnp.maximum(self.model.friction(self.filter.posterior(state.friction).mean), _LEAST_FRICTION)

    def _learned(
        self,
        state: TwoStageState,
        friction: Any,
        u: ForcesInput,
        normalized: Float[Array, " 8"],
        contact: Contact,
        dt: Float[Array, ""],
    ) -> Float[Array, " g"]:
        """Mean of the model's ``tire_error`` over the samples that made the estimate, by what each added."""
        if not self.takes_direct:
            return state.tire
        vehicle, of_wheel = self.forces.vehicle, self.model.of_wheel
        load = vehicle.wheel_loads(contact.accel[0], contact.accel[1])
        used = rss(normalized[:4], normalized[4:]) / jnp.maximum(load, 1.0)
        before, after = self.filter.posterior(state.friction), self.filter.posterior(friction)
        walk = self.model.sqrt_Q(u, dt)
        found = []
        for doubt, (_, wheels) in zip(state.tire, self.groups, strict=True):
            weights = mean_weights(of_wheel, wheels, before.mean)
            counts = jnp.asarray([float(i in wheels) for i in range(4)])
            now = jnp.maximum(weights @ before.mean, _LEAST_FRICTION)
            ratio = now / self.file_friction
            proportional = isinstance(vehicle.tire, NormalizedDugoff)
            error = self.model.tire_error(ratio, used, counts * load, is_proportional=proportional, mean=now)
            found.append(doubt + share_learned(before, after, walk, weights) * (error - doubt))
        return jnp.stack(found)

    def _input(
        self,
        contact: Contact,
        effects: Float[Array, "3 8"],
        known: ForceState,
        direct: Direct,
        friction: Float[Array, " 4"],
        since: Float[Array, ""],
        dt: Float[Array, ""],
    ) -> tuple[ForcesInput, Float[Array, " m"]]:
        """What the forces do to the car per μ, and how wrong that may be.

        Noise in the forces is an error in variables: taken for a force, it looks like a tire that does
        nothing for its slip, which draws the friction to zero. So the innovation is made with the forces that
        the tire model gives now, F⁰_now, and the gain with those that the first stage has predicted, F⁰: in
        z − Σ μ̂ (F⁰_now − F⁰) = Σ μ F⁰ + noise the gain knows nothing of the noise. (F⁰ is an instrumental
        variable: Söderström & Stoica, *System Identification*, ch. 8.) All noise is white then, F⁰_now's
        included. Errors that last are left: an acceleration counts only as far as it exceeds what they, and
        the error of F⁰, make of nothing: its variance grows with (3σ/value)⁴.

        Returns:
            The input, and Σ μ̂ (F⁰_now − F⁰) for each sensor.
        """

        def caused(F: Float[Array, " 8"]) -> Float[Array, "3 4"]:
            return effects[:, :4] * F[:4] + effects[:, 4:] * F[4:]

        body = self.body
        normalized = self.forces.forces(known)
        per_friction = caused(known.share * normalized)
        rest = jnp.sum(caused((1 - known.share) * normalized) * friction, axis=1)
        rest = rest.at[0].add(-body.drag(contact.velocity[0]) / body.mass)
        shares = jnp.concatenate([per_friction, rest[:, None]], axis=1)
        distance = contact.velocity[0] * dt
        nothing = jnp.zeros(3, normalized.dtype)
        if not self.takes_direct:
            excited = jnp.ones(3, bool)
            exact = jnp.zeros((), normalized.dtype)
            return ForcesInput(shares, distance, self.sensor_noise, nothing, excited, exact, exact), nothing
        twice = jnp.concatenate([friction, friction])

        def spread(columns: Float[Array, "8 k"]) -> Float[Array, " 3"]:
            return jnp.sum(product(effects * twice, columns) ** 2, axis=1)

        value = jnp.sum(per_friction * friction, axis=1)
        lasting = spread(direct.lasting)
        error = lasting + spread(from_channels(jnp.diag(self.forces.channel_std(known))))
        doubt = 1 + jnp.minimum(9 * error / (value**2 + _TINY), _MOST_DOUBT) ** 2
        is_rate = np.array([s == "yaw_rate" for s in self.sensors])
        density = jnp.asarray([True, True, False])
        sensors = self.sensor_noise / jnp.where(density, jnp.sqrt(since), 1.0)
        # a yaw rate is integrated from the forces, so that their errors are not the sensor's
        own = jnp.where(is_rate, 0.0, sensors)
        white = jnp.sqrt(own**2 + spread(direct.white))
        errors = 2 * (lasting * _ERROR_TIME + self.bias**2 * _BIAS_TIME) / since
        errors = doubt * errors + (doubt - 1) * white**2
        moved = jnp.sum(effects * (twice * (direct.force - normalized)), axis=1)
        sensor_std, lasting_std = jnp.where(is_rate, sensors, white), jnp.where(is_rate, 0.0, root(errors))
        yaw_std = root(white[2] ** 2 + errors[2])
        u = ForcesInput(shares, distance, sensor_std, lasting_std, doubt < 2, moved[2], yaw_std)
        return u, jnp.where(is_rate, 0.0, moved)
