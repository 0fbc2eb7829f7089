"""Forces between body and wheels along the travel: springs, dampers, stops and anti-roll bars."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from roadstate.tires.base import as_leaf
from roadstate.tires.smooth import Numbers


class Suspension(eqx.Module):
    """Per wheel, at the wheel; travel is positive in bump and zero as the car stands.

    Attributes:
        preload: (4,) force of the spring as the car stands, N.
        stiffness: (4,) N/m.
        damping_bump, damping_rebound: (4,) N·s/m.
        bump_travel, rebound_travel: (4,) where the stops begin, m, both positive.
        stop_stiffness: (4,) N/m on top of the spring's.
        bar_stiffness: (4,) of the axle's anti-roll bar: force per difference of the travels, N/m; less than
            zero where the springs of a rigid axle stand closer together than its wheels.
    """

    preload: Numbers = eqx.field(converter=as_leaf)
    stiffness: Numbers = eqx.field(converter=as_leaf)
    damping_bump: Numbers = eqx.field(converter=as_leaf)
    damping_rebound: Numbers = eqx.field(converter=as_leaf)
    bump_travel: Numbers = eqx.field(converter=as_leaf)
    rebound_travel: Numbers = eqx.field(converter=as_leaf)
    stop_stiffness: Numbers = eqx.field(converter=as_leaf)
    bar_stiffness: Numbers = eqx.field(converter=as_leaf)

    def elastic(self, travel: Numbers) -> Numbers:
        """(4,) force on the wheel, N, positive in bump: minus the derivative of :meth:`energy`."""
        stops = jnp.maximum(travel - self.bump_travel, 0) + jnp.minimum(travel + self.rebound_travel, 0)
        bar = self.bar_stiffness * (travel - _other_side(travel))
        return -(self.preload + self.stiffness * travel + self.stop_stiffness * stops + bar)

    def damping(self, travel_rate: Numbers) -> Numbers:
        """(4,) force on the wheel, N."""
        return -jnp.where(travel_rate > 0, self.damping_bump, self.damping_rebound) * travel_rate

    def energy(self, travel: Numbers) -> Numbers:
        """Stored, zero as the car stands, J."""
        over = jnp.maximum(travel - self.bump_travel, 0)
        under = jnp.minimum(travel + self.rebound_travel, 0)
        springs = self.preload * travel + 0.5 * self.stiffness * travel**2
        stops = 0.5 * self.stop_stiffness * (over**2 + under**2)
        bars = 0.25 * self.bar_stiffness * (travel - _other_side(travel)) ** 2
        return jnp.sum(springs + stops + bars)


def _other_side(wheels: Numbers) -> Numbers:
    return wheels[jnp.asarray([1, 0, 3, 2])]
