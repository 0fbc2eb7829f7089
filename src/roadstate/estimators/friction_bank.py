"""Every friction a road can have, at once: a grid of hypotheses, each with its own idea of the sideslip."""

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
from roadstate.core.numerics import in_default, in_single
from roadstate.estimators import road_changes, slip_jump
from roadstate.estimators.astray import are_possible
from roadstate.estimators.base import SILENT_STEP
from roadstate.estimators.friction_curve import Grip, bounded, chord, elastic, theoretical_slip
from roadstate.estimators.friction_wheels import Aside, Wheels
from roadstate.estimators.mixture import follow, inherit, learn, likeliest, moments, weigh
from roadstate.estimators.sideways import (
    BANK,
    BIAS_R,
    BIAS_Y,
    FORCE_ERROR,
    FORCE_ERROR_TIME,
    GIVE_F,
    LEVER,
    MOVES,
    SHAPE,
    SIZE,
    SLOWEST,
    STEER_BIAS,
    STIFF_F,
    V_Y,
    Sideways,
    Touch,
    peaks,
    twisting,
)
from roadstate.linalg import root, rss

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

VIEWS = ("", "_front", "_rear", "_left", "_right")
"""The car and its parts, of whose tires friction is told."""
_LEAST, _LARGEST, _COUNT = 0.06, 1.35, 32  # a power of two: XLA vectorises it
_ELSEWHERE = 0.5  # prior probability of a road that is not dry
# 1/m: how soon what a side's wheels have found of its road is taken to hold for each of them
_JOINS = 1 / 5.0
# 1σ of an F_y over load by how the body leans, which v_y follows as it does the force: a share of it, up to
_LEANS = (0.05, 0.0115)
_SIDESLIP = (0.1, 0.03)  # rad: 1σ of the rear axle's slip angle where friction is 1, and at the least
_SPUN = 2.0  # rad: of a car that spins
_SLIDES = 1.0  # s in which it becomes another one
_TURN_TIME = 1.5  # s for which errors last that come from how the car turns in
_ANGLE_ERROR = (0.0005, 0.01)  # 1σ of a slip angle, rad, beside v_y's and the steering's bias; and a share
_SWAYS = 0.1  # rad (m/s)²: of a body that sways by v_y/v_x, while tires follow late by a length over v_x
# rad: what v_y and the bank are told instead, as where an axle heads does not average out; and friction too,
# until its force has changed: by then v_y and the steering's bias have taken that on
_TOE = 0.002
_BEND = 0.3  # 1σ of an axle's force, as a share of what it lacks of a linear one
_ANEW = (0.06, 12.0)  # change of a force over load that tells anew; else it does after s
_CRAWL = 1.5 * SLOWEST  # m/s: up to there v_y may be so unsure that tires slide or not
_LEAST_STEP = 1e-3
_FLOOR = 1e-15  # of a probability
# Which evidence counts for which part: F_y front, rear, F_x of four wheels. The parts: the car as if it stood
# on one road, its wheels, its sides.
_WEIGHTS = np.array(
    [
        [1.0, 1.0, 0.5, 0.5, 0.5, 0.5],
        [1.0, 0.0, 1.0, 0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0, 1.0, 0.0],
        [0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        [1.0, 1.0, 1.0, 0.0, 1.0, 0.0],
        [1.0, 1.0, 0.0, 1.0, 0.0, 1.0],
    ]
)
_WHEELS, _SIDES = slice(1, 5), slice(5, 7)
# each of VIEWS is the mean of parts that may stand on different roads
_MEANS = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5],
        [0.0, 0.5, 0.5, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
    ]
)


class BankState(NamedTuple):
    """Hypotheses of J frictions.

    Attributes:
        weight: (2, 3, 7, J) of the kinds of road (:mod:`~roadstate.estimators.road_changes`), the modes of
            :mod:`~roadstate.estimators.slip_jump` and the parts: car, wheels, sides; of each part 1 in sum.
        x: (n, J) what each friction makes of :data:`STATES`; stiffnesses as logarithms of their factors,
            shape as difference from the file's, lever in m.
        P: (n, n, J) its covariance.
        y: (4, m, J) of the wheels, see :meth:`~roadstate.estimators.friction_wheels.Wheels.init`.
        Y: (4, m, m, J) its covariance.
        merged: mean (n,) and 1σ (n,) of all hypotheses together, see :meth:`FrictionBank.merged`.
        level: (14,) F_y/F_z of the axles, F_x/F_z of the wheels, what it were if it stayed linear, and what
            the wheels slip beyond their force, slowed; :data:`~roadstate.estimators.slip_jump.NOTHING` of an
            F_y or slip that was never told, and of all after a break: what is there then has not grown.
    """

    weight: Float[Array, "2 3 7 J"]
    x: Float[Array, "n J"]
    P: Float[Array, "n n J"]
    y: Float[Array, "4 m J"]
    Y: Float[Array, "4 m m J"]
    merged: tuple[Float[Array, " n"], Float[Array, " n"]]
    level: Float[Array, " 14"]


class _Told(NamedTuple):
    """What an axle's F_y/F_z tells under each of J hypotheses.

    Attributes:
        row: its derivative by the states.
        innovation: by what it exceeds its prediction.
        noise: variance of its error.
        apart: what that differs by as a measure of how far the tires slip.
        repeats: share of the noise that is the same wherever the car turns in: of inertia, place and lag.
        known: whether it is measured.
    """

    row: Float[Array, "n J"]
    innovation: Float[Array, " J"]
    noise: Float[Array, " J"]
    apart: Float[Array, " J"]
    repeats: Float[Array, " J"]
    known: Bool[Array, " J"]


class FrictionBank(eqx.Module):
    """A grid over ln μ, and for each of its points an extended Kalman filter of all that friction hides in.

    What a car does below the limit depends on the tires' stiffness, not on friction; near the limit on
    friction, and on the shape of the curve that leads there. So the posterior of μ is no Gaussian: a car that
    brakes gently tells that μ exceeds what it uses, and no more. Here each of J frictions is taken for true
    in turn; given it, sideslip, bank, accelerometer and steering bias, stiffnesses and shape are nearly
    Gaussian, and the evidence for it is how well forces were predicted (a Rao–Blackwellised point-mass
    filter; Bucy & Senne 1971; Doucet et al. 2000). Between samples the road may drift or change altogether,
    with a rate per distance (:mod:`~roadstate.estimators.road_changes`), so that without evidence the
    posterior returns to the prior as the car drives on, and a sudden change is a hypothesis that is always
    there; wheels that slip more from one moment to the next make it likely, or a bump
    (:mod:`~roadstate.estimators.slip_jump`).

    The parts of the car share hypotheses but not evidence: each weighs what its own tires tell. But a rear
    wheel rolls where the front one has been, so as the car drives on a wheel takes over what its side has
    found.

    All of it in single precision, which halves the time of a step: what is weighed errs by far more.

    Attributes:
        friction: (J,) the hypotheses.
        prior: (J,) probability of each.
        motion: of what friction hides in, sideways.
        wheels: and along the road.
    """

    friction: Float[Array, " J"]
    prior: Float[Array, " J"]
    motion: Sideways
    wheels: Wheels

    def __init__(self, vehicle: Vehicle, available: Collection[str]) -> None:
        tires = vehicle.tires
        grid = np.geomspace(_LEAST, _LARGEST, _COUNT)
        spread = float(np.hypot(vehicle.prior.friction_relative, 1e-3))
        dry = np.exp(-0.5 * (np.log(grid / tires.friction) / spread) ** 2)
        # wet, snow and ice: less than dry, any order of it
        other = 1 / (1 + (grid / tires.friction) ** 8)
        prior = (1 - _ELSEWHERE) * dry / dry.sum() + _ELSEWHERE * other / other.sum()
        self.friction, self.prior = in_single((jnp.asarray(grid), jnp.asarray(prior)))
        self.motion, self.wheels = in_single((Sideways(vehicle, available), Wheels(vehicle)))

    def init(self) -> BankState:
        """The prior."""
        ones = jnp.ones(_COUNT)
        weight = jnp.full((road_changes.KINDS, slip_jump.MODES, len(_WEIGHTS), _COUNT), _FLOOR)
        state = BankState(
            weight.at[:, slip_jump.STAYS].set(road_changes.first(self.prior)[:, None]),
            jnp.zeros((SIZE, _COUNT)),
            self.motion.first[:, :, None] * ones,
            *self.wheels.init(_COUNT),
            (jnp.zeros(SIZE), root(jnp.diagonal(self.motion.first))),
            jnp.full(14, slip_jump.NOTHING).at[2:10].set(0.0),
        )
        return in_single(state)

    def step(
        self, state: BankState, touch: Touch, dt: Float[Array, ""]
    ) -> tuple[BankState, Float[Array, ""]]:
        """Advance by ``dt`` and weigh what the tires tell; also the log-likelihood of it."""
        touch, dt = in_single((touch, dt))
        # models err by where on the curve a tire works, so a sample counts anew as that changes
        linear = self.wheels.slip_stiffness * theoretical_slip(touch.slip)
        slips = slip_jump.unexplained(touch, self.wheels.slip_stiffness)
        told = jnp.concatenate([touch.across, touch.along, jnp.clip(linear, -1.0, 1.0), slips])
        tells = jnp.isfinite(jnp.concatenate([touch.across_std, *[touch.along_std] * 3]))
        # what was before a break is no measure of what is after it
        known = jnp.where(tells | (dt < 0.9 * SILENT_STEP), state.level, slip_jump.NOTHING)
        told = once(jnp.where(tells, told, known))
        memory = jnp.where(known < slip_jump.NOTHING, known, told)
        change = told - memory
        level = memory - jnp.expm1(-dt / slip_jump.MEMORY) * change
        gained = slip_jump.jumps(told[10:], memory[10:], touch)
        grown = jnp.abs(told[2:6]) - jnp.abs(memory[2:6])
        jump = slip_jump.Jump(gained, grown, memory[10:])
        change = jnp.abs(change)
        change = jnp.concatenate([change[:2], jnp.maximum(change[2:6], change[6:10])])
        anew = change / (_ANEW[0] * slip_jump.MEMORY) + 1 / _ANEW[1]
        whole = jnp.minimum((change / _ANEW[0]) ** 2, 1.0)
        step = jnp.maximum(dt, _LEAST_STEP)
        mixed = self._mixed(state, jnp.abs(touch.speed) * dt, dt)
        x, P = self.motion.moved(mixed.x, mixed.P, touch, dt)
        soon = jnp.maximum(2 * FORCE_ERROR_TIME / step, 1.0)
        lasts = 2 * FORCE_ERROR_TIME + 1 / anew[:2]
        speed = jnp.maximum(jnp.abs(touch.speed), SLOWEST)
        # beyond its peak a tire tells nothing of the sideslip: a car that is driven does not slide far, and
        # where the road is slippery the peak comes at a smaller angle; one that spins may have any
        likely = jnp.maximum(_SIDESLIP[0] * self.friction, jnp.where(touch.spins, _SPUN, _SIDESLIP[1]))
        rear = (x[V_Y] + self.motion.arm[1] * touch.yaw_rate) / speed
        zero = jnp.zeros_like(rear)
        row = jnp.stack([jnp.full_like(rear, 1 / speed), *[zero] * (SIZE - 1)])
        x, P, _ = learn(x, P, row, -rear, likely**2, jnp.maximum(_SLIDES / step, 1.0))
        along = once(self.wheels.linear(mixed.y, touch))
        peak = self.friction * peaks(touch)[:, None]
        across_evidence: list[Array] = []
        for axle in range(2):
            force = self._told(x, P[V_Y, V_Y], touch, along, peak, axle, whole[axle])
            noise = force.noise + force.apart, force.noise
            counts = soon, jnp.maximum(lasts[axle] / step, 1.0)
            x, P, own = follow(x, P, force.row, force.innovation, noise, counts, MOVES)
            # what errs as the car turns in will err so in the next bend: it is no new evidence then
            takes = jnp.maximum((lasts[axle] + 2 * _TURN_TIME * force.repeats) / step, 1.0)
            likelihood = weigh(force.innovation, own, force.noise, takes, whole[axle])
            across_evidence.append(jnp.where(force.known, likelihood, 0.0))
        angles = [self.motion.slip_angle(x, touch, self.friction, axle) for axle in range(2)]
        across = [self.motion.cornering(x, touch, axle) * angles[axle] for axle in range(2)]
        aside = Aside(jnp.stack(angles), jnp.stack(across))
        y, Y, likelihoods, jumps = self.wheels.learn(
            mixed.y, mixed.Y, along, touch, peak, aside, jump, anew[2:], step
        )
        evidence = jnp.concatenate([jnp.stack(across_evidence), likelihoods])
        evidence = jnp.asarray(_WEIGHTS, x.dtype) @ evidence + once(self._of_jumps(jumps))
        # only to keep the exponentials in range: nothing depends on it, nor does any derivative
        most = jax.lax.stop_gradient(jnp.max(evidence, axis=(0, 2), keepdims=True))
        raised = once(mixed.weight * jnp.exp(evidence - most))
        total = jnp.sum(raised, axis=(0, 1, 3), keepdims=True)
        weight = jnp.maximum(raised / total, _FLOOR)
        variance = jnp.stack([P[i, i] for i in range(SIZE)])
        merged = moments(x, variance, jnp.sum(weight[:, :, 0], axis=(0, 1)))
        likelihood = in_default((most + jnp.log(total[0]))[0, 0, 0])
        return BankState(weight, x, P, y, Y, merged, level), likelihood

    def _told(
        self, x: Array, unsure: Array, touch: Touch, along: Array, peak: Array, axle: int, changed: Array
    ) -> _Told:
        """What an axle's F_y/F_z tells of the states, ``unsure`` the variance of v_y; the wheels' F_x/F_z
        were ``along`` if linear, and are ``peak`` at most. ``changed`` is 1 where the force is a new one."""
        speed = jnp.maximum(jnp.abs(touch.speed), SLOWEST)
        stiffness = self.motion.cornering(x, touch, axle)
        linear = stiffness * self.motion.slip_angle(x, touch, self.friction, axle)
        wheels = slice(2 * axle, 2 * axle + 2)
        bears = touch.bears[wheels, None]
        here = self._axle(x, along[wheels], linear, peak[wheels], bears)
        friction = jnp.sum(bears * peak[wheels], axis=0)
        # at a crawl, over all that v_y could be, the curve has no one slope
        measured = touch.across[axle]
        bent = elastic(measured, friction, self.wheels.shape + x[SHAPE])
        slope = chord(linear, here.across, here.across_by_angle, bent, measured, friction)
        crawls = jnp.clip((_CRAWL - speed) / (_CRAWL - SLOWEST), 0.0, 1.0)
        wide = crawls * unsure * (stiffness / speed) ** 2
        steeper = jnp.maximum(slope - here.across_by_angle, 0.0) * wide / (wide + friction**2)
        by_angle = (here.across_by_angle + steeper) * stiffness
        lagged = -by_angle / speed
        rows = [jnp.zeros_like(lagged)] * SIZE  # stacked: writing one by one costs a pass each
        rows[V_Y], rows[BANK] = lagged, lagged * touch.lag
        # the accelerometer's bias and place are in the force as well
        rows[BIAS_Y] = lagged * touch.lag + 1 / GRAVITY
        rows[LEVER] = rows[BIAS_Y] * touch.yaw_accel
        rows[STIFF_F + axle], rows[SHAPE] = here.across_by_slip, here.across_by_shape
        rows[BIAS_R] = lagged * (-self.motion.arm[axle] - touch.lag * touch.speed)
        gives = self.motion.gives(x, touch, self.friction, axle)
        if axle == 0:
            rows[STEER_BIAS] = -by_angle * jnp.sign(touch.speed)
            rows[GIVE_F] = -by_angle * touch.across[0] * twisting(touch, self.friction)
        turning, gain = touch.across_std[axle] ** 2, (1 + gives * by_angle) ** 2
        leans = jnp.minimum(_LEANS[0] * jnp.abs(measured), _LEANS[1]) ** 2
        noise = FORCE_ERROR[0] ** 2 + (FORCE_ERROR[1] * measured) ** 2 + leans
        noise = noise + turning + touch.shaken[1] ** 2
        heads = changed * _ANGLE_ERROR[0] ** 2 + (1 - changed) * _TOE**2
        astray = heads + (_ANGLE_ERROR[1] * touch.angle[axle]) ** 2 + (_SWAYS / speed**2) ** 2
        noise = noise * gain + astray * by_angle**2
        known = jnp.isfinite(noise) & (jnp.abs(touch.speed) > SLOWEST)
        misread = (x[BIAS_Y] + x[LEVER] * touch.yaw_accel) / GRAVITY
        innovation = jnp.where(known, measured - here.across - misread, 0.0)
        repeats = jnp.where(known, turning * gain / jnp.where(known, noise, 1.0), 0.0)
        noise = jnp.where(known, noise, 1e12)
        # where a tire bends, its force tells little of how far it slips; toe replaces what angles err by
        apart = (_BEND * (linear - here.across)) ** 2 + (_TOE**2 - astray) * by_angle**2 - leans * gain
        return _Told(jnp.stack(rows), innovation, noise, apart, repeats, known)

    def _of_jumps(self, jumps: slip_jump.Told) -> Float[Array, "3 7 J"]:
        """What the wheels' jumps tell each part. A road that has begun under several wheels has not reached
        each of them at once, but one of them."""
        weights = jnp.asarray(_WEIGHTS[:, 2:], jumps.likelihood.dtype)
        stays, began, shaken = jumps.likelihood
        either = jnp.maximum(stays, began)
        asked = (weights > 0) & jumps.tells
        nowhere = jnp.where(asked[:, :, None], (either - began) * weights[:, :, None], jnp.inf)
        nowhere = jnp.where(jnp.any(asked, axis=1, keepdims=True), jnp.min(nowhere, axis=1), 0.0)
        return jnp.stack([weights @ stays, weights @ either - nowhere, weights @ shaken])

    def _axle(self, x: Array, along: Array, across: Array, peak: Array, bears: Array) -> Grip:
        """An axle's tires together: of its wheels, whose F_x/F_z, and its F_y/F_z, if linear, as much as each
        bears of its load: a brake locks the inner wheel, and the outer one goes on steering."""
        wheels = bounded(along, across, peak, self.wheels.shape + x[SHAPE])
        return Grip(*(jnp.sum(bears * part, axis=0) for part in wheels))

    def _mixed(self, state: BankState, distance: Array, dt: Array) -> BankState:
        """The road's friction drifts or changes over a distance; a hypothesis that is born anew inherits."""
        spacing = float(np.log(_LARGEST / _LEAST)) / (_COUNT - 1)
        p, begun = road_changes.moved(state.weight, self.prior, spacing, distance, dt)
        joins = -jnp.expm1(-_JOINS * distance)
        found = joins * jnp.tile(jnp.sum(p[:, :, _SIDES], axis=1), (1, 2, 1))
        p = p.at[:, :, _WHEELS].multiply(1 - joins).at[:, slip_jump.STAYS, _WHEELS].add(found)
        # what has none left could be what the next sample says
        p = once(jnp.maximum(p, _FLOOR))
        whole = once(jnp.sum(p, axis=(0, 1)))
        new = begun / jnp.maximum(whole, _FLOOR)
        x, P = inherit(state.x, state.P, whole[0], new[0])
        y, Y = jax.vmap(inherit)(state.y, state.Y, whole[_WHEELS], new[_WHEELS])
        return BankState(p, x, P, y, Y, state.merged, state.level)

    def _weights(self, state: BankState) -> Float[Array, "7 J"]:
        """Of the hypotheses, for each part, whatever its mode and the kind of road."""
        p = jnp.sum(state.weight, axis=(0, 1))
        return once(p / jnp.sum(p, axis=1, keepdims=True))

    def merged(self, state: BankState) -> tuple[Array, Array]:
        """Mean (n,) and 1σ (n,) of :data:`STATES` over all hypotheses."""
        return in_default(state.merged)

    def is_sound(self, state: BankState) -> Bool[Array, ""]:
        """Whether what it weighs and says are numbers that a car may have."""
        return are_possible(*state.merged, jnp.sum(state.weight, axis=(0, 1, 3)))

    def cornering(self, state: BankState) -> Array:
        """Mean of |F_y/F_z| of the axles, slowed; 0 where nothing tells of it."""
        across = jnp.abs(state.level[:2])
        return in_default(jnp.mean(jnp.where(across < slip_jump.NOTHING, across, 0.0)))

    def quantiles(self, state: BankState, levels: tuple[float, ...]) -> Float[Array, "q 5"]:
        """Quantiles of μ in each of :data:`VIEWS`, linear in ln μ between the grid's points."""
        p = self._weights(state)
        # a product: XLA sums up along an axis in time that grows with the square of its length
        total = p @ jnp.asarray(np.triu(np.ones((_COUNT, _COUNT))), p.dtype)
        wanted = jnp.asarray(levels, p.dtype)[:, None]
        place = jnp.minimum(jnp.sum(total < wanted[..., None], axis=-1), _COUNT - 1)
        is_there = jnp.arange(_COUNT) == place[..., None]
        here = jnp.sum(jnp.where(is_there, p, 0.0), axis=-1)
        before = jnp.sum(jnp.where(is_there, total, 0.0), axis=-1) - here
        inside = jnp.clip((wanted - before) / jnp.maximum(here, _FLOOR), 0.0, 1.0)
        return self._of_views(place + inside - 0.5)

    def likeliest(self, state: BankState) -> Float[Array, " 5"]:
        """The μ where the density of ln μ is largest, in each of :data:`VIEWS`."""
        return self._of_views(likeliest(self._weights(state)))

    def _of_views(self, place: Float[Array, "*q 7"]) -> Float[Array, "*q 5"]:
        """Means of the parts' frictions at places on the grid, in steps."""
        grid = jnp.log(self.friction)
        return in_default(jnp.exp(grid[0] + (grid[1] - grid[0]) * place) @ jnp.asarray(_MEANS.T, grid.dtype))

    def std(self, state: BankState, told: Float[Array, " 5"]) -> Float[Array, " 5"]:
        """1σ of μ about what is ``told`` of it in each of :data:`VIEWS`, the grid's own width included."""
        p = self._weights(state)
        mean = jnp.sum(p * self.friction, axis=1, keepdims=True)
        width = self.friction * float(np.log(_LARGEST / _LEAST) / (_COUNT - 1)) / 12**0.5
        of_parts = root(jnp.sum(p * ((self.friction - mean) ** 2 + width**2), axis=1))
        means = jnp.asarray(_MEANS, p.dtype)
        return in_default(rss(means @ of_parts, means @ mean[:, 0] - in_single(told)))
