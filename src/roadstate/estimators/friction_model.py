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
from roadstate.linalg import root, tria
from roadstate.statespace import StateSpaceModel
from roadstate.tires.smooth import Numbers
from roadstate.vehicles.kinematics import wheel_slips, wheel_steer, wheel_velocities
from roadstate.vehicles.three_dof_contact import ThreeDofContact


class FrictionInput(NamedTuple):
    """What the model is told at one instant.

    Attributes:
        contact: how the tires meet the road.
        distance: travelled since the last sample, m.
        sqrt_R: (m, m) a factor of the covariance of all that the sensors and the model get wrong.
        yaw_noise: rad/s/√s, 1σ of what the model's ṙ gets wrong, as white noise.
    """

    contact: Contact
    distance: Float[Array, ""]
    sqrt_R: Float[Array, "m m"]
    yaw_noise: Float[Array, ""]


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

    def response(self, x: Float[Array, " n"], contact: Contact) -> Float[Array, " 3"]:
        """a_x, a_y (specific forces) and ṙ."""
        slip, angle, load = self.forces_of(contact)
        steer = jnp.stack([contact.steer, jnp.zeros_like(contact.steer)])
        vehicle = self.vehicle.with_parameters({"friction": self.friction(x)})
        motion = vehicle.motion(contact.velocity, jnp.concatenate([steer, slip, angle, load]))
        return jnp.stack([motion.accel_x, motion.accel_y, motion.yaw_accel])

    def f(self, x: Float[Array, " n"], u: FrictionInput, dt: Float[Array, ""]) -> Float[Array, " n"]:
        """Friction stays; the yaw rate follows the forces."""
        if "yaw_rate" not in self.states:
            return x
        return x.at[-1].add(self.response(x, u.contact)[2] * dt)

    def h(self, x: Float[Array, " n"], u: FrictionInput) -> Float[Array, " m"]:
        """What the sensors would read."""
        return self._read(x, u.contact)

    def sqrt_Q(self, u: FrictionInput, dt: Float[Array, ""]) -> Float[Array, "n q"]:
        """Shared and own random walks; nothing in a step of no time."""
        moves = jnp.where(dt > 0, 1.0, 0.0)
        size = jnp.hypot(self.walk * root(jnp.abs(u.distance)), self.step_std * moves)
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
    ) -> tuple[Float[Array, " 3"], Float[Array, "3 7"]]:
        """:meth:`response`, and how it would change by 1σ of each thing the contact is made of.

        Args:
            x: the state.
            contact: whose ``std`` is the 1σ meant.
        """

        def read(error: Float[Array, " 7"]) -> Float[Array, " 3"]:
            off = error * contact.std
            moved = contact._replace(
                velocity=contact.velocity.at[:2].add(off[:2]),
                steer=contact.steer + off[2],
                wheel_speed=contact.wheel_speed + off[3:],
            )
            return self.response(x, moved)

        value, push = jax.linearize(read, jnp.zeros_like(contact.std))
        return value, jax.vmap(push, out_axes=1)(jnp.eye(7, dtype=value.dtype))

    def _read(self, x: Float[Array, " n"], contact: Contact) -> Float[Array, " m"]:
        accel = self.response(x, contact)
        by_name = {"accel_x": accel[0], "accel_y": accel[1], "yaw_accel": accel[2], "yaw_rate": x[-1]}
        return jnp.stack([by_name[sensor] for sensor in self.sensors])
