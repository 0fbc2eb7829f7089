"""What each wheel's slip and longitudinal force tell of the friction, under every hypothesis of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.estimators import slip_jump
from roadstate.estimators.base import leaf
from roadstate.estimators.friction_curve import Grip, bounded, chord, elastic, theoretical_slip
from roadstate.estimators.mixture import learn, weigh
from roadstate.estimators.sideways import FORCE_ERROR, FORCE_ERROR_TIME, SLOWEST, Touch
from roadstate.linalg import rss

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_SIZE = 4  # states of a wheel
_GAIN = 0.04  # 1σ of what the shares of brakes and load are told wrong by, for good
_MOST = 3.0  # σ of them that a force may be beyond the friction for nothing
_SHARE = 0.05  # 1σ of a wheel's share of the force, as a share of it, where nothing but that tells
_SLIP_OFFSET = 0.003  # 1σ of a slip, of radii that differ
_SLIP_ASIDE = 0.4  # 1σ of a slip, as a share of the slip angle: where a wheel heads is known that well
_SLIP_TIME = (0.2, 4.0)  # s: how long errors of a slip last, its own and those that come from the speed
_SPLIT_TIME = 0.3  # s: how long a share of the forces keeps that nothing tells
_ONSET = 6.0  # squared deviations of a force, over σ², that no lasting error of a slip explains
_STRAIGHT = 0.05  # F_y/F_z up to which a tire goes straight ahead
_SLIP_KNOWN = 0.02  # 1σ of a slip up to which the curve is a line over its width


class Aside(NamedTuple):
    """Of the axles, front and rear, under each of J hypotheses.

    Attributes:
        angle: (2, J) slip angle, as its tangent.
        force: (2, J) F_y/F_z if it stayed linear.
    """

    angle: Float[Array, "2 J"]
    force: Float[Array, "2 J"]


class Wheels(eqx.Module):
    """For each wheel and each friction what that hides in: stiffness, shape, rolling radius and load.

    A wheel learns of its own tire and rolling radius only. Did wheels of one side share what they learn, the
    one that comes onto ice first would teach the one behind it, by the hypotheses that are being refuted, a
    tire that there is not.

    Attributes:
        slip_stiffness: C_κ/F_z.
        shape: C.
    """

    slip_stiffness: Float[Array, ""]
    shape: Float[Array, ""]
    _std: Float[Array, " m"]

    def __init__(self, vehicle: Vehicle) -> None:
        tires, prior = vehicle.tires, vehicle.prior
        self.slip_stiffness, self.shape = leaf(tires.slip_stiffness), leaf(tires.shape)
        self._std = jnp.asarray(
            np.array([prior.stiffness_relative, prior.tire_shape_std, _SLIP_OFFSET, _GAIN])
        )

    def init(self, count: int) -> tuple[Float[Array, "4 m J"], Float[Array, "4 m m J"]]:
        """Mean and covariance for J hypotheses of each wheel's states: the logarithm of the slip stiffness'
        factor, the longitudinal shape's difference from the file's, what the wheel seems to slip when it
        rolls, and by what share its force over load is told too high."""
        P = jnp.diag(self._std**2)[:, :, None]
        return jnp.zeros((4, _SIZE, count)), jnp.broadcast_to(P, (4, _SIZE, _SIZE, count))

    def linear(self, y: Float[Array, "4 m J"], touch: Touch) -> Float[Array, "4 J"]:
        """F_x/F_z of each wheel if it stayed linear."""
        ratio = theoretical_slip(touch.slip[:, None] - y[:, 2])
        return self.slip_stiffness * jnp.exp(y[:, 0]) * ratio

    def learn(
        self,
        y: Float[Array, "4 m J"],
        Y: Float[Array, "4 m m J"],
        linear: Float[Array, "4 J"],
        touch: Touch,
        friction: Float[Array, "4 J"],
        aside: Aside,
        jump: slip_jump.Jump,
        anew: Float[Array, " 4"],
        step: Float[Array, ""],
    ) -> tuple[Float[Array, "4 m J"], Float[Array, "4 m m J"], Float[Array, "4 J"], slip_jump.Told]:
        """Mean and covariance after a sample, its log-likelihood, and what the jumps tell.

        Args:
            y, Y: before.
            linear: :meth:`linear` of it.
            touch: of the tires on the road.
            friction: of each wheel's tire under each hypothesis.
            aside: what the tires do sideways.
            jump: of the slips.
            anew: how often per second a wheel's place on its curve changes.
            step: s since the last sample.
        """
        aside = Aside(*(jnp.repeat(part, 2, axis=0) for part in aside))
        here, by_slip, mean, bent = self._curves(y, linear, touch, friction, aside.force)
        gain = 1 + y[:, 3]
        slopes = gain * here.along_by_slip, gain * here.along_by_shape, -gain * by_slip, here.along
        # noise that many samples average out would make a hypothesis likelier whose curve bends, were its
        # slope not the mean one; what a slip errs lastingly is not known so well, nor a slip aside, of which
        # the curve along knows nothing
        by_error = jnp.maximum(by_slip, mean)
        ahead = (linear**2 + _STRAIGHT**2) / (linear**2 + aside.force**2 + _STRAIGHT**2)
        by_noise = by_error + ahead * (mean - by_error)
        row = jnp.stack(slopes, axis=1)
        measured = touch.along[:, None]
        turned = _SLIP_ASIDE * aside.angle
        slips = jnp.sqrt(touch.slip_std[:, None] ** 2 + touch.slip_shared**2 + turned**2)
        floor = touch.along_std[:, None] ** 2 + FORCE_ERROR[0] ** 2 + (FORCE_ERROR[1] * measured) ** 2
        shaken = floor + touch.shaken[0] ** 2
        noise = shaken + (by_error * slips) ** 2 + (by_noise * touch.slip_noise[:, None]) ** 2
        # a curve is no line over the width of a slip that is hardly known, unless the tire surely slides
        sure = jnp.maximum(_SLIP_KNOWN, jnp.abs(touch.slip[:, None]) / 3) > touch.slip_shared
        known: Bool[Array, "4 1"] = jnp.isfinite(floor) & (jnp.abs(touch.speed) > 0.5 * SLOWEST)
        noise = jnp.where(known & sure, noise, 1e12)
        innovation = jnp.where(known & sure, measured - gain * here.along, 0.0)
        shared = (by_error * touch.slip_shared) ** 2
        lent = jnp.where(known, touch.split_std[:, None], 0.0) ** 2
        # what a force is beyond the friction errs no longer than forces do
        of_slip = jnp.full_like(friction, _SLIP_TIME[0])
        own = jnp.where(jnp.abs(measured) > friction, FORCE_ERROR_TIME, of_slip)
        lasts = 2 * (own + ((_SLIP_TIME[1] - own) * shared + _SPLIT_TIME * lent) / noise)
        counts = jnp.maximum((lasts + 1 / anew[:, None]) / step, 1.0)
        y, Y, foreseen = learn(y, Y, row, innovation, noise, counts)
        likelihood = weigh(innovation, foreseen, noise, counts, onset=_ONSET)
        by_force = jnp.where(known, shaken + (_SHARE * measured) ** 2, 1e12)
        keeps = 2 * (FORCE_ERROR_TIME + _SPLIT_TIME * lent / by_force) + 1 / anew[:, None]
        likelihood = jnp.minimum(likelihood, _beyond(measured, friction, by_force, keeps / step))
        jumps = slip_jump.evidence(
            jump, touch, turned, self.slip_stiffness, friction, bent, jnp.sqrt(floor), step
        )
        # a wheel that bears nothing slips on no road, but a bump shakes it
        borne = rss(touch.along, jnp.repeat(touch.across, 2))[:, None]
        idle = (borne < slip_jump.BEARS) & (jnp.abs(touch.slip[:, None]) < slip_jump.SLIDES)
        return y, Y, jnp.where(known & ~idle, likelihood, 0.0), jumps

    def _curves(
        self, y: Array, linear: Array, touch: Touch, friction: Array, across: Array
    ) -> tuple[Grip, Array, Array, Array]:
        """Each tire, ∂(F_x/F_z)/∂ slip, its mean between the slip measured and what the force tells, and what
        the force over load were if it stayed linear up to the slip that goes with it; (4, J)."""
        stiff = self.slip_stiffness * jnp.exp(y[:, 0])
        shape = self.shape + y[:, 1]
        here = bounded(linear, across, friction, shape)
        force = touch.along[:, None]
        bent = elastic(force, friction, shape)
        slope = chord(linear, here.along, here.along_by_ratio, bent, force, friction)
        return here, stiff * here.along_by_ratio, stiff * slope, bent


def _beyond(force: Array, friction: Array, noise: Array, counts: Array) -> Array:
    """Log-likelihood of a force over load that its tire cannot bear, whatever its slip; 0 of another; (4, J).

    Its load may be told too small, but no more than ``_MOST`` σ.
    """
    excess = jnp.maximum(jnp.abs(force) - (1 + _MOST * _GAIN) * friction, 0.0)
    return weigh(excess, jnp.zeros_like(excess), noise, jnp.maximum(counts, 1.0), onset=_ONSET)
