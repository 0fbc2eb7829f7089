"""The bodies: a sprung mass with four wheels that slide along their suspensions' paths, by Kane's method."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from roadstate.dense import solve
from roadstate.sim.plant.vectors import cross, dot
from roadstate.tires.base import as_leaf
from roadstate.tires.smooth import Numbers


class Loads(NamedTuple):
    """What acts on the bodies besides gravity, along the body's axes.

    Attributes:
        force: (3, 4) on each wheel assembly at the wheel's centre, N.
        carrier_torque: (3, 4) on each wheel carrier, without what turns the wheel about its axis, N·m.
        travel: (4,) of springs, dampers, stops and bars between body and wheel, N, positive in bump.
        body_force: (3,) on the sprung mass, N.
        body_torque: (3,) of it and of anything else on the sprung mass about the CG, N·m.
    """

    force: Float[Array, "3 4"]
    carrier_torque: Float[Array, "3 4"]
    travel: Float[Array, " 4"]
    body_force: Float[Array, " 3"]
    body_torque: Float[Array, " 3"]


class Accelerations(NamedTuple):
    """Derivatives of the generalised speeds.

    Attributes:
        velocity: (3,) v̇ of the CG along the body's axes (without ω × v), m/s².
        rate: (3,) ω̇, rad/s².
        travel: (4,) of the wheels along their paths, m/s².
    """

    velocity: Float[Array, " 3"]
    rate: Float[Array, " 3"]
    travel: Float[Array, " 4"]


class Chassis(eqx.Module):
    """Five masses in one tree; the origin is the car's centre of gravity as it stands (CG), in the body.

    Generalised speeds are v (3) and ω (3) of the body along its own axes and the rate ż (4) of each wheel
    along its path: mass k moves with v + ω × p_k + d_k ż_k, d = 0 for the sprung mass. With the Jacobian J of
    these velocities and W the masses, Kane's equations read (JᵀWJ + I_s) ν̇ = Q − JᵀW b − (0, ω × I_s ω, 0),
    where b is what of the accelerations does not contain ν̇, gravity subtracted (Kane & Levinson, *Dynamics:
    Theory and Applications*, 1985, ch. 6). Anti-dive, jacking and the roll centre are in d and in the turn ε
    of the wheel carrier per travel, without terms of their own.

    Eliminating the travels by hand makes the solution itself cheaper and the whole slower: the products and
    Cholesky's method run as calls of their own, before which everything is evaluated once, while the compiler
    would fuse elementwise code with its many uses and evaluate it in each.

    Attributes:
        masses: (5,) sprung, then fl, fr, rl, rr, kg.
        places: (3, 5) of their centres as the car stands, seen from the CG, m.
        inertia: (3, 3) of the sprung mass about its own centre, kg·m².
        path: (3, 4) d, motion of each wheel centre per travel; its z is 1.
        carrier_turn: (3, 4) ε, turn of each wheel carrier per travel, rad/m.
        steering_axis: (3, 4) unit vectors, upwards, through the wheel's centre.
        spin_inertia: (4,) of the wheels about their axes, kg·m².
        rigid: whether the front, and the rear, axle is one body from wheel to wheel: d's lateral part and ε's
            lean and toe then follow half the difference of the travels instead of each wheel's own, and both
            wheels of the axle move sideways and turn as one.
    """

    masses: Numbers = eqx.field(converter=as_leaf)
    places: Numbers = eqx.field(converter=as_leaf)
    inertia: Numbers = eqx.field(converter=as_leaf)
    path: Numbers = eqx.field(converter=as_leaf)
    carrier_turn: Numbers = eqx.field(converter=as_leaf)
    steering_axis: Numbers = eqx.field(converter=as_leaf)
    spin_inertia: Numbers = eqx.field(converter=as_leaf)
    rigid: tuple[bool, bool] = eqx.field(static=True, default=(False, False))

    def _each_or_axle(self, values: Numbers) -> Numbers:
        """(4,) of each wheel's own, or half the difference within a rigid axle: a symmetric matrix's work."""
        if self.rigid == (False, False):
            return values
        shares = 0.5 * np.repeat(self.rigid, 2)
        return values - jnp.asarray(shares, values.dtype) * (values + values[np.array([1, 0, 3, 2])])

    def moved(self, travel: Float[Array, " 4"]) -> Float[Array, "3 4"]:
        """Displacement of the wheel centres by travels, m; their velocity by the travels' rates, m/s."""
        if self.rigid == (False, False):
            return self.path * travel
        return self.path * jnp.stack([travel, self._each_or_axle(travel), travel])

    def turned(self, travel: Float[Array, " 4"]) -> Float[Array, "3 4"]:
        """Turn of the carriers by travels, rad; their rate by the travels' rates, rad/s."""
        if self.rigid == (False, False):
            return self.carrier_turn * travel
        axle = self._each_or_axle(travel)
        return self.carrier_turn * jnp.stack([axle, travel, axle])

    @property
    def mass(self) -> Numbers:
        """Of the whole car, kg."""
        return jnp.sum(self.masses)

    def wheel_centres(self, travel: Float[Array, " 4"]) -> Float[Array, "3 4"]:
        """Places of the wheel centres seen from the CG along the body's axes, m."""
        return self.places[:, 1:] + self.moved(travel)

    def velocities(
        self, velocity: Numbers, rate: Numbers, travel_rate: Numbers, centres: Numbers
    ) -> Float[Array, "3 4"]:
        """Of the wheel centres along the body's axes, m/s."""
        return velocity[:, None] + cross(rate, centres) + self.moved(travel_rate)

    def accelerate(
        self,
        velocity: Float[Array, " 3"],
        rate: Float[Array, " 3"],
        travel_rate: Float[Array, " 4"],
        centres: Float[Array, "3 4"],
        gravity: Float[Array, " 3"],
        loads: Loads,
    ) -> Accelerations:
        """Solve the equations of motion.

        Args:
            velocity: of the CG along the body's axes, m/s.
            rate: ω, rad/s.
            travel_rate: ż, m/s.
            centres: from :meth:`wheel_centres`.
            gravity: along the body's axes, m/s².
            loads: what acts.
        """
        places = jnp.concatenate([self.places[:, :1], centres], axis=1)
        J = self._jacobian(places)
        weighted = J * jnp.tile(self.masses, 3)[:, None]
        moving = jnp.concatenate([jnp.zeros((3, 1), rate.dtype), self.moved(2 * travel_rate)], axis=1)
        bias = cross(rate, velocity[:, None] + cross(rate, places) + moving) - gravity[:, None]
        M = (weighted.T @ J).at[3:6, 3:6].add(self.inertia)
        torque = jnp.sum(cross(centres, loads.force) + loads.carrier_torque, axis=1)
        Q = jnp.concatenate(
            [
                jnp.sum(loads.force, axis=1) + loads.body_force,
                torque + loads.body_torque - cross(rate, self.inertia @ rate),
                self._along_paths(loads) + loads.travel,
            ]
        )
        right = Q - weighted.T @ bias.reshape(15)
        solved = solve(M, right[:, None])[:, 0]
        return Accelerations(solved[:3], solved[3:6], solved[6:])

    def _along_paths(self, loads: Loads) -> Numbers:
        """(4,) what forces and torques on the wheels do along the travels, N."""
        forces, torques = self.path * loads.force, self.carrier_turn * loads.carrier_torque
        across = forces[1] + torques[0] + torques[2]
        return forces[0] + forces[2] + torques[1] + self._each_or_axle(across)

    def _jacobian(self, places: Float[Array, "3 5"]) -> Float[Array, "15 10"]:
        """Of the velocities of the five masses, components first."""
        zero = jnp.zeros_like(places[0])
        x, y, z = places
        turning = jnp.stack([jnp.stack([zero, z, -y]), jnp.stack([-z, zero, x]), jnp.stack([y, -x, zero])])
        along = jnp.broadcast_to(jnp.eye(3, dtype=zero.dtype)[:, None, :], (3, 5, 3))
        own = jnp.broadcast_to(jnp.eye(4, dtype=zero.dtype), (3, 4, 4))
        if self.rigid != (False, False):
            own = own.at[1].set(jax.vmap(self._each_or_axle)(own[1]))
        wheels = jnp.pad(self.path[:, :, None] * own, ((0, 0), (1, 0), (0, 0)))
        return jnp.concatenate([along, jnp.moveaxis(turning, 1, 2), wheels], axis=2).reshape(15, 10)

    def kinetic_energy(
        self, velocity: Numbers, rate: Numbers, travel_rate: Numbers, centres: Numbers, spin: Numbers
    ) -> Float[Array, ""]:
        """Of all bodies, the wheels' spin included, J."""
        body = velocity + cross(rate, self.places[:, 0])
        wheels = self.velocities(velocity, rate, travel_rate, centres)
        return 0.5 * (
            self.masses[0] * dot(body, body)
            + jnp.sum(self.masses[1:] * dot(wheels, wheels))
            + rate @ self.inertia @ rate
            + jnp.sum(self.spin_inertia * spin**2)
        )
