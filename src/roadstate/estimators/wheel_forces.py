"""What each wheel has of its axle's forces, and what it bears."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.core.constants import GRAVITY
from roadstate.estimators.axle_forces import LEAST_FORCE, AxleForces, by_axle, parked
from roadstate.estimators.base import leaf
from roadstate.estimators.contact_forces import NOISY
from roadstate.linalg import root, rss

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_PADS = 0.05  # 1σ of a brake's torque that no other wheel has in common with it, as a share of it
# power of the load with which the tires of an axle share a lateral force: at small angles, as their
# stiffnesses do; and what the limit adds to it
_STIFFNESS, _LIMIT = 0.5, 0.4
_POWER_ERROR = 0.2  # 1σ of it once an axle uses all its friction: how close it comes to that is not known
# 1σ of a wheel's force along and across that nothing tells, as a share of its load: camber, toe, steering
_OWN = (0.004, 0.012)
# 1σ of what a wheel of a car at rest bears, over a quarter of the weight: twice what the place of the centre
# of gravity is off by, as a share of the wheelbase
_STANDING = 0.03
_SHIFTED = 0.1  # 1σ of the load that shifts from wheel to wheel, as a share of it
_UNSEEN = 0.3  # 1σ of what a bend that nothing tells of shifts, as a share of a wheel's load at rest
# 1σ of a wheel's forces along and across and of its load over its load at rest, as multiples of what a rough
# road shakes the accelerometers by over g: both ways, across, and in the geometric mean
_SHAKEN = (0.63, 1.5, 15.0)


class WheelForces(NamedTuple):
    """Forces on the wheels in their own frames, and 1σ of each, N.

    Attributes:
        along, along_std: (4,) F_x.
        across, across_std: (4,) F_y.
        load, load_std: (4,) F_z.
    """

    along: Float[Array, " 4"]
    along_std: Float[Array, " 4"]
    across: Float[Array, " 4"]
    across_std: Float[Array, " 4"]
    load: Float[Array, " 4"]
    load_std: Float[Array, " 4"]


class Known(NamedTuple):
    """What is known of the axles.

    Attributes:
        along, along_std: (2,) F_x and 1σ of it, N, but for what stirs up single wheels.
        across, across_std: (2,) F_y and 1σ of it, N.
        friction: (2,) peak friction, the likeliest.
        mass, mass_std: of the car over that of the file, and 1σ of it.
        speed: m/s.
    """

    along: Float[Array, " 2"]
    along_std: Float[Array, " 2"]
    across: Float[Array, " 2"]
    across_std: Float[Array, " 2"]
    friction: Float[Array, " 2"]
    mass: Float[Array, ""]
    mass_std: Float[Array, ""]
    speed: Float[Array, ""]


class WheelSharing(eqx.Module):
    """Shares out an axle's forces to its wheels.

    F_x as torques tell it. F_y by a power of the load: the tires of an axle run at about the same slip angle,
    where they push as their stiffnesses do, which grow with a power of .5 to .7 of the load, and at the limit
    as their frictions do, with one of .9 (load sensitivity: Pacejka, *Tire and Vehicle Dynamics*, 3rd ed.,
    § 4.3). The load is the quasi-static one.
    """

    _gain: Float[Array, ""]
    _zero: Float[Array, ""]

    @classmethod
    def of(cls, vehicle: Vehicle) -> Self:
        """For the torque sensors of a vehicle."""
        told = vehicle.sensors.wheel_torque
        return cls(leaf(told.relative), leaf(told.bias / vehicle.wheels.radius))

    def share(self, forces: AxleForces, known: Known) -> WheelForces:
        """Of forces on a car of the file's mass, and what is known of the axles beyond them."""
        load = jnp.maximum(forces.now.load, 1.0)
        held = parked(load, known.speed, forces.locking)
        calm = _twice(by_axle(load)) / 2
        ahead, aside = forces.shaken
        shakes = jnp.stack([jnp.minimum(ahead, aside), aside, root(ahead * aside)])
        shaken = (jnp.asarray(_SHAKEN, load.dtype) * shakes / GRAVITY)[:, None] * calm
        torques = known.mass * forces.along
        part = _part(jnp.abs(torques) + LEAST_FORCE)
        along = torques + part * _twice(known.along - by_axle(torques))
        gain = jnp.where(along < 0, jnp.maximum(self._gain, _PADS), self._gain)
        split = jnp.where(jnp.isfinite(forces.along_std), forces.along_std, 1.0) * load
        along_std = rss(
            part * _twice(known.along_std),
            0.5**0.5 * rss(gain * along, self._zero),
            split,
            jnp.maximum(forces.jolt - NOISY * load, 0.0),
            _OWN[0] * load,
            shaken[0],
            held,
        )
        side = jnp.abs(known.across)
        use = jnp.clip(side / (known.friction * by_axle(load)), 0.0, 1.0) ** 2
        # of an axle's two wheels the share of one follows from the logarithm of its load over the other's
        apart = jnp.log(load[0::2] / load[1::2])
        left = 0.5 + 0.5 * jnp.tanh(0.5 * (_STIFFNESS + _LIMIT * use) * apart)
        part = jnp.stack([left, 1 - left], axis=1).reshape(4)
        # what the share changes by with the power
        tilt = part * (1 - part) * _twice(jnp.abs(apart))
        across_std = rss(
            part * _twice(known.across_std),
            _POWER_ERROR * tilt * _twice(use * side),
            _OWN[1] * load,
            shaken[1],
            held,
        )
        unseen = _twice(jnp.where(jnp.isfinite(forces.across_std), 0.0, _UNSEEN)) * calm
        load_std = rss(
            known.mass_std * load,
            forces.loads_std * load,
            _STANDING * jnp.mean(load),
            _SHIFTED * (load - calm),
            unseen,
            shaken[2],
        )
        across = part * _twice(known.across)
        return WheelForces(along, along_std, across, across_std, known.mass * forces.now.load, load_std)


def _twice(axles: Float[Array, " 2"]) -> Float[Array, " 4"]:
    """An axle's figure for each of its wheels."""
    return jnp.stack([axles[0], axles[0], axles[1], axles[1]])


def _part(wheels: Float[Array, " 4"]) -> Float[Array, " 4"]:
    """Each wheel's share in its axle."""
    return wheels / _twice(by_axle(wheels))
