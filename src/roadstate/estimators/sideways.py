"""What goes on across the road, given the friction: the states that hide it, and how they move."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core.constants import GRAVITY
from roadstate.core.kernel import once
from roadstate.estimators.base import leaf
from roadstate.estimators.mixture import learn
from roadstate.estimators.road import GradePrior

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

STATES = (
    *("velocity_y", "bank", "bank_rate", "accel_y_bias"),
    *("stiffness_front", "stiffness_rear", "shape", "give_front"),
    *("steer_bias", "lever", "yaw_rate_bias"),
)
SIZE = len(STATES)
V_Y, BANK, BANK_RATE, BIAS_Y, STIFF_F, STIFF_R, SHAPE, GIVE_F, STEER_BIAS, LEVER, BIAS_R = range(SIZE)
MOVES = np.isin(np.arange(SIZE), [V_Y, BANK, BANK_RATE])
"""Which of them are of the car's motion and the road's, not of the car."""
BANK_LENGTH = 80.0
"""m over which a road keeps its bank."""
_LASTING = 3600.0  # s
SLOWEST = 3.0
"""Speed in m/s below which slip angles say nothing."""
FORCE_ERROR = (0.008, 0.03)
"""1σ of a force over load measured, and share of it."""
FORCE_ERROR_TIME = 0.05
"""s for which such an error lasts."""
SLIP_ERROR = 0.0015
"""1σ of a slip that does not change, of teeth and what the low pass leaves of noise."""
_AT_REST = 0.05  # m/s: 1σ of v_y then
# without an acceleration or yaw rate: s for which v_y is remembered, and 1σ of the rear slip angle, rad
_LOST = (0.5, 0.03)
_LASTS = np.isin(np.arange(SIZE), [BIAS_Y, STIFF_F, STIFF_R, SHAPE, GIVE_F, STEER_BIAS, BIAS_R])
_ALIKE = 0.7  # correlation of what front and rear tires are stiffer than the file says: they are of one make
# share of steering and suspension in what the front axle is softer than the rear, and 1σ: from the steering
# wheel on; from a wheel's own angle on, which may yet be a steering wheel's by the ratio
_GIVE = ((0.75, 0.25), (0.25, 0.35))
_REAR_GIVE = 0.03  # share that the suspension has in the rear axle's softness
# what the pneumatic trail has in what steering gives: it shrinks with the friction that is used (Pacejka,
# Tire and Vehicle Dynamics, ch. 3.2), the caster's trail does not
_TRAIL = 0.5
# share by which a tire's peak falls as its load doubles: mean of three property files, .07 to .17 (Pacejka,
# ch. 4.3: p_D2 over p_D1)
_BY_LOAD = 0.1
_LEAST_GIVE = 0.03  # 1σ of what the front suspension gives, over the axle's softness, at the least
_LEAST_OFFSET = 0.005  # m/s², however good the accelerometer
_ACCEL = 0.01  # m/s²/√Hz: white error of what moves the car sideways, however good the accelerometer
_BOTH_LAST = np.outer(_LASTS, _LASTS)
_IS_V_Y = np.arange(SIZE) == V_Y
_LEAST_STEP = 1e-3  # s


class Touch(NamedTuple):
    """How the tires touch the road at one instant, as measured.

    Attributes:
        speed: m/s, along x.
        accel_y: specific force across, m/s².
        yaw_rate: rad/s.
        yaw_accel: rad/s², low-passed.
        lateral: mean of what v̇_y would be on a level road and without biases, while ``angle`` lags, m/s².
        angle: (2,) rad: slip angles of the axles but for v_y and the steering's bias, low-passed.
        across, along: (2,) and (4,) F_y/F_z of the axles and F_x/F_z of the wheels, low-passed.
        slip: (4,) practical slip of the wheels.
        slip_std: (4,) 1σ of it that comes and goes within tenths of a second.
        slip_noise: (4,) 1σ of white noise in it, beyond what samples at 100 Hz leave.
        slip_shared: 1σ of what speed's error adds to all, and lasts.
        across_std, along_std: 1σ of the forces over load beyond the model's own; infinite where unknown.
        split_std: (4,) the part of the latter that lasts: of how wheels share what they bear together.
        shaken: (2,) 1σ of the forces over load, along and across, by which tires bounce on a rough road, and
            by an accelerometer's noise.
        load: (4,) of the wheels over their mean.
        lag: s by which ``angle`` lags, and so v_y must.
        banking: g times the rate of the road's bank, m/s³, and its white error, m/s³/√Hz, infinite where
            no roll rate tells it.
        spins: whether the car slides as far as one that nobody holds.
    """

    speed: Float[Array, ""]
    accel_y: Float[Array, ""]
    yaw_rate: Float[Array, ""]
    yaw_accel: Float[Array, ""]
    lateral: Float[Array, ""]
    angle: Float[Array, " 2"]
    across: Float[Array, " 2"]
    along: Float[Array, " 4"]
    slip: Float[Array, " 4"]
    slip_std: Float[Array, " 4"]
    slip_noise: Float[Array, " 4"]
    slip_shared: Float[Array, ""]
    across_std: Float[Array, " 2"]
    along_std: Float[Array, " 4"]
    split_std: Float[Array, " 4"]
    shaken: Float[Array, " 2"]
    load: Float[Array, " 4"]
    lag: Float[Array, ""]
    banking: Float[Array, " 2"]
    spins: Bool[Array, ""]

    @property
    def bears(self) -> Float[Array, " 4"]:
        """Share of its axle's load that each wheel bears."""
        return self.load / jnp.repeat(self.load[0::2] + self.load[1::2], 2)


class Sideways(eqx.Module):
    """Motion of :data:`STATES`: v̇_y = a_y − bank − bias − lever ṙ − v_x (r − its bias); the rest forgets.

    Attributes:
        first: (n, n) covariance before anything is known.
        give: (2,) angle that steering and suspension of each axle give per F_y/F_z while little friction is
            used, as far as the file tells.
        stiffness: (2,) C_α/F_z of the tires that goes with it.
        arm: (2,) of front and rear axle, ahead of the centre of gravity, m.
        road: how bank changes with distance.
        offset: 1σ of the accelerometer's, m/s².
        white: error of what moves the car sideways, m/s²/√Hz.
        reads_roll: whether a roll rate may tell how the bank changes.
    """

    reads_roll: bool = eqx.field(static=True)
    first: Float[Array, "n n"]
    give: Float[Array, " 2"]
    stiffness: Float[Array, " 2"]
    arm: Float[Array, " 2"]
    road: GradePrior
    offset: Float[Array, ""]
    white: Float[Array, ""]

    def __init__(self, vehicle: Vehicle, available: Collection[str]) -> None:
        self.reads_roll = "roll_rate" in available
        prior, sensors = vehicle.prior, vehicle.sensors
        bank = GRAVITY * prior.bank_std
        rate = bank * 3**0.5 / BANK_LENGTH
        bias, steer = sensors.accel.bias, sensors.steer.bias
        stiff, shape = prior.stiffness_relative, prior.tire_shape_std
        soft = 1 / np.array([vehicle.tires.cornering_stiffness_front, vehicle.tires.cornering_stiffness_rear])
        softer = max(soft[0] - soft[1], 0.0)
        # no more than the file says it may err in the axle's softness as a whole
        share, unsure = _GIVE["steer" in available]
        give = min(max(unsure * softer, _LEAST_GIVE * soft[0]), stiff * soft[0])
        gyro = sensors.yaw_rate.bias
        std = np.array(
            [1.0, bank, rate, bias, stiff, stiff, shape, give, steer, sensors.accel.ahead_std, gyro]
        )
        alike = np.eye(SIZE)
        alike[STIFF_F, STIFF_R] = alike[STIFF_R, STIFF_F] = _ALIKE
        self.first = jnp.asarray(alike * np.outer(std, std))
        self.give = jnp.asarray(np.array([share * softer, _REAR_GIVE * soft[1]]))
        self.stiffness = 1 / (jnp.asarray(soft) - self.give)
        self.road = GradePrior(leaf(bank), leaf(BANK_LENGTH))
        self.offset = leaf(max(bias, _LEAST_OFFSET))
        self.white = jnp.maximum(leaf(sensors.accel.noise_density), _ACCEL)
        geometry = vehicle.geometry
        self.arm = jnp.asarray([geometry.cg_to_front_axle, -geometry.cg_to_rear_axle])

    def gives(self, x: Float[Array, "n J"], touch: Touch, friction: Float[Array, " J"], axle: int) -> Array:
        """(J,) angle that steering and suspension of an axle give per F_y/F_z under each hypothesis."""
        if axle == 1:
            return jnp.broadcast_to(self.give[1], friction.shape)
        return (self.give[0] + x[GIVE_F]) * twisting(touch, friction)

    def cornering(self, x: Float[Array, "n J"], touch: Touch, axle: int) -> Float[Array, " J"]:
        """C_α/F_z of an axle's tires, of which less is left as load moves to the outer wheel."""
        left, right = touch.bears[2 * axle], touch.bears[2 * axle + 1]
        return (1 - 0.4 * (left - right) ** 2) * self.stiffness[axle] * jnp.exp(x[STIFF_F + axle])

    def slip_angle(
        self, x: Float[Array, "n J"], touch: Touch, friction: Float[Array, " J"], axle: int
    ) -> Float[Array, " J"]:
        """Slip angle of an axle under each hypothesis, as its tangent."""
        speed = jnp.maximum(jnp.abs(touch.speed), SLOWEST)
        lateral = touch.lateral - x[BANK] - x[BIAS_Y] - x[LEVER] * touch.yaw_accel + touch.speed * x[BIAS_R]
        angle = touch.angle[axle] - self.gives(x, touch, friction, axle) * touch.across[axle]
        angle = angle - (x[V_Y] - self.arm[axle] * x[BIAS_R] - touch.lag * lateral) / speed
        return angle - x[STEER_BIAS] * jnp.sign(touch.speed) if axle == 0 else angle

    def moved(
        self, x: Float[Array, "n J"], P: Float[Array, "n n J"], touch: Touch, dt: Float[Array, ""]
    ) -> tuple[Float[Array, "n J"], Float[Array, "n n J"]]:
        """Means and covariances of J hypotheses Δt later, with what the roll rate tells of the bank."""
        bank, keep, remembered, shrink, noise, lever, turn = once(self._figures(touch, dt))

        def leading(a: Array) -> tuple[Array, Array, Array]:
            """The first states mix, the others only forget."""
            across = a[V_Y] - dt * (a[BANK] + a[BIAS_Y]) - lever * a[LEVER] + turn * a[BIAS_R]
            return across, *(row[0] * a[BANK] + row[1] * a[BANK_RATE] for row in bank)

        # each part on its own: fused into one expression they take three times as long
        rows = once(leading(P))
        half = once(jax.lax.dynamic_update_slice(P, jnp.stack(rows), (0, 0, 0)))
        columns = once(leading(jnp.swapaxes(half, 0, 1)))
        whole = once(jax.lax.dynamic_update_slice(half, jnp.stack(columns, axis=1), (0, 0, 0)))
        across, *banking = leading(x)
        # at a walking pace the rear axle follows where it points; so it mostly does while nothing tells
        follows = -self.arm[1] * (touch.yaw_rate - x[BIAS_R])
        driven = across + dt * (touch.accel_y - touch.speed * touch.yaw_rate)
        first = jnp.stack([follows + remembered * (driven - follows), *banking])
        x = jnp.concatenate([first, keep[3:, None] * x[3:]])
        P = whole * shrink[:, :, None] + noise[:, :, None]
        return self._banked(x, P, touch, dt) if self.reads_roll else (x, P)

    def _banked(self, x: Array, P: Array, touch: Touch, dt: Array) -> tuple[Array, Array]:
        """With what the roll rate tells: φ̇ = v_x dφ/ds."""
        rate, white = touch.banking
        known = jnp.isfinite(white)
        tells = jnp.where(known, touch.speed, 0.0)
        row = jnp.stack([jnp.full_like(x[BANK_RATE], tells if i == BANK_RATE else 0.0) for i in range(SIZE)])
        innovation = jnp.where(known, rate, 0.0) - tells * x[BANK_RATE]
        noise = jnp.where(known, white, 1.0) ** 2
        x, P, _ = learn(x, P, row, innovation, noise, 1 / jnp.maximum(dt, _LEAST_STEP))
        return x, P

    def _figures(self, touch: Touch, dt: Array) -> tuple[Array, ...]:
        """The bank's transition, what is kept of states, v_y and covariance, noise, and what moves v_y."""
        distance = touch.speed * dt
        is_slow = jnp.abs(touch.speed) < SLOWEST
        # only what moves the car across tells of a rear axle's force
        is_lost = jnp.isinf(touch.across_std[1])
        fades = jnp.where(is_lost, jnp.exp(-dt / _LOST[0]), 1.0)
        remembered = jnp.where(is_slow, 0.0, fades)
        keep = jnp.where(_LASTS, jnp.exp(-dt / _LASTING), 1.0)
        held = jnp.where(_IS_V_Y, remembered, keep)
        strays = (1 - fades**2) * (_LOST[1] * touch.speed) ** 2
        white = jnp.where(is_slow, _AT_REST**2, self.white**2 * dt + strays)
        noise = (1 - keep[:, None] * keep) * jnp.where(_BOTH_LAST, self.first, 0.0)
        noise = noise + jnp.where(np.diag(_IS_V_Y), white, 0.0)
        root_Q = self.road.sqrt_Q(distance)
        noise = noise + jnp.pad(root_Q @ root_Q.T, (BANK, SIZE - BANK - 2))
        shrink = held[:, None] * held
        turn = dt * touch.speed
        return self.road.transition(distance), keep, remembered, shrink, noise, dt * touch.yaw_accel, turn


def twisting(touch: Touch, friction: Float[Array, " J"]) -> Float[Array, " J"]:
    """How much of what steering gives is left as the front tires use more of each friction."""
    return 1 - _TRAIL * jnp.minimum(jnp.abs(touch.across[0]) / friction, 1.0)


def peaks(touch: Touch) -> Float[Array, " 4"]:
    """(4,) of each tire, its peak over the friction of the road: an outer wheel of a bend has less of it, and
    its axle too, since that wheel bears more than the other; so has a front axle that brakes."""
    return 1 - _BY_LOAD * (touch.load - 1)
