"""How far what accelerations and torques tell of the tires' forces may be off."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.core.constants import GRAVITY
from roadstate.estimators.axle_forces import by_axle
from roadstate.estimators.force_balance import Balance, ForceBalance, Scene
from roadstate.estimators.intake import ACCEL_Y, SMOOTHING, STALE, YAW_RATE, Signals
from roadstate.estimators.traction import UNKNOWN, Traction
from roadstate.linalg import root, rss

_TORQUE_TIME = 0.1  # s: correlation time of the torque signals' noise
_TORQUE_DELAY = 0.03  # s by which a torque signal may be late
_CRAWL = 1.0  # m/s under which a brake's torque may be anything up to what it could be
_UNEVEN = 0.02  # m/s²/√Hz: what the road's unevenness does to the force that torques tell
_GUST = 3.0  # m/s/√Hz: a wind that varies by 1 m/s over 5 s
_TURNING = 0.05  # 1σ of the share of the front axle's lateral force that steering turns backward
_SPLIT_ERROR = 0.3  # 1σ of what each wheel brakes where nothing tells, as a share of what one does at most
_DIFFERENTIAL = 0.1  # 1σ of what a wheel gets of an engine's torque, as a share of it
_INERTIA_ERROR = 0.1  # 1σ of the yaw inertia, as a share of it
_UNTIL_NEXT = 0.5  # 1σ of how a_y changes until its next sample, as a share of how it has
_PLACE_ERROR = 0.05  # m: 1σ of where the IMU is along the car, once that has been learned
_SPLAY_ERROR = 0.6  # 1σ of what the steering's geometry sets front tires against each other by, as a share
# 1σ of what leans on an axle across, over its load, where a bend climbs or falls and so is twisted: as a
# share of what its slope turns by from axle to axle
_TWISTED = 0.5


def gust(drag: Float[Array, ""], speed: Float[Array, ""]) -> Float[Array, ""]:
    """White error by wind, m/s²/√Hz, of air that holds back by ``drag`` (m/s²) at a speed (m/s)."""
    return 2 * drag / jnp.maximum(jnp.abs(speed), 1.0) * _GUST


def along(
    balance: ForceBalance,
    drive: Traction,
    at: Scene,
    jump: Float[Array, " 8"],
    speed: Float[Array, ""],
    gust: Float[Array, ""],
    accel: Float[Array, " 2"],
) -> Float[Array, ""]:
    """White error of the specific force that torques tell, m/s²/√Hz.

    Args:
        balance: of forces.
        drive: what torques are told.
        at: the balance's scene.
        jump: by which drive and brake torques of the wheels are ahead of a low pass, N·m.
        speed: m/s.
        gust: of this intensity are winds.
        accel: specific forces, m/s².
    """
    mass, radius = balance.car.mass, balance.car.wheel_radius[0]
    white = rss(drive.torque_std * _TORQUE_TIME**0.5, drive.held_noise) / mass
    late = jnp.sum(jnp.abs(jump)) / (radius * mass) * (_TORQUE_DELAY / SMOOTHING * _TORQUE_TIME**0.5)
    turning = _TURNING * accel[1] * at.sine
    lost = jnp.where(drive.is_shifting, UNKNOWN["shift"], 0.0)
    lost = jnp.where(drive.age < STALE, lost, UNKNOWN["drive"])
    brake = jnp.where(at.unseen.may_act | (jnp.abs(speed) < _CRAWL), UNKNOWN["brake"], 0.0)
    return jnp.sqrt(_UNEVEN**2 + gust**2 + white**2 + late**2 + turning**2 + lost**2 + brake**2)


def split(balance: ForceBalance, slow: Balance, engine: Float[Array, " 8"] | None) -> Float[Array, " 4"]:
    """1σ of what F_x of each wheel is beside its share of the sum, N.

    Args:
        balance: of forces.
        slow: what it found.
        engine: drive and brake torques of the wheels, N·m, if the first are an engine's.
    """
    error = jnp.where(slow.blind, _SPLIT_ERROR * jnp.max(jnp.abs(slow.along)), 0.02 * jnp.abs(slow.rest))
    if engine is not None:
        error = rss(error, _DIFFERENTIAL * jnp.abs(engine[:4]) / balance.car.wheel_radius[0])
    return error


def across(
    balance: ForceBalance, signals: Signals, at: Scene, split: Float[Array, " 4"]
) -> Float[Array, " 2"]:
    """1σ of the axles' F_y over load, beyond what every measurement of it errs; infinite if none comes.

    Args:
        balance: of forces.
        signals: of the instant.
        at: the balance's scene.
        split: 1σ of F_x of each wheel, N.
    """
    car, rotation, axles = balance.car, jnp.abs(signals.rate[YAW_RATE]), by_axle(at.load)
    # what one side brakes more than the other turns the car, too
    pulled = root(jnp.sum((balance.half_track * split) ** 2))
    splayed = _SPLAY_ERROR * balance.half_track[0] * at.sine * balance.splay(at)
    moment = rss(_INERTIA_ERROR * car.yaw_inertia * rotation, pulled, splayed) / (axles * car.wheelbase)
    age = jnp.maximum(signals.age[ACCEL_Y], signals.age[YAW_RATE])
    missing = jnp.where(age < STALE, 0.0, jnp.inf)
    goes_on = _UNTIL_NEXT * jnp.abs(signals.rate[ACCEL_Y]) * jnp.minimum(age, STALE) / GRAVITY
    twisted = _TWISTED * at.slope / GRAVITY * at.sine / at.cosine
    return rss(moment, _PLACE_ERROR * rotation / GRAVITY, goes_on, twisted) + missing
