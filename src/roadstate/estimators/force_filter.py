"""The first of two stages: H∞ filters over the tire forces that a tire model makes of noisy sensors."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core.gaussian import Gaussian
from roadstate.core.kernel import once
from roadstate.estimators.contact import Contact
from roadstate.estimators.velocity import STALE
from roadstate.filters import ExtendedHInfinity
from roadstate.filters.hinfinity import HInfinityState
from roadstate.linalg import product, root, rss
from roadstate.statespace import StateSpaceModel
from roadstate.tires.smooth import soft_abs
from roadstate.vehicles.kinematics import wheel_slips, wheel_steer, wheel_velocities
from roadstate.vehicles.three_dof_contact import ThreeDofContact

SLOWEST = 1.5
"""Speed (m/s) below which slips say nothing."""
_LEAST_SHARE = 1e-3  # of the load: σ of a force that noise-free sensors give
_TINY = 1e-12


class ForceInput(NamedTuple):
    """One channel's noise.

    Attributes:
        sample_std: 1σ of a sample, N.
        motion: intensity of the random walk of the force's rate, N/s/√s.
        step_std: 1σ of what else happens to the force in this step, N.
        push: N/s, how the force is known to change.
    """

    sample_std: Float[Array, ""]
    motion: Float[Array, ""]
    step_std: Float[Array, ""]
    push: Float[Array, ""]


class ForceModel(StateSpaceModel):
    """x = [F⁰] or [F⁰, Ḟ⁰] of one channel; z = F⁰ as the tire model gives it.

    F⁰ alone is a random walk (paper 000: F = H = I). With its rate, Ḟ⁰ is a Gauss–Markov process, so that a
    force that changes steadily is followed without a lag; what is known of the change comes on top.

    Attributes:
        rate_time: s over which a rate keeps its value.
        start_std: 1σ of F⁰ (N) and of Ḟ⁰ (N/s) before the first sample.
    """

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    rate_time: Float[Array, ""]
    start_std: Float[Array, " n"]

    def f(self, x: Float[Array, " n"], u: ForceInput, dt: Float[Array, ""]) -> Float[Array, " n"]:
        """The force moves on at its rate, which fades."""
        if len(self.states) == 1:
            return x + u.push * dt
        left = jnp.exp(-dt / self.rate_time)
        return jnp.stack([x[0] + u.push * dt + self.rate_time * (1 - left) * x[1], left * x[1]])

    def h(self, x: Float[Array, " n"], u: ForceInput) -> Float[Array, " 1"]:
        """The force."""
        return x[:1]

    def sqrt_Q(self, u: ForceInput, dt: Float[Array, ""]) -> Float[Array, "n q"]:
        """Of the step, and of white noise on the rate (as for a rate that does not fade)."""
        own = jnp.where(dt > 0, u.step_std, 0.0)
        if len(self.states) == 1:
            return own[None, None]
        rate, none = u.motion * root(dt), jnp.zeros_like(dt)
        first = jnp.stack([own, rate * dt / np.sqrt(3), none])
        return jnp.stack([first, jnp.stack([none, rate * np.sqrt(0.75), 0.5 * rate])])

    def sqrt_R(self, u: ForceInput) -> Float[Array, "1 1"]:
        """As told."""
        return u.sample_std[None, None]

    def prior(self) -> Gaussian:
        """No force."""
        return Gaussian(jnp.zeros_like(self.start_std), jnp.diag(self.start_std))


class Direct(NamedTuple):
    """What the tire model makes of the sensors.

    Attributes:
        force: (8,) F⁰, N: F_x of four wheels, F_y of four wheels.
        share: (8,) dF/dμ over F⁰: 1 for a force in proportion to friction, 0 for one that ignores it.
        motion: (8, 3) N: what 1 m/s of v_x and of v_y and 1 rad/s of r do to F⁰ of wheels that roll along.
        white, lasting: (8, 8) what 1σ of each thing the contact is made of (and last of the yaw rate) does to
            F⁰, N: the part of it that is independent from sample to sample, and the rest.
    """

    force: Float[Array, " 8"]
    share: Float[Array, " 8"]
    motion: Float[Array, "8 3"]
    white: Float[Array, "8 8"]
    lasting: Float[Array, "8 8"]


class Moving(NamedTuple):
    """How the car's motion changes, as inertial sensors say.

    Attributes:
        rate: (3,) v̇_x and v̇_y (m/s²), ṙ (rad/s²).
        std: (3,) 1σ of them.
    """

    rate: Float[Array, " 3"]
    std: Float[Array, " 3"]


class ForceState(NamedTuple):
    """State of a :class:`ForceFilter`.

    Attributes:
        filters: the H∞ filters', eight in a row.
        push: (8,) N/s, how the forces were known to change.
        share: (8,) as of :class:`Direct`.
        lasting: (12,) 1σ in F⁰ (N) of that part of the error that does not average out: of the wheels' F_x
            and F_y, then of the axles' (F_x front and rear, F_y front and rear).
        lagged: (4,) the wheels' F_y, as late as tires build them up, N.
    """

    filters: HInfinityState
    push: Float[Array, " 8"]
    share: Float[Array, " 8"]
    lasting: Float[Array, " 12"]
    lagged: Float[Array, " 4"]


class ForceFilter(eqx.Module):
    """Normalised tire forces F⁰ = F(κ, α, F_z, μ̂)/μ̂ by H∞ filters (paper 000 §2.2, 2.3).

    It runs on sum and difference, over √2, of left and right of each axle's F_x and F_y. That is a rotation
    of the paper's eight states, under which equal noises stay what they are; and unlike left and right, whose
    errors come from one and the same v_x, v_y and steering, sum and difference are hardly correlated. So the
    eight filters need nothing of each other.

    Attributes:
        filters: of every channel: θ (8,) in 1/N², weight (8, n).
        channel: model of a channel.
        vehicle: planar motion with the tire.
        wheel_radius: (4,) m.
        load: (4,) standing loads, N.
        white_std: (8,) of the contact's std and of the yaw rate's, the part that is independent from sample
            to sample.
        yaw_bias: the rest of the yaw rate's, rad/s.
        motion: (8,) intensity of the random walk of a channel's rate, in loads, 1/s/√s.
        step_std: (8,) 1σ of a channel's random walk over one step, whatever its length, N (the paper's √Q).
        sample_std: (8,) 1σ of a channel's sample, N (the paper's √R); ``None`` has it from the sensors.
        relaxation: (4,) length after which a wheel's lateral force has come to 1 − 1/e of what its slip angle
            asks for, m: Ḟ = (v/σ)(F(α) − F) (Pacejka, *Tire and Vehicle Dynamics*, §7.2); 0 for no lag.
        smooths: false hands on what the tire model says.
    """

    filters: ExtendedHInfinity
    channel: ForceModel
    vehicle: ThreeDofContact
    wheel_radius: Float[Array, " 4"]
    load: Float[Array, " 4"]
    white_std: Float[Array, " 8"]
    yaw_bias: Float[Array, ""]
    motion: Float[Array, " 8"]
    step_std: Float[Array, " 8"]
    sample_std: Float[Array, " 8"] | None
    relaxation: Float[Array, " 4"]
    smooths: bool = eqx.field(static=True, default=True)

    def init(self) -> ForceState:
        """No force."""
        start = jax.vmap(lambda each: each.init(self.channel))(self.filters)
        lasting = jnp.concatenate([self.load, self.load, jnp.tile(axle_sums(self.load), 2)])
        return ForceState(start, jnp.zeros(8), jnp.ones(8), lasting, jnp.zeros(4))

    def step(
        self,
        state: ForceState,
        contact: Contact,
        moving: Moving | None,
        friction: Float[Array, " 4"],
        dt: Float[Array, ""],
    ) -> tuple[ForceState, ForceState, Direct, Bool[Array, ""]]:
        """Predict over ``dt`` (s), then take what the tire model says, where it says something.

        Args:
            state: from :meth:`init` or the last call.
            contact: how the tires meet the road.
            moving: moves the forces on with the slip angles; ``None`` leaves that to the samples.
            friction: (4,) μ for which the tire is evaluated.
            dt: s.

        Returns:
            The state ahead, without this sample; the new state; what the tire model says; whether all filters
            are sound.
        """
        direct = self.direct(contact, friction)
        noise = jnp.sqrt(jnp.sum(to_channels(direct.white) ** 2, axis=1))
        size = channel_loads(self.load)
        std = rss(noise, _LEAST_SHARE * size) if self.sample_std is None else self.sample_std
        moves = (jnp.abs(contact.velocity[0]) > SLOWEST) & (contact.age < STALE)
        sample = jnp.where(moves, to_channels(direct.force), jnp.nan)
        push = mean_push = jnp.zeros(8, std.dtype)
        step_std = self.step_std
        if moving is not None:
            slopes = jnp.where(moves, to_channels(direct.motion), 0.0)
            push = product(slopes, moving.rate[:, None])[:, 0]
            mean_push = 0.5 * (state.push + push)
            step_std = rss(step_std, root(product(slopes**2, (moving.std * dt)[:, None] ** 2)[:, 0]))
        told = ForceInput(std, self.motion * size, step_std, mean_push)
        ahead = jax.vmap(lambda each, s, w: each.predict(self.channel, s, w, dt))(
            self.filters, state.filters, told
        )
        if self.smooths:
            filters, seen = jax.vmap(lambda each, s, w, y: each.update(self.channel, s, w, y))(
                self.filters, ahead, told, sample[:, None]
            )
            ok = jnp.all(seen.ok)
        else:
            filters, ok = _replaced(ahead, sample, std), jnp.asarray(True)
        lasting = _lasting(direct.lasting)
        built = -jnp.expm1(-jnp.abs(contact.velocity[0]) * dt / jnp.maximum(self.relaxation, _TINY))

        def late(F_y: Float[Array, " 4"]) -> Float[Array, " 4"]:
            return state.lagged + built * (F_y - state.lagged)

        new = ForceState(
            filters,
            push,
            jnp.where(moves, direct.share, state.share),
            jnp.where(moves, lasting, jnp.maximum(lasting, state.lasting)),
            late(_wheels(filters)[4:]),
        )
        direct = direct._replace(
            force=direct.force.at[4:].set(late(direct.force[4:])),
            white=direct.white.at[4:].multiply(built[:, None]),
        )
        return state._replace(filters=ahead, lagged=late(_wheels(ahead)[4:])), new, direct, ok

    def direct(self, contact: Contact, friction: Float[Array, " 4"]) -> Direct:
        """F⁰ of the tire model, straight from the sensors; arguments as :meth:`step`."""

        std = jnp.append(contact.std, rss(self.white_std[7], self.yaw_bias))

        def forces(shift: Float[Array, " 9"]) -> Float[Array, " 8"]:
            off = shift[:8] * std
            vehicle = self.vehicle
            steer = wheel_steer(contact.steer + off[2])
            v = contact.velocity + jnp.stack([off[0], off[1], off[7]])
            at = wheel_velocities(v[0], v[1], v[2], vehicle.wheel_positions, steer)
            slips = wheel_slips(at, contact.wheel_speed + off[3:7], self.wheel_radius)
            load = vehicle.wheel_loads(contact.accel[0], contact.accel[1])
            force = vehicle.tire.forces(slips.slip, slips.slip_angle, load, friction + shift[8], at.x)
            return jnp.concatenate([force.F_x, force.F_y])

        value, push = once(jax.linearize(forces, jnp.zeros(9, std.dtype)))
        columns = jax.vmap(push, out_axes=1)(jnp.eye(9, dtype=value.dtype))
        twice = jnp.concatenate([friction, friction])
        normalized = value / twice
        share = columns[:, 8] * normalized / (normalized**2 + _TINY)
        errors = columns[:, :8] / twice[:, None]
        white = jnp.minimum(self.white_std / std, 1)
        slopes, place = errors / std, self.vehicle.wheel_positions
        steer = wheel_steer(contact.steer)
        cos, sin = jnp.cos(steer), jnp.sin(steer)
        # the wheels roll along, so that their slips stay
        rolling = jnp.stack([cos, sin, place.x * sin - place.y * cos], axis=1)
        rolling = rolling * (contact.wheel_speed / soft_abs(contact.velocity[0], SLOWEST))[:, None]
        motion = slopes[:, np.array([0, 1, 7])] + product(slopes[:, 3:7], rolling)
        return Direct(normalized, share, motion, errors * white, errors * root(1 - white**2))

    def forces(self, state: ForceState) -> Float[Array, " 8"]:
        """(8,) F⁰ of the wheels, F_x then F_y, N."""
        return _wheels(state.filters).at[4:].set(state.lagged)

    def channel_std(self, state: ForceState) -> Float[Array, " 8"]:
        """(8,) 1σ of the channels as the filters say, N."""
        return jnp.sqrt(jnp.sum(state.filters.kalman.gaussian.factor[:, 0] ** 2, axis=1))

    def everywhere(self, state: ForceState) -> tuple[Float[Array, " 12"], Float[Array, " 12"]]:
        """F⁰ and its 1σ, N: the wheels' F_x and F_y, then the axles' (F_x front, rear, F_y front, rear)."""
        wheels = self.forces(state)
        variance = self.channel_std(state) ** 2
        both = 0.5 * (variance[0::2] + variance[1::2])
        std = jnp.sqrt(jnp.concatenate([jnp.repeat(both, 2), 2 * variance[0::2]]))
        values = jnp.concatenate([wheels, axle_sums(wheels[:4]), axle_sums(wheels[4:])])
        return values, rss(std, state.lasting)


def _wheels(filters: HInfinityState) -> Float[Array, " 8"]:
    return from_channels(filters.kalman.gaussian.mean[:, 0])


def axle_sums(wheels: Float[Array, "... 4"]) -> Float[Array, "... 2"]:
    """Front and rear."""
    return wheels[..., 0::2] + wheels[..., 1::2]


def to_channels(wheels: Float[Array, "8 ..."]) -> Float[Array, "8 ..."]:
    """Sum and difference of left and right over √2, front F_x, rear F_x, front F_y, rear F_y."""
    left, right = wheels[0::2], wheels[1::2]
    turned: Array = jnp.stack([left + right, left - right], axis=1).reshape(wheels.shape) / np.sqrt(2)
    return turned


from_channels = to_channels
"""The way back: the rotation is its own inverse."""


def channel_loads(load: Float[Array, " 4"]) -> Float[Array, " 8"]:
    """(8,) standing load over √2 of the axle that a channel belongs to, N."""
    size: Array = jnp.tile(jnp.repeat(axle_sums(load), 2), 2) / np.sqrt(2)
    return size


def _lasting(errors: Float[Array, "8 k"]) -> Float[Array, " 12"]:
    axles = errors[0::2] + errors[1::2]
    return jnp.sqrt(jnp.sum(jnp.concatenate([errors, axles]) ** 2, axis=1))


def _replaced(state: HInfinityState, sample: Float[Array, " 8"], std: Float[Array, " 8"]) -> HInfinityState:
    """The sample in place of the estimate, where there is one."""
    old = state.kalman.gaussian
    here = jnp.isfinite(sample)
    mean = old.mean.at[:, 0].set(jnp.where(here, sample, old.mean[:, 0]))
    factor = old.factor.at[:, 0, 0].set(jnp.where(here, std, old.factor[:, 0, 0]))
    return state._replace(kalman=state.kalman._replace(gaussian=Gaussian(mean, factor)))
