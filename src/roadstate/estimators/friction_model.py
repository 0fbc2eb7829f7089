"""Friction as the state: what accelerations and yaw acceleration four tires of given slips would cause."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from roadstate.core.gaussian import Gaussian
from roadstate.estimators.contact import Contact
from roadstate.linalg import once, root, tria
from roadstate.statespace import StateSpaceModel
from roadstate.tires import NormalizedDugoff
from roadstate.tires.smooth import Numbers, safe_hypot
from roadstate.vehicles.kinematics import to_body, wheel_slips, wheel_steer, wheel_velocities
from roadstate.vehicles.three_dof_contact import ThreeDofContact

_STIFFNESS = 0.1  # 1σ of a tire's stiffness, as a share of it
_FAINTEST = 0.05  # of a force's elasticity in friction; below it nothing is learned anyway
_TINY = 1e-6


class FrictionInput(NamedTuple):
    """What the model is told at one instant.

    Attributes:
        contact: how the tires meet the road.
        distance: travelled since the last sample, m.
        sqrt_R: (m, m) a factor of the covariance of all that the sensors and the model get wrong.
        yaw_noise: rad/s/√s, 1σ of what the model's ṙ gets wrong, as white noise.
        shares: what :meth:`FrictionModel.wheel_shares` makes of the contact at μ = 1, for a tire whose force
            is proportional to friction: it need not be evaluated again. ``None`` for others.
        jump: 1σ of a change of all frictions since the last sample, over and above the random walk.
    """

    contact: Contact
    distance: Float[Array, ""]
    sqrt_R: Float[Array, "m m"]
    yaw_noise: Float[Array, ""]
    shares: Float[Array, "3 5"] | None = None
    jump: Float[Array, ""] | float = 0.0


class FrictionModel(StateSpaceModel):
    """x = [μ of each group (, r)]; z of a_x, a_y, ṙ and r. (Papers 000, 003 and 004.)

    The peak friction of the groups shares a part of its prior and of its random walk along the way, so that
    what one axle feels says something of the other. With ``yaw_rate`` among the states, r is integrated from
    the model's ṙ and measured as it is, instead of ṙ being had by differences.

    Attributes:
        states: names of the rows of x: the groups', and perhaps ``yaw_rate``.
        sensors: of ``accel_x``, ``accel_y``, ``yaw_accel``, ``yaw_rate``.
        of_wheel: for each wheel its group.
        vehicle: planar motion with a tire; its own friction is not used.
        wheel_radius: (4,) m.
        mean: prior mean of μ.
        std: (2,) 1σ of the prior: what all groups share, and each group's own.
        walk: (2,) 1σ of the random walk over 1 m, likewise.
        step_std: (2,) 1σ of the random walk over one step, whatever its length (the papers' Q), likewise.
    """

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    of_wheel: tuple[int, ...] = eqx.field(static=True)
    vehicle: ThreeDofContact
    wheel_radius: Float[Array, " 4"]
    mean: Float[Array, ""]
    std: Float[Array, " 2"]
    walk: Float[Array, " 2"]
    step_std: Float[Array, " 2"]

    @property
    def groups(self) -> int:
        """How many frictions there are."""
        return len(self.states) - self.states.count("yaw_rate")

    def friction(self, x: Float[Array, " n"]) -> Float[Array, " 4"]:
        """μ under each wheel."""
        return x[np.asarray(self.of_wheel)]

    def forces_of(self, contact: Contact) -> tuple[Numbers, Numbers, Numbers]:
        """The arguments of a tire model: κ, α (rad) and F_z (N), (4,) each."""
        v = contact.velocity
        steer = wheel_steer(contact.steer)
        velocity = wheel_velocities(v[0], v[1], v[2], self.vehicle.wheel_positions, steer)
        slips = wheel_slips(velocity, contact.wheel_speed, self.wheel_radius)
        return slips.slip, slips.slip_angle, self.vehicle.wheel_loads(contact.accel[0], contact.accel[1])

    @property
    def is_proportional(self) -> bool:
        """Whether the tire's force is proportional to friction, so that the model is linear."""
        return isinstance(self.vehicle.tire, NormalizedDugoff)

    def wheel_shares(self, friction: Float[Array, " 4"], contact: Contact) -> Float[Array, "3 5"]:
        """What each wheel adds to a_x, a_y (specific forces) and ṙ, and last what is there without tires.

        Args:
            friction: (4,) μ under each wheel.
            contact: how the tires meet the road.
        """
        v, vehicle = contact.velocity, self.vehicle
        steer = wheel_steer(contact.steer)
        slip, angle, load = self.forces_of(contact)
        tire = once(vehicle.tire.forces(slip, angle, load, friction, v[0]))
        force, place = to_body(tire.F_x, tire.F_y, steer), vehicle.wheel_positions
        moment = place.x * force.y - place.y * force.x
        shares = jnp.stack([force.x / vehicle.mass, force.y / vehicle.mass, moment / vehicle.yaw_inertia])
        lost = -vehicle.drag(v[0]) / vehicle.mass
        return jnp.concatenate([shares, jnp.stack([lost, 0 * lost, 0 * lost])[:, None]], axis=1)

    def used_share(self, contact: Contact) -> Float[Array, " 4"]:
        """ρ/μ of each wheel on a tire that is proportional to friction."""
        slip, angle, load = self.forces_of(contact)
        force = self.vehicle.tire.forces(slip, angle, load, jnp.ones_like(load), contact.velocity[0])
        return safe_hypot(force.F_x, force.F_y) / jnp.maximum(load, 1.0)

    def tire_error(self, ratio: Float[Array, ""], contact: Contact) -> Float[Array, ""]:
        """1σ of the friction that a tire of other stiffness would feign, as a share of it.

        Below the limit a real tire's force depends on its stiffness, not on friction, and a tire model in
        which the one is proportional to the other takes a stiffness for a friction. With ψ the elasticity of
        a brush tire's force in friction (0 for a small slip, 1 when sliding), what is wrong with the
        stiffness makes (1 − ψ)/ψ times as much wrong with the friction. Wrong is the stiffness by its
        tolerance, and by staying what it is where friction is another; no more than the prior, though.
        (Pacejka, *Tire and Vehicle Dynamics*, §3.2.)

        Args:
            ratio: friction over that at which the stiffnesses were found.
            contact: how the tires meet the road.
        """
        load = self.forces_of(contact)[2]
        used = jnp.clip(self.used_share(contact), 0.0, 1.0)
        theta = 1 - jnp.cbrt(1 - used + _TINY)
        psi = jnp.clip(1 - 3 * theta * (1 - theta) ** 2 / (used + _TINY), 0.0, 1.0)
        off = jnp.sqrt(_STIFFNESS**2 + ((1 - ratio) ** 2 if self.is_proportional else 0.0))
        error = off * (1 - psi) / (psi + _FAINTEST)
        weight = load * used**2 + _TINY
        most = jnp.sqrt(jnp.sum(self.std**2)) / self.mean
        return jnp.minimum(jnp.sum(weight * error) / jnp.sum(weight), most)

    def response(self, x: Float[Array, " n"], contact: Contact) -> Float[Array, " 3"]:
        """a_x, a_y (specific forces) and ṙ."""
        return jnp.sum(self.wheel_shares(self.friction(x), contact), axis=1)

    def f(self, x: Float[Array, " n"], u: FrictionInput, dt: Float[Array, ""]) -> Float[Array, " n"]:
        """Friction stays; the yaw rate follows the forces."""
        if "yaw_rate" not in self.states:
            return x
        return x.at[-1].add(self._caused(x, u)[2] * dt)

    def h(self, x: Float[Array, " n"], u: FrictionInput) -> Float[Array, " m"]:
        """What the sensors would read."""
        caused = self._caused(x, u)
        by_name = {"accel_x": caused[0], "accel_y": caused[1], "yaw_accel": caused[2], "yaw_rate": x[-1]}
        return jnp.stack([by_name[sensor] for sensor in self.sensors])

    def sqrt_Q(self, u: FrictionInput, dt: Float[Array, ""]) -> Float[Array, "n q"]:
        """Shared and own random walks; nothing in a step of no time."""
        moves = jnp.where(dt > 0, 1.0, 0.0)
        size = safe_hypot(self.walk * root(jnp.abs(u.distance)), self.step_std * moves)
        size = size.at[0].set(safe_hypot(size[0], u.jump * moves))
        return self._spread(size, u.yaw_noise * root(dt))

    def sqrt_R(self, u: FrictionInput) -> Float[Array, "m m"]:
        """As told."""
        return u.sqrt_R

    def prior(self) -> Gaussian:
        """The same mean for all groups; no yaw rate."""
        n = len(self.states)
        mean = jnp.zeros(n).at[: self.groups].set(self.mean)
        return Gaussian(mean, tria(self._spread(self.std, jnp.ones(()))))

    def _spread(self, size: Float[Array, " 2"], yaw: Float[Array, ""]) -> Float[Array, "n q"]:
        k, n = self.groups, len(self.states)
        shared = jnp.zeros(n).at[:k].set(size[0])
        own = jnp.full(n, 1.0).at[:k].set(size[1])
        own = own if n == k else own.at[-1].set(yaw)
        return jnp.concatenate([shared[:, None], jnp.diag(own)], axis=1)

    def sensitivity(
        self, x: Float[Array, " n"], contact: Contact
    ) -> tuple[Float[Array, "3 5"], Float[Array, "3 7"]]:
        """:meth:`wheel_shares`, and how their sum would change by 1σ of each thing the contact is made of.

        Args:
            x: the state.
            contact: whose ``std`` is the 1σ meant.

        Returns:
            The shares at the state's friction, or for a tire that is proportional to it at μ = 1; the changes
            at the state's friction.
        """
        friction = self.friction(x)
        unit = jnp.ones_like(friction)

        weights = jnp.append(friction if self.is_proportional else unit, 1.0)

        def read(error: Float[Array, " 4"]) -> tuple[Float[Array, "3 5"], Float[Array, "3 5"]]:
            off = error[:3] * contact.std[:3]
            moved = contact._replace(
                velocity=contact.velocity.at[:2].add(off[:2]),
                steer=contact.steer + off[2],
                wheel_speed=contact.wheel_speed + error[3] * contact.std[3:],
            )
            shares = self.wheel_shares(unit if self.is_proportional else friction, moved)
            return shares * weights, shares

        # a wheel's speed moves nothing but its own share, so that all four need one direction only
        _, push, shares = once(jax.linearize(read, jnp.zeros(4, contact.std.dtype), has_aux=True))
        changes = once(jax.vmap(push)(jnp.eye(4, dtype=shares.dtype)))
        return shares, jnp.concatenate([jnp.sum(changes[:3], axis=2).T, changes[3, :, :4]], axis=1)

    def _caused(self, x: Float[Array, " n"], u: FrictionInput) -> Float[Array, " 3"]:
        if u.shares is None:
            return self.response(x, u.contact)
        return jnp.sum(u.shares[:, :4] * self.friction(x), axis=1) + u.shares[:, 4]
