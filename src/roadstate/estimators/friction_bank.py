"""Every friction a road can have, at once: a grid of hypotheses, each with its own idea of the sideslip."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from roadstate.core.constants import GRAVITY
from roadstate.estimators.base import leaf
from roadstate.estimators.friction_curve import Grip, grip
from roadstate.estimators.road import GradePrior
from roadstate.linalg import root

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

VIEWS = ("", "_front", "_rear", "_left", "_right")
"""The car and its parts, of whose tires friction is told."""
STATES = (
    *("velocity_y", "bank", "bank_rate", "accel_y_bias"),
    *("stiffness_front", "stiffness_rear", "steer_bias", "shape", "lever", "yaw_rate_bias"),
)
_N = len(STATES)
V_Y, BANK, BANK_RATE, BIAS_Y, STIFF_F, STIFF_R, STEER_BIAS, SHAPE, LEVER, BIAS_R = range(_N)
_ALONG = ("slip_stiffness", "shape")
_LEAST, _LARGEST, _COUNT = 0.06, 1.35, 48
_ELSEWHERE = 0.5  # prior probability of a road that is not dry
_JUMP = 1 / 400.0  # 1/m: how often the road's friction changes altogether
_DRIFT = 0.1**2 / 300.0  # 1/m: variance of ln μ that is added by driving on
_BANK_LENGTH = 80.0  # m over which a road keeps its bank
_LASTING = 3600.0  # s
_SIDESLIP = 0.1  # rad: 1σ of the rear axle's slip angle
_LEVER = 0.3  # m: 1σ of how far the accelerometer sits ahead of the centre of gravity
_SLOWEST = 3.0  # m/s below which slip angles say nothing
_ACCEL = 0.03  # m/s²/√Hz: white error of what moves the car sideways
_ERROR = (0.008, 0.015)  # 1σ of a force over load measured, and share of it
_ANGLE_ERROR = 0.002  # rad: 1σ of a slip angle, besides what v_y and the steering's bias do to it
_ERROR_TIME = 0.15  # s: how long these errors last
_SLIP_SHARE = 0.5  # 1σ of a slip that is known by the force only, as a share of it
_SLIP_ASIDE = 0.4  # 1σ of a slip, as a share of the slip angle: where a wheel heads is known that well
_SLIP_TIME = 1.0  # s: how long that lasts
_LIVELY = (0.1, 0.5)  # change of a force over load from which on slopes tell of friction, within s
_ROBUST = 16.0  # squared deviations, over σ², from which on a sample counts less
_ONSET = 8.0  # squared deviations, over σ², that no lasting error explains
_LEAST_STEP = 1e-3
_FLOOR = -60.0  # of a log probability
# which evidence counts for which view: F_y front, rear, F_x of four wheels
_WEIGHTS = np.array(
    [
        [1.0, 1.0, 0.5, 0.5, 0.5, 0.5],
        [1.0, 0.0, 0.5, 0.5, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0, 0.5, 0.5],
        [1.0, 1.0, 1.0, 0.0, 1.0, 0.0],
        [1.0, 1.0, 0.0, 1.0, 0.0, 1.0],
    ]
)


class Touch(NamedTuple):
    """How the tires touch the road at one instant, as measured.

    Attributes:
        speed: m/s, along x.
        accel_y: specific force across, m/s².
        yaw_rate: rad/s.
        yaw_accel: rad/s², low-passed.
        lateral: what v̇_y would be on a level road and without biases, low-passed, m/s².
        angle: (2,) rad: slip angles of the axles but for v_y and the steering's bias, low-passed.
        across, along: (2,) and (4,) F_y/F_z of the axles and F_x/F_z of the wheels, low-passed.
        slip: (4,) practical slip of the wheels.
        slip_std: (4,) its 1σ, what speed and radius make of it.
        across_std, along_std: 1σ of the forces over load beyond the model's own; infinite where unknown.
        transfer: (2,) squared share of its load that a wheel of the axle gains or loses to the other.
        lag: s by which ``angle`` lags, and so v_y must.
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
    across_std: Float[Array, " 2"]
    along_std: Float[Array, " 4"]
    transfer: Float[Array, " 2"]
    lag: Float[Array, ""]


class BankState(NamedTuple):
    """Hypotheses of J frictions.

    Attributes:
        log_weight: (5, J) of each of :data:`VIEWS`.
        x: (n, J) what each friction makes of :data:`STATES`; stiffnesses as logarithms of their factors,
            shape as difference from the file's, lever in m.
        P: (n, n, J) its covariance.
        y: (2, J) the logarithm of the slip stiffness' factor, and the longitudinal shape's difference.
        Y: (2, 2, J) its covariance.
        level: (2,) F_y/F_z of the axles, slowed.
    """

    log_weight: Float[Array, "5 J"]
    x: Float[Array, "n J"]
    P: Float[Array, "n n J"]
    y: Float[Array, "2 J"]
    Y: Float[Array, "2 2 J"]
    level: Float[Array, " 2"]


def _learn(
    x: Array, P: Array, row: Array, innovation: Array, noise: Array, takes: Array, lively: Array | float = 0.0
) -> tuple[Array, Array, Array]:
    """A scalar measurement for all hypotheses: new mean and covariance, and log-likelihood.

    Args:
        x: (n, J).
        P: (n, n, J).
        row: (n, J) the sensor's derivative.
        innovation: (J,).
        noise: (J,) variance of an independent sample.
        takes: how many samples make an independent one; what deviates far counts less.
        lively: 0 to 1, how much of the likelihood's normalising factor counts.
    """
    gain = jnp.sum(P * row[None], axis=1)
    own = jnp.sum(gain * row, axis=0)
    far = innovation**2 / (own + noise)
    total = own + noise * takes * (1 + far / _ROBUST)
    x = x + gain * (innovation / total)
    P = P - gain[:, None] * (gain / total)[None]
    # Student's t of one independent sample in so many, of more where an error is too large to last.
    # Its normalising factor counts while forces change. Without it a hypothesis that is unsure of its force
    # is never refuted, and friction comes out too high; while nothing changes, every hypothesis predicts
    # well, noises are but roughly known, and the surest, a tire that slides, would win by the factor alone.
    likelihood = -2.5 * jnp.log1p(far / 4.0) * jnp.minimum((1 + far / _ONSET) / takes, 1.0)
    likelihood = likelihood - lively * 0.5 * jnp.log(own + noise) / takes
    return x, P, likelihood


class FrictionBank(eqx.Module):
    """A grid over ln μ, and for each of its points an extended Kalman filter of all that friction hides in.

    What a car does below the limit depends on the tires' stiffness, not on friction; near the limit on
    friction, and on the shape of the curve that leads there. So the posterior of μ is no Gaussian: a car that
    brakes gently tells that μ exceeds what it uses, and no more. Here each of J frictions is taken for true
    in turn; given it, sideslip, bank, accelerometer and steering bias, stiffnesses and shape are nearly
    Gaussian, and the evidence for it is how well forces were predicted (a Rao–Blackwellised point-mass
    filter; Bucy & Senne 1971; Doucet et al. 2000). Between samples the road may drift or change altogether,
    with a rate per distance, so that without evidence the posterior returns to the prior as the car drives
    on, and a sudden change is a hypothesis that is always there.

    The parts of the car share hypotheses but not evidence: each view weighs what its own tires tell.

    Attributes:
        friction: (J,) the hypotheses.
        prior: (J,) log probability of each.
    """

    friction: Float[Array, " J"]
    prior: Float[Array, " J"]
    _stiffness: Float[Array, " 2"]
    _slip_stiffness: Float[Array, ""]
    _shape: Float[Array, ""]
    _road: GradePrior
    _std: Float[Array, " n"]
    _along_std: Float[Array, " 2"]
    _arm: Float[Array, " 2"]

    def __init__(self, vehicle: Vehicle) -> None:
        tires, prior, sensors = vehicle.tires, vehicle.prior, vehicle.sensors
        grid = np.geomspace(_LEAST, _LARGEST, _COUNT)
        spread = float(np.hypot(prior.friction_relative, 1e-3))
        dry = np.exp(-0.5 * (np.log(grid / tires.friction) / spread) ** 2)
        # wet, snow and ice: less than dry, any order of it
        other = 1 / (1 + (grid / tires.friction) ** 8)
        self.prior = jnp.log(
            jnp.asarray((1 - _ELSEWHERE) * dry / dry.sum() + _ELSEWHERE * other / other.sum())
        )
        self.friction = jnp.asarray(grid)
        self._stiffness = jnp.asarray([tires.cornering_stiffness_front, tires.cornering_stiffness_rear])
        self._slip_stiffness = leaf(tires.slip_stiffness)
        self._shape = leaf(tires.shape)
        bank = GRAVITY * prior.bank_std
        bias, steer = sensors.accel.bias, sensors.steer.bias
        stiff, shape = prior.stiffness_relative, prior.tire_shape_std
        self._road = GradePrior(leaf(bank), leaf(_BANK_LENGTH))
        rate = bank * 3**0.5 / _BANK_LENGTH
        self._std = jnp.asarray(
            np.array([1.0, bank, rate, bias, stiff, stiff, steer, shape, _LEVER, sensors.yaw_rate.bias])
        )
        self._along_std = jnp.asarray(np.array([stiff, shape]))
        geometry = vehicle.geometry
        self._arm = jnp.asarray([geometry.cg_to_front_axle, -geometry.cg_to_rear_axle])

    def init(self) -> BankState:
        """The prior."""
        ones = jnp.ones(_COUNT)
        return BankState(
            jnp.broadcast_to(self.prior, (len(VIEWS), _COUNT)),
            jnp.zeros((_N, _COUNT)),
            jnp.diag(self._std**2)[:, :, None] * ones,
            jnp.zeros((2, _COUNT)),
            jnp.diag(self._along_std**2)[:, :, None] * ones,
            jnp.zeros(2),
        )

    def step(
        self, state: BankState, touch: Touch, dt: Float[Array, ""]
    ) -> tuple[BankState, Float[Array, ""]]:
        """Advance by ``dt`` and weigh what the tires tell; also the log-likelihood of it."""
        mixed = self._mixed(state, jnp.abs(touch.speed) * dt)
        x, P = self._moved(mixed.x, mixed.P, touch, dt)
        evidence = jnp.zeros((6, _COUNT), x.dtype)
        lively = jnp.minimum(((touch.across - state.level) / _LIVELY[0]) ** 2, 1.0)
        level = state.level - jnp.expm1(-dt / _LIVELY[1]) * (touch.across - state.level)
        step = jnp.maximum(dt, _LEAST_STEP)
        speed = jnp.maximum(jnp.abs(touch.speed), _SLOWEST)
        kappa = touch.slip.reshape(2, 2).mean(axis=1)
        sigma_x = kappa / jnp.maximum(1 + kappa, 0.1)
        takes = jnp.maximum(2 * _ERROR_TIME / step, 1.0)
        # beyond its peak a tire tells nothing of the sideslip: a car that is driven does not slide far
        rear = (x[V_Y] + self._arm[1] * touch.yaw_rate) / speed
        row = jnp.zeros_like(x).at[V_Y].set(1 / speed)
        x, P, _ = _learn(x, P, row, -rear, jnp.full_like(rear, _SIDESLIP**2), takes)
        for axle in range(2):
            here = self._axle(x, touch, speed, sigma_x[axle], mixed.y[0], axle)
            row = jnp.zeros_like(x)
            angle = self._factor(touch, axle) * self._stiffness[axle] * jnp.exp(x[STIFF_F + axle])
            by_angle = here.across_by_angle * angle
            lagged = -by_angle / speed
            row = row.at[V_Y].set(lagged).at[BANK].set(lagged * touch.lag).at[BIAS_Y].set(lagged * touch.lag)
            row = row.at[LEVER].set((lagged * touch.lag + 1 / GRAVITY) * touch.yaw_accel)
            row = row.at[STIFF_F + axle].set(here.across_by_slip).at[SHAPE].set(here.across_by_shape)
            turned = lagged * (-self._arm[axle] - touch.lag * touch.speed)
            row = row.at[BIAS_R].set(turned)
            if axle == 0:
                row = row.at[STEER_BIAS].set(-by_angle * jnp.sign(touch.speed))
            # the accelerometer's bias and place are in the force as well
            row = row.at[BIAS_Y].add(1 / GRAVITY)
            measured = touch.across[axle]
            noise = touch.across_std[axle] ** 2 + _ERROR[0] ** 2 + (_ERROR[1] * measured) ** 2
            noise = noise + (by_angle * _ANGLE_ERROR) ** 2
            known = jnp.isfinite(noise) & (jnp.abs(touch.speed) > _SLOWEST)
            noise = jnp.where(known, noise, 1e12)
            misread = (x[BIAS_Y] + x[LEVER] * touch.yaw_accel) / GRAVITY
            innovation = jnp.where(known, measured - here.across - misread, 0.0)
            x, P, likelihood = _learn(x, P, row, innovation, noise, takes, lively[axle])
            evidence = evidence.at[axle].set(jnp.where(known, likelihood, 0.0))
        y, Y = mixed.y, mixed.Y
        takes = jnp.maximum(2 * _SLIP_TIME / step, 1.0)
        for wheel in range(4):
            axle = wheel // 2
            kappa = touch.slip[wheel]
            ratio = kappa / jnp.maximum(1 + kappa, 0.1)
            stiff = self._slip_stiffness * jnp.exp(y[0])
            angle = self._angle(x, touch, speed, axle)
            across = self._factor(touch, axle) * self._stiffness[axle] * jnp.exp(x[STIFF_F + axle]) * angle
            here = grip(stiff * ratio, across, self.friction, self._shape + y[1])
            row = jnp.stack([here.along_by_slip, here.along_by_shape])
            measured = touch.along[wheel]
            by_force = _SLIP_SHARE * measured / self._slip_stiffness
            slips = jnp.sqrt(touch.slip_std[wheel] ** 2 + by_force**2 + (_SLIP_ASIDE * angle) ** 2)
            floor = touch.along_std[wheel] ** 2 + _ERROR[0] ** 2 + (_ERROR[1] * measured) ** 2
            noise = floor + (stiff * here.along_by_ratio * slips) ** 2
            known = jnp.isfinite(floor) & (jnp.abs(touch.speed) > 0.5 * _SLOWEST)
            noise = jnp.where(known, noise, 1e12)
            innovation = jnp.where(known, measured - here.along, 0.0)
            y, Y, likelihood = _learn(y, Y, row, innovation, noise, takes)
            evidence = evidence.at[2 + wheel].set(jnp.where(known, likelihood, 0.0))
        raised = mixed.log_weight + jnp.asarray(_WEIGHTS, x.dtype) @ evidence
        most = jnp.max(raised, axis=1, keepdims=True)
        total = most + jnp.log(jnp.sum(jnp.exp(raised - most), axis=1, keepdims=True))
        weight = jnp.maximum(raised - total, _FLOOR)
        return BankState(weight, x, P, y, Y, level), total[0, 0]

    def _factor(self, touch: Touch, axle: int) -> Array:
        """How much of an axle's cornering stiffness is left as load moves to its outer wheel."""
        return 1 - 0.4 * touch.transfer[axle]

    def _angle(self, x: Array, touch: Touch, speed: Array, axle: int) -> Array:
        """Slip angle of an axle under each hypothesis, as its tangent."""
        lateral = touch.lateral - x[BANK] - x[BIAS_Y] - x[LEVER] * touch.yaw_accel + touch.speed * x[BIAS_R]
        angle = touch.angle[axle] - (x[V_Y] - self._arm[axle] * x[BIAS_R] - touch.lag * lateral) / speed
        return angle - x[STEER_BIAS] * jnp.sign(touch.speed) if axle == 0 else angle

    def _axle(self, x: Array, touch: Touch, speed: Array, ratio: Array, stiff: Array, axle: int) -> Grip:
        angle = self._angle(x, touch, speed, axle)
        across = self._factor(touch, axle) * self._stiffness[axle] * jnp.exp(x[STIFF_F + axle]) * angle
        along = self._slip_stiffness * jnp.exp(stiff) * ratio
        return grip(along, across, self.friction, self._shape + x[SHAPE])

    def _moved(self, x: Array, P: Array, touch: Touch, dt: Array) -> tuple[Array, Array]:
        """Δt later: v̇_y = a_y − bank − bias − lever ṙ − v_x (r − its bias); the rest forgets."""
        distance = jnp.abs(touch.speed) * dt
        lasting = np.array([BIAS_Y, STIFF_F, STIFF_R, STEER_BIAS, BIAS_R])
        keep = jnp.ones(_N, x.dtype).at[lasting].set(jnp.exp(-dt / _LASTING))
        grown = (1 - keep**2) * self._std**2
        grown = grown.at[V_Y].set(_ACCEL**2 * dt)
        road = slice(BANK, BANK_RATE + 1)
        noise = self._road.sqrt_Q(distance)
        F = jnp.diag(keep).at[road, road].set(self._road.transition(distance))
        F = F.at[V_Y, BANK].set(-dt).at[V_Y, BIAS_Y].set(-dt)
        F = F.at[V_Y, LEVER].set(-dt * touch.yaw_accel).at[V_Y, BIAS_R].set(dt * touch.speed)
        Q = jnp.diag(grown).at[road, road].set(noise @ noise.T)
        known = touch.accel_y - touch.speed * touch.yaw_rate
        moved = (F @ x).at[V_Y].add(dt * known)
        half = jnp.tensordot(F, P, 1)
        P = jnp.einsum("ikj,lk->ilj", half, F) + Q[:, :, None]
        # at a walking pace the rear axle follows where it points
        slow = jnp.abs(touch.speed) < _SLOWEST
        follows = -self._arm[1] * touch.yaw_rate
        held = jnp.where(slow, jnp.where(jnp.arange(_N) == V_Y, 0.0, 1.0), 1.0)
        P = P * (held[:, None] * held[None])[:, :, None]
        P = P + jnp.diag(jnp.where(slow, 0.05**2, 0.0) * (1 - held))[:, :, None]
        return moved.at[V_Y].set(jnp.where(slow, follows, moved[V_Y])), P

    def _mixed(self, state: BankState, distance: Array) -> BankState:
        """The road's friction drifts or changes over a distance; a hypothesis that is born anew inherits."""
        p = jnp.exp(state.log_weight)
        spacing = np.log(_LARGEST / _LEAST) / (_COUNT - 1)
        share = jnp.minimum(0.5 * _DRIFT * distance / spacing**2, 0.25)
        edge = jnp.concatenate([p[:, :1], p, p[:, -1:]], axis=1)
        p = p + share * (edge[:, 2:] - 2 * p + edge[:, :-2])
        born = -jnp.expm1(-_JUMP * distance)
        fresh = born * jnp.exp(self.prior)
        whole = (1 - born) * p + fresh
        new = fresh / jnp.maximum(whole[0], 1e-30)
        x, P = _inherit(state.x, state.P, p[0], new)
        y, Y = _inherit(state.y, state.Y, p[0], new)
        return BankState(jnp.log(jnp.maximum(whole, 1e-30)), x, P, y, Y, state.level)

    def merged(self, state: BankState) -> tuple[Array, Array]:
        """Mean (n,) and 1σ (n,) of :data:`STATES` over all hypotheses."""
        return _moments(state.x, state.P, jnp.exp(state.log_weight[0]))

    def quantiles(self, state: BankState, levels: tuple[float, ...]) -> Float[Array, "q 5"]:
        """Quantiles of μ in each of :data:`VIEWS`, linear in ln μ between the grid's points."""
        p = jnp.exp(state.log_weight)
        p = p / jnp.sum(p, axis=1, keepdims=True)
        total = jnp.cumsum(p, axis=1)
        grid = jnp.log(self.friction)
        spacing = grid[1] - grid[0]
        rows = []
        for level in levels:
            place = jnp.minimum(jnp.sum(total < level, axis=1), _COUNT - 1)
            here = jnp.take_along_axis(p, place[:, None], axis=1)[:, 0]
            before = jnp.take_along_axis(total, place[:, None], axis=1)[:, 0] - here
            inside = jnp.clip((level - before) / jnp.maximum(here, 1e-30), 0.0, 1.0)
            rows.append(self._whole(jnp.exp(grid[place] + spacing * (inside - 0.5))))
        return jnp.stack(rows)

    def _whole(self, views: Float[Array, " 5"]) -> Float[Array, " 5"]:
        """With the car's as the mean of its sides', which on a split road its own view cannot hold."""
        return jnp.concatenate([0.5 * (views[3] + views[4])[None], views[1:]])

    def std(self, state: BankState) -> Float[Array, " 5"]:
        """1σ of μ in each of :data:`VIEWS`, the grid's own width included."""
        p = jnp.exp(state.log_weight)
        p = p / jnp.sum(p, axis=1, keepdims=True)
        mean = jnp.sum(p * self.friction, axis=1, keepdims=True)
        width = self.friction * float(np.log(_LARGEST / _LEAST) / (_COUNT - 1)) / 12**0.5
        return self._whole(root(jnp.sum(p * ((self.friction - mean) ** 2 + width**2), axis=1)))


def _moments(x: Array, P: Array, p: Array) -> tuple[Array, Array]:
    p = p / jnp.sum(p)
    mean = jnp.sum(p * x, axis=1)
    variance = jnp.sum(p * (jnp.stack([P[i, i] for i in range(len(x))]) + (x - mean[:, None]) ** 2), axis=1)
    return mean, root(variance)


def _inherit(x: Array, P: Array, p: Array, new: Array) -> tuple[Array, Array]:
    """Hypotheses of which a share ``new`` (J,) is born anew out of all of them; moments are kept."""
    p = p / jnp.sum(p)
    mean = jnp.sum(p * x, axis=1, keepdims=True)
    apart = x - mean
    whole = jnp.sum(p * (P + apart[:, None] * apart[None]), axis=2, keepdims=True)
    shift = (1 - new) * new * (apart[:, None] * apart[None])
    return x - new * apart, (1 - new) * P + new * whole + shift
