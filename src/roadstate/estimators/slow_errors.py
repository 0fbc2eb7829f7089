"""Errors of car and sensors that last, as motion along the road tells of them."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.estimators.tire_forces import BRAKE_RELATIVE

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_ACCEL_SCALE = 0.01  # 1σ of the accelerometer's scale
_RADIUS = 3.0  # times what the file says may the radius err that a speed is there to correct
_LASTING = 3600.0  # s over which what belongs to the car or its sensors keeps its value
_BRAKE_LASTING = 600.0  # s: pads warm up
_BRAKE_TOLD = 0.05  # 1σ of a brake's torque that the car tells, as a share: pads are not measured
# s for which the wind lasts, as it and what shelters from it change; rad of turning that make it another
WIND = (300.0, 2.0)
_TURNS = 0.03  # rad/s by which a car is taken to turn where no yaw rate tells: round a corner every 50 s
_SLIP = (0.5, 1.0)  # 1σ of what wheels slip beyond their force, as a share of that, and s for which it lasts
LATE = (0.06, 0.04)  # s by which a receiver's speed is late: mean and 1σ


def slow_errors(
    vehicle: Vehicle, available: Collection[str], torque_of: Literal["wheels", "engine"] | None
) -> dict[str, tuple[float, float]]:
    """1σ of each error before anything tells of it, and s for which it lasts.

    Args:
        vehicle: its prior and its sensors.
        available: channels.
        torque_of: what the torque that drives the car is told of, if it is.
    """
    prior, sensors = vehicle.prior, vehicle.sensors
    wheels = any(f"wheel_speed_{w}" in available for w in WHEELS)
    tilt = sensors.accel.bias / GRAVITY  # the bias is mostly one of mounting
    slow = {
        "accel_x_bias": (sensors.accel.bias, _LASTING),
        "accel_x_scale": (float(np.hypot(GRAVITY * prior.pitch_gradient_std, _ACCEL_SCALE)), _LASTING),
    }
    if "accel_y" in available:
        slow["mounting_yaw"] = (tilt, _LASTING)
    if "pitch_rate" in available:
        slow["lean_gradient"] = (prior.pitch_gradient_std, _LASTING)
        slow["pitch_rate_bias"] = (sensors.yaw_rate.bias, _LASTING)
        slow["roll_gradient"] = (prior.pitch_gradient_std, _LASTING)
        slow["mounting_roll"] = (tilt, _LASTING)
    if wheels:
        slow["slip_factor"] = _SLIP
    if torque_of is not None:
        at_wheels = torque_of == "wheels"
        torque = sensors.wheel_torque if at_wheels else sensors.engine_torque
        measured = any(c.startswith("brake_torque") for c in available)
        slow["mass"] = (prior.mass_relative, _LASTING)
        slow["drive_gain"] = (torque.relative, _LASTING)
        told = max(torque.relative, _BRAKE_TOLD)
        slow["brake_gain"] = (told if measured else BRAKE_RELATIVE, _BRAKE_LASTING)
        slow["drag_area"] = (prior.drag_relative, _LASTING)
        turns = 0.0 if "yaw_rate" in available else _TURNS
        slow["wind"] = (prior.wind_std, 1 / (1 / WIND[0] + turns / WIND[1]))
        zero = _as_resistance(vehicle, torque.bias) if at_wheels else 0.0
        slow["resistance"] = (float(np.hypot(prior.rolling_resistance_std, zero)), _LASTING)
        if not at_wheels:  # low gears multiply what an engine's torque is off by
            slow["torque_zero"] = (torque.bias, _LASTING)
    if wheels and "speed" in available:
        slow["wheel_radius"] = (_RADIUS * sensors.wheel_speed.scale, _LASTING)
    if "speed" in available:
        slow["speed_lag"] = (LATE[1], _LASTING)
    return slow


def slow_factor(std: dict[str, float]) -> NDArray[np.float64]:
    """Lower-triangular; a body that leans more than the file says tilts the accelerometer, too."""
    factor, names = np.diag(np.array(list(std.values()))), list(std)
    if "lean_gradient" in names:
        scale, lean = names.index("accel_x_scale"), names.index("lean_gradient")
        share = GRAVITY * std["lean_gradient"] / std["accel_x_scale"]
        factor[lean, [scale, lean]] = std["lean_gradient"] * np.array([share, np.sqrt(1 - share**2)])
    return factor


def _as_resistance(vehicle: Vehicle, bias: float) -> float:
    """Which coefficient of rolling resistance does as much as 1σ of each driven wheel's constant error."""
    driven = sum(vehicle.driveline.drives)
    return float(driven**0.5 * bias / (vehicle.wheels.radius * vehicle.mass * GRAVITY))
