"""How well any filter could know peak friction and axle forces with a preset's sensors, computed.

The ideal filter knows the plant: the family of its tire, how loads move and slips lag, and where a piece of
road begins. What it does not know are the states of :mod:`benchmarks.accuracy.friction_world`, and the least
error is the posterior Cramér–Rao bound of that world along the true drive. Before the drive it knows

- of ln μ of each piece of road: 1σ = 0.5, for dry, wet or snow; it drifts by 10 % within 300 m;
- of grade and bank, and how they change with distance, what the vehicle file's prior says;
- of the car: mass, yaw inertia, height of the centre of gravity and stiffnesses as the benchmark's vehicle
  files tell them (5 to 10 % wrong), the radius likewise (0.3 to 1 %), shape factors, rolling resistance, drag
  and pitch gradient as the file's prior says;
- of the sensors: the preset's 1σ of biases, their walks and gains, of the accelerometers with the mounting's
  angles.

It is given more than any filter has, so that what is computed lies below the least error, not above it: the
places of the wheels' teeth (the same each turn), camber, the body's roll and pitch, that no motor pushes an
idle wheel, that left and right are one road where their friction is the same, and in a force what the
rounding of that sample's wheel speed does to it. Left out is what matters little: the receiver's position and
the lag of errors of slips, which last for seconds where the lag is one of hundredths.

An error of 1σ of ln μ is taken for one of 100σ per cent. The figures' bounds are medians and percentiles of
|error| were errors N(0, σ) at each sample; for errors of another kind it is their root mean square that is
bounded.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import erf
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from benchmarks.accuracy.friction_truth import SLOWEST, Truth, plant_tire, truth_of
from benchmarks.accuracy.friction_world import (
    AXLE_FORCES,
    MOTION,
    NOISES,
    SENSORS,
    STATES,
    Slopes,
    World,
    slopes,
    world_of,
)
from benchmarks.accuracy.grade_bound import MASS_OFF, sample_noise
from benchmarks.accuracy.measures import AXLES
from numpy.typing import NDArray

from roadstate.core import WHEELS, Log
from roadstate.core.constants import GRAVITY
from roadstate.core.gaussian import Gaussian
from roadstate.cramer_rao import cramer_rao_bound
from roadstate.estimators.road import GradePrior
from roadstate.estimators.sideways import BANK_LENGTH
from roadstate.linalg import tria
from roadstate.papers.plants import OFF, rms
from roadstate.sim.sensors import SensorSuite, sensor_preset
from roadstate.sim.sensors.wheel_pulses import ToothSensor
from roadstate.statespace import StateSpaceModel
from roadstate.vehicles import Vehicle

Array = NDArray[np.float64]
FRICTION = 0.5
"""1σ of ln μ before the drive."""
_DRIFT = 0.1 / 300.0**0.5  # 1σ of ln μ after one metre
_ROLLS = {"velocity_x": 1.0, "velocity_y": 0.5, "yaw_rate": 0.1}  # 1σ before the first sample
_NOTHING = 1e-3  # N·m
_NEAREST = 1e-6  # m
_CHUNK = 500  # samples: drives of all lengths share one program
_HALVINGS = 40
_FARTHEST = 8.0  # σ that no error exceeds
_SIGMAS = np.linspace(0, _FARTHEST, 4001)
_WITHIN = np.array([erf(z / np.sqrt(2)) for z in _SIGMAS])


class FrictionBound(NamedTuple):
    """Least 1σ at each sample.

    Attributes:
        friction: group of :data:`benchmarks.accuracy.measures.AXLES` → (T,) of ln of its mean peak friction.
        forces: axle force, such as ``force_y_front`` → (T,) N.
    """

    friction: Mapping[str, Array]
    forces: Mapping[str, Array]


class Noise(NamedTuple):
    """1σ of a sample.

    Attributes:
        sensors: (T, 11) of :data:`SENSORS`.
        inner: (T, 5) of :data:`NOISES`.
        walk: (T, n) of each state after one second.
    """

    sensors: Any
    inner: Any
    walk: Any


class _Linear(StateSpaceModel):
    """δx⁺ = F δx + w, z = H δx + v: inputs are F, H, √Q and √R of each sample."""

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    first: Any

    def f(self, x: Any, u: Any, dt: Any) -> Any:
        return u[0] @ x

    def h(self, x: Any, u: Any) -> Any:
        return u[1] @ x

    def sqrt_Q(self, u: Any, dt: Any) -> Any:
        return u[2]

    def sqrt_R(self, u: Any) -> Any:
        return u[3]

    def prior(self) -> Gaussian:
        return Gaussian(jnp.zeros(len(self.states)), self.first)


def friction_bound(log: Log, vehicle: Vehicle, known: Mapping[str, float] | None = None) -> FrictionBound:
    """Along one drive.

    Args:
        log: of the drive, recorded with the preset ``automotive``; its truth is used, the torques that were
            reported, and which samples of the receiver it has, if any.
        vehicle: that was driven.
        known: state → 1σ before the drive, in place of what the module says: to see what it costs not to
            know a thing.
    """
    tire, suite = plant_tire(vehicle), sensor_preset("automotive")
    truth, world = truth_of(log, vehicle, tire), world_of(vehicle, tire)
    first = prior_std(vehicle, suite) | dict(known or {})
    moving = truth.velocity_x > SLOWEST
    present = np.repeat(moving[:, None], len(SENSORS), axis=1)
    present[:, SENSORS.index("yaw_rate")] = True
    for name in ("speed", "vertical_speed"):
        present[:, SENSORS.index(name)] = moving & np.isfinite(log[name]) if name in log else False
    dt = np.diff(log.time, prepend=log.time[0])
    noise = sample_noises(truth, vehicle, suite, 1 / suite.wheel_speed.rate)
    std, axles = _run(world, truth, noise, dt, present, jnp.diag(jnp.asarray([first[s] for s in STATES])))
    friction = {name: std[:, i] for i, name in enumerate(AXLES)}
    return FrictionBound(friction, dict(zip(AXLE_FORCES, axles.T, strict=True)))


def prior_std(vehicle: Vehicle, suite: SensorSuite) -> dict[str, float]:
    """1σ of each state before the drive.

    Args:
        vehicle: whose file's prior counts.
        suite: the preset.
    """
    assert suite.imu is not None
    assert suite.steering_wheel is not None
    assert suite.drive_torque is not None
    assert suite.brake_torque is not None
    imu, steering, prior = suite.imu, suite.steering_wheel, vehicle.prior
    accel, mounted = imu.accel, GRAVITY * imu.mounting_std
    ratio = 1.0 if vehicle.steering is None else vehicle.steering.ratio
    shape = prior.tire_shape_std / vehicle.tires.shape
    alike = {
        "accel_x_bias": float(np.hypot(accel.bias, mounted)),
        "accel_y_bias": float(np.hypot(accel.bias, mounted)),
        "yaw_rate_bias": imu.gyro.bias,
        "pitch_rate_bias": imu.gyro.bias,
        "roll_rate_bias": imu.gyro.bias,
        "accel_x_gain": float(np.hypot(accel.gain_std, GRAVITY * prior.pitch_gradient_std)),
        "accel_y_gain": accel.gain_std,
        "yaw_rate_gain": imu.gyro.gain_std,
        "mounting_yaw": imu.mounting_std,
        "steer_bias": steering.bias / ratio,
        "steer_gain": steering.gain_std,
        **_stationary("grade", prior.grade_std, prior.grade_correlation_length),
        **_stationary("bank", prior.bank_std, BANK_LENGTH),
        "drag": prior.drag_relative,
        "radius": rms(OFF["radius"]),
        "rolling_resistance": prior.rolling_resistance_std,
        "shape_x": shape,
        "shape_y": shape,
        "friction_slippery": FRICTION,
        "friction_grippy": FRICTION,
    }
    figures = ("mass", "yaw_inertia", "cg_height", "slip_stiffness", "cornering_front", "cornering_rear")
    # a motor that is not there pushes nothing; zero would cost the recursion its fast path
    bias = np.maximum(suite.drive_torque.bias * _driven(vehicle), _NOTHING)
    per_wheel = {
        "drive_gain": np.full(4, suite.drive_torque.gain_std),
        "drive_bias": bias,
        "brake_gain": np.full(4, suite.brake_torque.gain_std),
    }
    wheels = {f"{what}_{w}": float(v[i]) for what, v in per_wheel.items() for i, w in enumerate(WHEELS)}
    return _ROLLS | alike | dict.fromkeys(figures, MASS_OFF) | wheels


def _stationary(name: str, std: float, length: float) -> dict[str, float]:
    """1σ of grade or bank and of its rate of distance where nothing is known."""
    road = GradePrior(jnp.asarray(std), jnp.asarray(length)).stationary_std
    return {name: float(road[0]), f"{name}_slope": float(road[1])}


def sample_noises(truth: Truth, vehicle: Vehicle, suite: SensorSuite, dt: float) -> Noise:
    """1σ of what is new at each sample.

    Wheel speeds have the error of their rounding; what they change by tells I ω̇.

    Args:
        truth: of the drive.
        vehicle: that is driven.
        suite: the preset.
        dt: s between two wheel speeds.
    """
    assert suite.imu is not None
    assert suite.gnss is not None
    assert isinstance(suite.wheel_speed, ToothSensor)
    assert suite.steering_wheel is not None
    assert suite.drive_torque is not None
    assert suite.brake_torque is not None
    spin = suite.wheel_speed.resolution / np.sqrt(12)
    driven = sample_noise(suite.drive_torque) * _driven(vehicle)
    braked = sample_noise(suite.brake_torque) * (truth.brake_torque > 0)
    gained = vehicle.wheels.inertia * np.sqrt(2) * spin / dt
    accel, rate, speed = (
        np.full(len(truth.load), s)
        for s in (sample_noise(suite.imu.accel), sample_noise(suite.imu.gyro), suite.gnss.velocity.noise)
    )
    torque = np.sqrt(driven**2 + braked**2 + gained**2)
    slip = vehicle.wheels.radius * spin / np.maximum(truth.velocity_x, SLOWEST)
    ratio = 1.0 if vehicle.steering is None else vehicle.steering.ratio
    steer = np.full(len(truth.load), sample_noise(suite.steering_wheel) / ratio)
    sensors = np.column_stack([accel, accel, rate, rate, rate, speed, speed, torque])
    walks = dict.fromkeys(("accel_x_bias", "accel_y_bias"), suite.imu.accel.walk)
    walks |= dict.fromkeys(("yaw_rate_bias", "pitch_rate_bias", "roll_rate_bias"), suite.imu.gyro.walk)
    drift = _DRIFT * np.sqrt(np.abs(truth.velocity_x))
    walk = np.zeros((len(truth.load), len(STATES)))
    for name, std in (walks | dict.fromkeys(("friction_slippery", "friction_grippy"), drift)).items():
        walk[:, STATES.index(name)] = std
    return Noise(sensors, np.column_stack([*4 * [slip], steer]), walk)


def _driven(vehicle: Vehicle) -> Array:
    """(4,) 1 for a driven wheel, else 0."""
    return {"front": np.array([1.0, 1, 0, 0]), "rear": np.array([0.0, 0, 1, 1])}.get(
        vehicle.driveline.driven, np.ones(4)
    )


def _run(
    world: World, truth: Truth, noise: Noise, dt: Array, present: Array, first: Any
) -> tuple[Array, Array]:
    """(T, 3) 1σ of ln of the groups' friction and (T, 4) of the axles' forces, N."""
    count = len(dt)
    extra = -count % _CHUNK
    rows = jax.tree.map(
        lambda a: jnp.asarray(np.concatenate([a, np.repeat(a[-1:], extra, axis=0)])), (truth, noise)
    )
    steps = jnp.asarray(np.concatenate([dt, np.zeros(extra)]))
    there = jnp.asarray(np.concatenate([present, np.zeros((extra, len(SENSORS)), bool)]))
    found = []
    for start in range(0, count, _CHUNK):
        part = slice(start, start + _CHUNK)
        some_truth, some_noise = jax.tree.map(lambda a, part=part: a[part], rows)
        inputs, wanted = _prepared(world, some_truth, some_noise, steps[part])
        model = _Linear(STATES, SENSORS, first)
        still = jnp.zeros((_CHUNK, len(STATES)))
        factor = cramer_rao_bound(model, still, inputs, steps[part], present=there[part]).factor
        found.append(np.asarray(_spread(wanted, factor)))
        first = factor[-1]
    std = np.concatenate(found)[:count]
    return std[:, : len(AXLES)], std[:, len(AXLES) :]


@eqx.filter_jit
def _prepared(world: World, truth: Truth, noise: Noise, dt: Any) -> tuple[Any, Any]:
    """Inputs of :class:`_Linear` at each sample, and (T, 7, n) of what is wanted by the states."""

    def one(truth: Truth, noise: Noise, dt: Any) -> tuple[Any, Any]:
        at = slopes(world, truth)
        F, root_Q = moved(world, truth, at, noise, dt)
        inputs = F, at.sensors[:, : len(STATES)], root_Q, read(at, noise)
        return inputs, jnp.concatenate([_of_groups(truth), at.axles[:, : len(STATES)]])

    return jax.vmap(one)(truth, noise, dt)


@eqx.filter_jit
def _spread(wanted: Any, factor: Any) -> Any:
    return jnp.linalg.norm(wanted @ factor, axis=-1)


def moved(world: World, truth: Truth, at: Slopes, noise: Noise, dt: Any) -> tuple[Any, Any]:
    """F (n, n) and √Q (n, n + 9) of a step.

    The motion moves by the backward Euler rule, which any stiffness of slow wheels bears; grade and bank as
    their priors say.

    Args:
        world: the car and its roads.
        truth: of the sample.
        at: slopes of the sample.
        noise: of the sample.
        dt: s since the one before.
    """
    n = len(STATES)
    A, B = at.motion[:, :n], at.motion[:, n:]
    ahead = jnp.linalg.inv(jnp.eye(MOTION) - dt * A[:, :MOTION])
    rows = jnp.concatenate([ahead, dt * ahead @ A[:, MOTION:]], axis=1)
    F = jnp.eye(n).at[:MOTION].set(rows)
    inner = jnp.zeros((n, len(NOISES))).at[:MOTION].set(dt * ahead @ B * noise.inner)
    Q = [inner, jnp.diag(noise.walk) * jnp.sqrt(dt)]
    distance = jnp.abs(truth.velocity_x) * dt
    for name, road in (("grade", world.grade), ("bank", world.bank)):
        i = STATES.index(name)
        F = F.at[i : i + 2, i : i + 2].set(road.transition(distance))
        # where it stands still the factor's cross term is 0/0
        moves = jnp.where(distance > 0, road.sqrt_Q(jnp.maximum(distance, _NEAREST)), 0.0)
        Q.append(jnp.zeros((n, 2)).at[i : i + 2].set(moves))
    return F, jnp.concatenate(Q, axis=1)


def read(at: Slopes, noise: Noise) -> Any:
    """√R (11, 11): errors of slips and steering reach several sensors' predictions at once.

    Args:
        at: slopes of the sample.
        noise: of the sample.
    """
    return tria(jnp.diag(noise.sensors), at.sensors[:, len(STATES) :] * noise.inner)


def _of_groups(truth: Truth) -> Any:
    """(3, n) of ln of each group's mean friction by the states."""
    rows = []
    for wheels in AXLES.values():
        own = np.array([w in wheels for w in WHEELS])
        share = truth.friction * own / jnp.sum(truth.friction * own)
        grippy = jnp.sum(share * truth.grippy)
        row = jnp.zeros(len(STATES)).at[STATES.index("friction_slippery")].set(1 - grippy)
        rows.append(row.at[STATES.index("friction_grippy")].set(grippy))
    return jnp.stack(rows)


def quantile(std: Array, share: float, weight: Array | None = None) -> float:
    """The size that |error| does not exceed in a share of samples, each with an error of its own N(0, σ).

    Args:
        std: (N,) σ.
        share: 0.5 for the median.
        weight: (N,) of each sample; all alike by default.
    """
    low, high = 0.0, _FARTHEST * float(np.max(std))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        inside = np.average(np.interp(middle / std, _SIGMAS, _WITHIN), weights=weight)
        low, high = (middle, high) if inside < share else (low, middle)
    return 0.5 * (low + high)
