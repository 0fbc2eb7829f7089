"""Drives drawn at random: each on a road of its own, with a driver, sensors and a vehicle file of its own."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from benchmarks.accuracy.scenarios import Scenario, driven
from numpy.typing import NDArray

from roadstate.core import InputError, Log
from roadstate.core.constants import GRAVITY
from roadstate.estimators.road import GradePrior
from roadstate.estimators.sideways import BANK_LENGTH
from roadstate.papers.base import MISMATCHED
from roadstate.papers.plants import told
from roadstate.sim.manoeuvres import Manoeuvre
from roadstate.sim.manoeuvres.path import straight
from roadstate.sim.manoeuvres.script import Script
from roadstate.sim.roads.centreline import Bend, half_cosine, make_road
from roadstate.sim.roads.friction import FrictionMap, joint
from roadstate.sim.roads.grade import GradeProfile
from roadstate.sim.roads.road import Road
from roadstate.sim.roads.roughness import rough_surface
from roadstate.sim.run import truth_table
from roadstate.sim.sensors import measure, sensor_preset, to_log
from roadstate.sim.speed_plan import SpeedPlan
from roadstate.vehicles import Vehicle

Array = NDArray[np.float64]
SECONDS = 60.0
"""Of a recording."""
_SETTLES = 4.0  # s before it, in which the plant comes to rest on its springs
_LENGTH = 2500.0  # m, more than any of the drives takes
_KNOTS = 20.0  # m between places where grade and bank are drawn
_GRADE, _BANK = (0.02, 0.08), (0.01, 0.03)  # rad: 1σ of a road's, drawn between
_GRADE_LENGTH = (80.0, 320.0)  # m
_BANKED = (0.08, 24.0)  # bends bank inward by at most that, and that over their radius in m; none by all
_DRY, _ANY = (0.75, 1.05), (0.1, 0.75)  # friction of dry roads, and of others
_PIECE, _PIECES = 400.0, 12  # m of a road of one friction, on average; and how many there are
_CLASSES = ("A", "A", "B", "B", "B", "C")
_SHARPEST = 30.0  # m of radius
_ALONG = (0.1, 0.95)  # share of the usual friction that speeding up and braking ask for
_SPEED = (8.0, 28.0)  # m/s
_WIND = 2.5  # m/s: 1σ of the air's velocity each way, as high as a car
_TRIES = 20


class Roads(NamedTuple):
    """What roads of a kind, and those who drive on them, have in common.

    Attributes:
        is_patchy: whether friction changes along the road.
        sideways: share of the least friction that bends ask for at the highest speed.
        slowest: least of the speeds aimed at, as a share of the highest.
        stops: how many of them are none.
        along: of the rates of :data:`_ALONG`.
    """

    is_patchy: bool
    sideways: tuple[float, float]
    slowest: float
    stops: float
    along: float


MIXED = Roads(is_patchy=True, sideways=(0.1, 0.7), slowest=0.25, stops=0.12, along=1.0)
"""A bit of everything: bends are gentle, as the most slippery piece allows."""
WINDING = Roads(is_patchy=False, sideways=(0.4, 0.9), slowest=0.55, stops=0.0, along=0.5)
"""Mostly bends, and a driver who hardly brakes for them."""


def drawn(vehicle: Vehicle, seed: int, roads: Roads = MIXED) -> tuple[Log, Vehicle]:
    """A recording on the multibody plant, and the vehicle file that an estimator is told.

    Args:
        vehicle: that is driven.
        seed: same seed, same drive.
        roads: of which kind.

    Raises:
        InputError: none of several drives can be driven.
    """
    for attempt in range(_TRIES):
        rng = np.random.default_rng([seed, attempt])
        x, y = _WIND * np.random.default_rng([seed, attempt, 1]).standard_normal(2)
        prepare = partial(_manoeuvre, rng, roads)
        scenario = Scenario("drawn", "a drive drawn at random", prepare, wind=(float(x), float(y)))
        try:
            truth = truth_table(driven(vehicle, scenario))
        except InputError:  # it leaves the road
            continue
        log = to_log(measure(truth, sensor_preset("automotive"), seed=seed))
        return log.between(log.time[0] + _SETTLES, log.time[-1]), told(vehicle, MISMATCHED, seed)
    raise InputError(f"seed {seed} gives no drive that can be driven")


def _manoeuvre(rng: np.random.Generator, roads: Roads, vehicle: Vehicle) -> Manoeuvre:
    frictions, edges = _frictions(rng)
    if not roads.is_patchy:
        frictions, edges = frictions[:1], []
    least = min(f for f, begin in zip(frictions, (0.0, *edges), strict=True) if begin < _LENGTH)
    fastest = rng.uniform(*_SPEED)
    sharpest = fastest**2 / (rng.uniform(*roads.sideways) * least * GRAVITY)
    along = roads.along * rng.uniform(*_ALONG) * float(np.median(frictions)) * GRAVITY
    road = _road(rng, max(sharpest, _SHARPEST), joint(edges, frictions))
    plan = _plan(rng, roads, fastest, along)
    return Manoeuvre("drawn", "drawn at random", road, plan.speed[0], Script.write(plan), straight())


def _frictions(rng: np.random.Generator) -> tuple[list[float], list[float]]:
    """Frictions of the pieces of a road, and where they meet, m."""
    dry, other = rng.uniform(*_DRY, _PIECES), np.exp(rng.uniform(*np.log(_ANY), _PIECES))
    frictions = np.where(rng.random(_PIECES) < 0.5, dry, other)
    edges = np.cumsum(5.0 + rng.exponential(_PIECE, _PIECES - 1))
    return frictions.tolist(), edges.tolist()


def _road(rng: np.random.Generator, sharpest: float, friction: FrictionMap) -> Road:
    bends: list[Bend] = [Bend(60.0)]
    banked = [0.0, 0.0]  # where each section begins, and where the last one ends
    while (left := _LENGTH - sum(b.length for b in bends)) > 0:
        radius = sharpest * float(np.exp(rng.uniform(0.0, 1.5)))
        ramp, curvature = 0.5 * radius, rng.choice([-1.0, 1.0]) / radius
        arc, rest = radius * rng.uniform(0.3, 1.2), rng.uniform(20.0, 200.0)
        if left < 2 * ramp + arc + rest:
            bends.append(Bend(left))
            banked.append(0.0)
        else:
            inward = -np.sign(curvature) * rng.uniform() * min(_BANKED[0], _BANKED[1] / radius)
            banked += [inward, inward, 0.0, 0.0]
            bends += [
                Bend(ramp, 0.0, curvature),
                Bend(arc, curvature),
                Bend(ramp, curvature, 0.0),
                Bend(rest),
            ]
    places = np.arange(0.0, _LENGTH + _KNOTS, _KNOTS)
    length = float(np.exp(rng.uniform(*np.log(_GRADE_LENGTH))))
    grade = _along(rng, np.exp(rng.uniform(*np.log(_GRADE))), length, len(places))
    bank = _along(rng, np.exp(rng.uniform(*np.log(_BANK))), BANK_LENGTH, len(places))
    sections = np.cumsum([0.0, *(b.length for b in bends)])
    bank += np.interp(places, sections, banked)
    return make_road(
        bends,
        height=GradeProfile.in_plan(places, np.clip(grade, -0.2, 0.2)).over_plan,
        bank=half_cosine(places, np.tan(np.clip(bank, -0.12, 0.12))),
        friction=friction,
        surface=rough_surface(str(rng.choice(_CLASSES)), int(rng.integers(1 << 30)), 500.0),
    )


def _along(rng: np.random.Generator, std: float, length: float, count: int) -> Array:
    """(N,) of a Matérn process at places :data:`_KNOTS` apart."""
    prior, step = GradePrior(jnp.asarray(std), jnp.asarray(length)), jnp.asarray(_KNOTS)
    move, noise = np.asarray(prior.transition(step)), np.asarray(prior.sqrt_Q(step))
    state = np.asarray(prior.stationary_std) * rng.standard_normal(2)
    out = np.empty(count)
    for i in range(count):
        out[i] = state[0]
        state = move @ state + noise @ rng.standard_normal(2)
    return out


def _plan(rng: np.random.Generator, roads: Roads, fastest: float, along: float) -> SpeedPlan:
    """Speeding up, holding and braking, now and then to a stop."""
    end = _SETTLES + SECONDS
    time, speed = [0.0, 1.0], [fastest * rng.uniform(1.2 * roads.slowest, 1.0)] * 2
    while time[-1] < end:
        target = 0.0 if rng.random() < roads.stops else fastest * rng.uniform(roads.slowest, 1.0)
        rate = along * rng.uniform(0.2, 1.0)
        for seconds in (max(abs(target - speed[-1]) / rate, 0.3), rng.uniform(0.5, 6.0)):
            time.append(time[-1] + seconds)
            speed.append(target)
    knots = np.array(time)
    whole = np.append(knots[knots < end], end)
    return SpeedPlan(tuple(whole.tolist()), tuple(np.interp(whole, knots, speed).tolist()))
