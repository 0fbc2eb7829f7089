"""What the joint estimator says of its state."""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.core.estimates import Validity
from roadstate.core.numerics import in_default
from roadstate.estimators.along import BIAS, SCALE, SLOPE, SPEED
from roadstate.estimators.axle_forces import LEAST_FORCE, AxleForces, by_axle, parked
from roadstate.estimators.base import Estimate
from roadstate.estimators.contact_forces import NOISY
from roadstate.estimators.friction_bank import VIEWS
from roadstate.estimators.intake import ACCEL_X, ACCEL_Y, SMOOTHING, SPIN, STALE, WHEEL_SPEEDS, YAW_RATE
from roadstate.estimators.sideways import BANK, BIAS_Y, LEVER, SLOWEST, V_Y
from roadstate.estimators.signals import STANDSTILL_SPEED
from roadstate.estimators.soft_ground import unsettled
from roadstate.estimators.wheel_forces import Known
from roadstate.linalg import root, rss

if TYPE_CHECKING:
    from roadstate.estimators.joint import Joint, JointState

_SILENT = 3.0  # s without a channel after which the estimate is called a prediction
_SURE = 0.6  # ratio of the 5 % to the 95 % bound from which on friction counts as known
_ROUGH = (0.003, 0.01)  # 1σ of an axle's force along and across, as a share of its load
_ROLLS = (0.006, 50.0)  # 1σ over load of what rolling resistance grows by up to a speed in m/s, with v⁴
_CG_ERROR = 0.015  # of the wheelbase: 1σ of where the centre of gravity is along it
_SHARED = 0.03  # 1σ of how forces along are shared by the axles, whose torques err each by itself
# 1σ of what is added along and across to undo the low pass, as a share of it
_LEAD_ERROR = np.array([1.0, 0.7])
# 1σ of what they change by until a sample comes, as a share of how they have changed before
_HELD_ERROR = np.array([1.0, 0.5])
_FITTED = 2.06  # white noise's variance after a fit, times its memory
_SWIFT = np.array([0.3, 0.6]) ** 2  # 1σ² of what accelerometer and torques change by beyond a low pass's lag
# 1σ of these over g, as a share of what a rough road shakes the accelerometers by: tires bear more and less
# as they bounce, and the body passes on only a part of it
_SHAKEN = (0.88, 2.25)
# rad √(m/s)/(m/s²): 1σ of the mean slope over a second by unevenness, whose slopes are white along the road
# (ISO 8608), times the root of the speed, over what it shakes the accelerometers by both ways
_HEIGHTS = ("altitude", "vertical_speed")  # what tells a slope apart from a bias
_UNEVEN = 0.105
# s: 1σ of how late everything on the bus is, wheels and accelerometer alike, which nothing in it can tell
_LATE = 0.01
_CUT = 0.35  # of a speed's step: root mean square of its error's mean, be it rounded (none) or cut off (half)
_DIRECTED = 0.05  # force over load from which on it has a direction, however the road shakes it
_DRIFTS = 0.02  # 1σ of v̇_y over g


def validity_of(
    joint: Joint, state: JointState, faults: Bool[Array, " f"], ok: Bool[Array, ""]
) -> Int[Array, ""]:
    """Code of what the state can be relied on for.

    Args:
        joint: the estimator.
        state: its state.
        faults: which of the estimator's ``fault_names`` are there.
        ok: whether the filter's step was sound.
    """
    used = jnp.asarray([joint.signals.has[i] for i in range(8)])
    oldest = jnp.max(jnp.where(used & (jnp.arange(8) < SPIN.start), state.signals.age, 0.0))
    low, _, high = state.friction
    sure = low[0] > _SURE * high[0]
    validity = jnp.where(sure, int(Validity.EXCITED), int(Validity.LOW_EXCITATION))
    validity = jnp.where(state.latest.is_shifting & ~sure, int(Validity.GEAR_SHIFT), validity)
    validity = jnp.where(state.latest.is_brake_unknown & ~sure, int(Validity.BRAKING), validity)
    stands = jnp.abs(state.along.gaussian.mean[SPEED]) < STANDSTILL_SPEED
    validity = jnp.where(stands, int(Validity.STANDSTILL), validity)
    validity = jnp.where(jnp.any(faults), int(Validity.SENSOR_FAULT), validity)
    if "attitude" in joint.sensors:
        oldest = jnp.maximum(oldest, state.pitch.gyro.rate.age)
    # a frozen channel counts as missing in all that follows, but it is there
    is_silent, _, is_frozen = faults[: 3 * len(joint.channels)].reshape(3, -1)
    silent = (jnp.maximum(oldest, state.speed_age) > _SILENT) & ~jnp.any(is_frozen)
    silent = silent | jnp.any(is_silent)
    validity = jnp.where(silent, int(Validity.SENSOR_MISSING), validity)
    return jnp.where(ok, validity, int(Validity.DIVERGED))


def told(joint: Joint, state: JointState, faults: Bool[Array, " f"]) -> Estimate:
    """Everything, with standard deviations; the likeliest friction with its 5 % and 95 % bounds.

    Args:
        joint: the estimator.
        state: its state.
        faults: which of the estimator's ``fault_names`` are there.
    """
    values: dict[str, Array] = {}
    stds: dict[str, Array] = {}

    def tell(name: str, value: Array, std: Array) -> None:
        values[name], stds[name] = value, std

    mean, std = state.along.gaussian.mean, state.along.gaussian.std
    forces = state.latest
    sine = jnp.clip(mean[SLOPE] / GRAVITY, -0.99, 0.99)
    grade = jnp.arcsin(sine)
    side, side_std = state.pace.merged(joint.bank, state.bank)
    # in a long bend v_y r looks like a slope, and the lateral forces say how sharp the bend is
    sharp = joint.bank.cornering(state.bank)
    if joint.signals.has[ACCEL_Y] and not joint.knows_sides:
        sharp = jnp.abs(forces.accel[1]) / GRAVITY
    sharp = sharp / jnp.maximum(jnp.abs(mean[SPEED]), SLOWEST)
    # and so does what pulls an accelerometer that is not in the car's middle away from it
    swings = root(in_default(joint.bank.motion.first[LEVER, LEVER])) * GRAVITY * sharp
    sway = sharp * rss(side_std[V_Y], swings)
    uneven = _UNEVEN * jnp.min(forces.shaken) / root(jnp.maximum(jnp.abs(mean[SPEED]), 1.0))
    ground = _ground(joint, mean, std)
    unsure = rss(std[SLOPE] / GRAVITY, sway, uneven, ground)
    tell("grade", grade, unsure / jnp.cos(grade))
    off, steps = joint.speed_scale * mean[SPEED], _CUT * _coarse(joint, state)
    tell("speed", mean[SPEED], rss(std[SPEED], off, steps, _LATE * (forces.accel[0] - mean[SLOPE])))
    tell("accel_x_bias", mean[BIAS], rss(std[BIAS], GRAVITY * ground))
    scale, scale_std = jnp.ones(()), joint.mass_std
    if "mass" in joint.along.states:
        scale = 1 / joint.along.lightness(mean)
        scale_std = scale**2 * std[joint.along.place("mass")]
        tell("mass", joint.forces.balance.car.mass * scale, joint.forces.balance.car.mass * scale_std)
    if "altitude" in joint.along.states:
        tell("altitude", mean[-2], std[-2])
    axles = by_axle(forces.load)
    # freed of the accelerometer's bias and place
    misread = (side[BIAS_Y] + side[LEVER] * forces.now.yaw_accel) / GRAVITY * axles
    lateral = forces.now.across - misread
    straight, straight_std = _along(joint, state, scale)
    stir = jnp.maximum(forces.stir - NOISY * axles, 0.0)
    # between samples that are sparse
    signals, inertial = state.signals, slice(ACCEL_X, ACCEL_Y + 1)
    held = jnp.abs(signals.steep[inertial]) * jnp.minimum(signals.age[inertial], STALE) / GRAVITY
    since = jnp.asarray(_HELD_ERROR, axles.dtype) * held
    leads = rss(jnp.asarray(_LEAD_ERROR, stir.dtype)[:, None] * stir, since[:, None] * axles)
    misread_std = rss(side_std[BIAS_Y], side_std[LEVER] * forces.now.yaw_accel) / GRAVITY * axles
    lasting = jnp.stack([jnp.sum(straight_std), jnp.sum(misread_std)])
    across, aside = _across(joint, state, jnp.sum(lateral))
    shaken = jnp.asarray(_SHAKEN, axles.dtype) * forces.shaken / GRAVITY
    used, used_std = _used(forces, straight, across, leads, lasting, shaken)
    late = 0.1 * jnp.minimum(state.signals.age[ACCEL_X], 10.0)
    tell("friction_used", used, rss(used_std, late, aside, forces.loads_std * used, ground))
    if joint.knows_sides:
        # tires tell how the axles move, but not where between them the middle is
        place = _CG_ERROR * joint.forces.balance.car.wheelbase
        tell("velocity_y", side[V_Y], rss(side_std[V_Y], place * state.signals.smooth[YAW_RATE]))
        bank = jnp.arcsin(jnp.clip(side[BANK] / GRAVITY, -0.99, 0.99))
        tell("bank", bank, side_std[BANK] / (GRAVITY * jnp.cos(bank)))
    along = scale * straight
    rolls = _ROLLS[0] * (mean[SPEED] / _ROLLS[1]) ** 4 * axles
    rough = rss(_ROUGH[0] * axles, shaken[0] * axles, _SHARED * straight, straight_std, rolls, ground * axles)
    along_std = rss(scale_std * straight, rough, parked(axles, mean[SPEED], forces.locking))
    unsure = 0.5 * by_axle(forces.along_std)
    spread = jnp.where(jnp.isfinite(unsure), unsure, 1.0) * axles
    across = scale * lateral
    rough = rss(_ROUGH[1] * axles, shaken[1] * axles, _CG_ERROR * jnp.sum(lateral))
    missing = jnp.where(jnp.isfinite(forces.across_std), forces.across_std, 1.0) * axles
    # steered while they stand, tires push aside whatever the balance says
    stands = parked(axles, mean[SPEED], jnp.zeros(()))
    across_std = rss(scale_std * lateral, rough, leads[1], misread_std, missing, stands)
    for i, where in enumerate(("front", "rear")):
        tell(f"force_x_{where}", along[i], rss(along_std[i], leads[0, i], spread[i]))
        if joint.knows_sides:
            tell(f"force_y_{where}", across[i], across_std[i])
    low, middle, high = state.friction
    wheels = joint.sharing.share(
        forces, Known(along, along_std, across, across_std, middle[1:3], scale, scale_std, mean[SPEED])
    )
    for i, where in enumerate(WHEELS):
        tell(f"force_x_{where}", wheels.along[i], wheels.along_std[i])
        if joint.knows_sides:
            tell(f"force_y_{where}", wheels.across[i], wheels.across_std[i])
            tell(f"load_{where}", wheels.load[i], wheels.load_std[i])
    spread = joint.bank.std(state.bank, middle)
    for i, view in enumerate(VIEWS):
        name = f"friction_peak{view}"
        tell(name, middle[i], spread[i])
        values[f"{name}_lower"], values[f"{name}_upper"] = low[i], high[i]
    return Estimate(values, stds, state.validity, faults)


def _ground(joint: Joint, mean: Array, std: Array) -> Array:
    """1σ of what may be the ground's resistance or the accelerometer's bias, over g."""
    if "resistance" not in joint.along.states or any(s in joint.sensors for s in _HEIGHTS):
        return jnp.zeros(())
    return unsettled(mean[BIAS], std[BIAS], joint.along.slow_factor[0, 0]) / GRAVITY


def _coarse(joint: Joint, state: JointState) -> Array:
    """In what steps the speed is told, m/s: by a signal, to which wheels are fitted, or by the wheels."""
    if "speed" in joint.channels:
        return joint.watch.step(state.watch, ("speed",))[0]
    wheels = [i for i, name in enumerate(WHEEL_SPEEDS) if name in joint.channels]
    steps = joint.watch.step(state.watch, [WHEEL_SPEEDS[i] for i in wheels])
    return jnp.mean(joint.forces.balance.car.wheel_radius[jnp.asarray(wheels)] * steps)


def _along(joint: Joint, state: JointState, scale: Array) -> tuple[Array, Array]:
    """(2,) F_x of the axles by torques and accelerometer, each as it is sure, over ``scale``, and 1σ of what
    lasts of its error, N.

    Torques tell small forces better, and large ones worse, for gains err in proportion; an accelerometer that
    is not mounted straight takes a part of a bend for thrust.
    """
    forces, mean, std = state.latest, state.along.gaussian.mean, state.along.gaussian.std
    measured, told, names = forces.now.along, forces.now.told, joint.along.states
    mass, speed = joint.forces.balance.car.mass, mean[SPEED]
    aside = std[names.index("mounting_yaw")] * forces.accel[1] if "mounting_yaw" in names else 0.0
    if "mass" not in names:
        lasting = rss(std[BIAS], std[SCALE] * forces.accel[0], aside, joint.along.air.std(speed))
        return measured, mass * lasting * by_axle(joint.forces.balance.driven)
    parts = {"drive_gain": forces.drive, "brake_gain": -forces.brake, "resistance": -forces.rolling}
    if "torque_zero" in names:
        parts["torque_zero"] = forces.lever
    figures, known = jnp.asarray([names.index(s) for s in parts]), jnp.stack(list(parts.values()))
    # every wheel rolls, driven or not
    bears = by_axle(forces.load) / jnp.sum(forces.load)
    noise = joint.inputs.white(state.unrest, forces) / (2 * SMOOTHING) ** 0.5
    # what changes fast is told badly, more so by torques, which come late
    gained = jnp.stack([jnp.sum(measured - by_axle(forces.along)), jnp.sum(told - by_axle(forces.told))])
    swift = jnp.asarray(_SWIFT, gained.dtype) * (gained / mass) ** 2
    fitted = _FITTED * 2 * SMOOTHING / joint.signals.memory[ACCEL_X]
    # what torques tell apart is by how much the accelerometer reads too high less what air resists more
    more, row = joint.along.headwind(mean, speed)
    felt = jnp.sum((row.at[BIAS].add(-1.0) @ state.along.gaussian.factor) ** 2)
    off = (std[figures] * known) ** 2
    lasting = jnp.stack([felt + aside**2, jnp.sum(off)])
    by_accel = fitted * noise[0] ** 2 + noise[2] ** 2 + lasting[0] + swift[0]
    by_torque = noise[1] ** 2 + swift[1] + lasting[1]
    size = jnp.abs(told) + LEAST_FORCE
    part = size / jnp.sum(size)
    shares = jnp.stack([bears if name == "resistance" else part for name in parts])
    # the sum is what it is
    learnt = mean[figures] * known
    measured = measured + mass * (more * part + learnt @ (shares - part))
    told = (told + mass * learnt @ shares) / scale
    # a torque that is silent or lies has no say
    share = jnp.where(forces.age < STALE, by_torque / (by_torque + by_accel), 1.0)
    weights = jnp.stack([share, 1 - share])
    unsure = jnp.stack([lasting[0] * part**2, off @ shares**2])
    return told + share * (measured - told), mass * root(weights**2 @ unsure)


def _across(joint: Joint, state: JointState, felt: Array) -> tuple[Array, Array]:
    """F_y of the whole car, N, and over its load 1σ of what is not known of it while no accelerometer tells.

    Then a gyroscope does, but for the road's bank: a car that does not begin to slide turns as it is pushed.
    """
    turns, ages = state.signals.smooth[YAW_RATE], state.signals.age
    unfelt = 0.1 * jnp.minimum(ages[ACCEL_Y], 3.0)
    if not joint.signals.has[YAW_RATE]:
        return felt, unfelt
    known = (ages[ACCEL_Y] >= STALE) & (ages[YAW_RATE] < STALE)
    pushed = jnp.sum(state.latest.load) / GRAVITY * state.along.gaussian.mean[SPEED] * turns
    banked = root(in_default(joint.bank.motion.first[BANK, BANK])) / GRAVITY
    return jnp.where(known, pushed, felt), jnp.where(known, rss(banked, _DRIFTS), unfelt)


def _used(
    forces: AxleForces, along: Array, across: Array, leads: Array, lasting: Array, shaken: Array
) -> tuple[Array, Array]:
    """Friction used by the whole car, and 1σ.

    Args:
        forces: of the axles.
        along: (2,) F_x of the axles, N.
        across: F_y of the car, N.
        leads, lasting: 1σ of what forces err by as they change, and for long, N.
        shaken: (2,) 1σ along and across, over its load, of what a rough road does to an axle's force.
    """
    load = jnp.sum(forces.load)
    parts = jnp.stack([jnp.sum(along), across]) / load
    used = rss(*parts)
    unsure = root(jnp.sum(leads**2) + jnp.sum(lasting**2)) / load
    # each axle by itself, and but what points where the force does
    heads = (parts**2 + _DIRECTED**2) / (used**2 + _DIRECTED**2)
    rough = 0.5 * jnp.sum(heads * shaken**2)
    return used, jnp.sqrt(0.0025**2 + (0.02 * used) ** 2 + unsure**2 + rough)
