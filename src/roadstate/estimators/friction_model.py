"""Friction as the state: what accelerations and yaw acceleration four tires of given slips would cause."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.core.kernel import once
from roadstate.estimators.contact import Contact
from roadstate.estimators.friction_states import FrictionStates
from roadstate.linalg import rss
from roadstate.tires import NormalizedDugoff
from roadstate.tires.smooth import Numbers
from roadstate.vehicles.kinematics import to_body, wheel_slips, wheel_steer, wheel_velocities
from roadstate.vehicles.three_dof_contact import ThreeDofContact


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


class FrictionModel(FrictionStates):
    """Friction under four tires of given slips (papers 003 and 004).

    Attributes as :class:`FrictionStates`, and:
        vehicle: planar motion with a tire; its own friction is not used.
        wheel_radius: (4,) m.
    """

    vehicle: ThreeDofContact
    wheel_radius: Float[Array, " 4"]

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

    def feigned(self, ratio: Float[Array, ""], contact: Contact) -> Float[Array, ""]:
        """:meth:`tire_error` at a contact.

        Args:
            ratio: friction over that at which the stiffnesses were found.
            contact: how the tires meet the road.
        """
        slip, angle, load = self.forces_of(contact)
        force = self.vehicle.tire.forces(slip, angle, load, jnp.ones_like(load), contact.velocity[0])
        used = rss(force.F_x, force.F_y) / jnp.maximum(load, 1.0)
        return self.tire_error(ratio, used, load, is_proportional=self.is_proportional)

    def caused(self, x: Float[Array, " n"], u: FrictionInput) -> Float[Array, " 3"]:
        """a_x, a_y (specific forces) and ṙ."""
        friction = self.friction(x)
        if u.shares is None:
            return jnp.sum(self.wheel_shares(friction, u.contact), axis=1)
        return jnp.sum(u.shares[:, :4] * friction, axis=1) + u.shares[:, 4]

    def sqrt_Q(self, u: FrictionInput, dt: Float[Array, ""]) -> Float[Array, "n q"]:
        """Random walks, and a jump where there was one."""
        return self.wander(u.distance, dt, u.yaw_noise, u.jump)

    def sqrt_R(self, u: FrictionInput) -> Float[Array, "m m"]:
        """As told."""
        return u.sqrt_R

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
