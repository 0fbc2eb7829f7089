"""What steered wheels do to the balance of forces: they hold back, the outer one more."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.core import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.estimators.contact_forces import ForceMeter
from roadstate.estimators.intake import ACCEL_X, ACCEL_Y, SPIN, STEER, YAW_RATE, Signals
from roadstate.estimators.load_transfer import Lean
from roadstate.vehicles import Vehicle

SPEED, FRONT, REAR = 5.0, 2400.0, 1700.0  # m/s, N


def splayed(vehicle: Vehicle, steer: float, load: np.ndarray) -> float:
    """N by which the outer front tire pushes more, half the way between parallel and Ackermann's wheels: each
    is then off by a quarter of δ² b/L, at the tire's own stiffness."""
    off = 0.25 * steer**2 * vehicle.geometry.track_front / vehicle.wheelbase
    return float(vehicle.tires.cornering_stiffness_rear * off * (load[0] + load[1]))


@pytest.mark.parametrize("way", [1, -1], ids=["forward", "backward"])
@pytest.mark.parametrize("steer", [0.3, -0.3, 0.02])
def test_the_outer_front_wheel_holds_back_more(vehicle: Vehicle, steer: float, way: int) -> None:
    """Forces of four tires, added up as a free body's, come out again as sums of the axles; backward what the
    steering's geometry does is turned round."""
    car, side = vehicle.geometry, np.sign(steer)
    meter = ForceMeter(vehicle, [f"drive_torque_{w}" for w in WHEELS])
    sine, cosine = np.sin(steer), np.cos(steer)
    lateral = side * (FRONT * cosine + REAR) / vehicle.mass
    load = np.asarray(meter.balance.loads(jnp.zeros(()), jnp.asarray(lateral)))
    more = abs(load[1] - load[0]) / (load[0] + load[1]) * FRONT + way * splayed(vehicle, steer, load)
    outer, inner = side * 0.5 * (FRONT + more), side * 0.5 * (FRONT - more)
    aside = np.array([inner, outer] if side > 0 else [outer, inner])
    rolls = way * float(meter.balance.car.rolling_coefficient(jnp.asarray(SPEED))) * load
    across = np.array([*(aside * cosine - rolls[:2] * sine), side * REAR / 2, side * REAR / 2])
    along = np.array([*(-aside * sine - rolls[:2] * cosine), *-rolls[2:]])
    ahead = np.array([car.cg_to_front_axle] * 2 + [-car.cg_to_rear_axle] * 2)
    moment = float(np.sum(ahead * across - np.array(car.half_tracks) * along))
    trail = way * 0.03 * (1 - abs(np.sum(across)) / vehicle.mass / GRAVITY)
    moment -= trail * float(np.sum(across))
    told = _told(meter, vehicle, np.sum(along), np.sum(across), moment, steer, way * SPEED)
    np.testing.assert_allclose(told, side * np.array([FRONT, REAR]), atol=0.01 * REAR)
    if abs(steer) > 0.1 and way > 0:
        # by so much that 5 % of the rear axle's force would else seem to be the front one's
        assert abs(np.diff(aside * sine)[0]) * car.track_front / 2 / vehicle.wheelbase > 0.05 * REAR


def _told(
    meter: ForceMeter,
    vehicle: Vehicle,
    along: float,
    across: float,
    moment: float,
    steer: float,
    speed: float,
) -> np.ndarray:
    """F_y of the axles that accelerometer and gyroscope tell of such a sum and moment at a steady speed: a
    slope makes up for what holds the car back."""
    drag = float(meter.balance.car.drag(jnp.asarray(speed)))
    zero = jnp.zeros(8)
    accel = (along - drag) / vehicle.mass
    value = zero.at[ACCEL_X].set(accel).at[ACCEL_Y].set(across / vehicle.mass).at[STEER].set(steer)
    value = value.at[SPIN].set(speed / vehicle.wheels.radius)
    turning = moment / vehicle.yaw_inertia
    half_tracks = jnp.asarray(np.array(vehicle.geometry.half_tracks))
    rate = zero.at[YAW_RATE].set(turning).at[SPIN].set(-half_tracks * turning / vehicle.wheels.radius)
    signals = Signals(
        value, zero, jnp.ones(8, bool), value, rate, zero, zero, value, rate, jnp.zeros(2), jnp.zeros(8, bool)
    )
    sample = {c: jnp.zeros(()) for c in meter.channels}
    state = meter.init()._replace(lean=Lean.upright())
    _, forces = meter.read(
        state, sample, signals, jnp.asarray(speed), jnp.zeros(2), jnp.asarray(accel), jnp.zeros(3),
        jnp.ones(()), jnp.asarray(0.01),
    )  # fmt: skip
    return np.asarray(forces.across)
