"""TFOBE's lower layer: 15 states, 7 sensors (paper 002, eqs. 25 to 31, drag in SI)."""

from __future__ import annotations

from typing import Any

import numpy as np
from benchmarks.peers.problems import Array, Problem

MASS, YAW_INERTIA, TO_FRONT, TO_REAR, TRACK = 1412.0, 1536.7, 1.015, 1.895, 1.675
RADIUS, WHEEL_INERTIA, DRAG = 0.325, 0.9, 0.5 * 1.206 * 0.65
DT = 0.01
CONSTANTS = (MASS, YAW_INERTIA, TO_FRONT, TO_REAR, TRACK, RADIUS, WHEEL_INERTIA, DRAG)
_SUBSTEPS = 10


def body(xp: Any, x: Any, u: Any) -> tuple[Any, Any, Any]:
    """a_x, a_y and ṙ under the tire forces in x; u is δ, 4 drive and 4 brake torques."""
    cos, sin = xp.cos(u[0]), xp.sin(u[0])
    force_x, force_y = x[7:11], x[11:15]
    front_x, front_y = force_x[:2] * cos - force_y[:2] * sin, force_x[:2] * sin + force_y[:2] * cos
    along = front_x[0] + front_x[1] + force_x[2] + force_x[3]
    across = front_y[0] + front_y[1], force_y[2] + force_y[3]
    twist = front_x[1] - front_x[0] + force_x[3] - force_x[2]
    return (
        (along - DRAG * x[0] * x[0]) / MASS,
        (across[0] + across[1]) / MASS,
        (TO_FRONT * across[0] - TO_REAR * across[1] + 0.5 * TRACK * twist) / YAW_INERTIA,
    )


def f(xp: Any, x: Any, u: Any, dt: Any) -> Any:
    """Explicit Euler; the forces stay."""
    a_x, a_y, yaw_accel = body(xp, x, u)
    rates = xp.stack([a_x + x[1] * x[2], a_y - x[0] * x[2], yaw_accel])
    spin = (u[1:5] - u[5:9] - RADIUS * x[7:11]) / WHEEL_INERTIA
    return xp.concatenate([x[:3] + dt * rates, x[3:7] + dt * spin, x[7:]])


def h(xp: Any, x: Any, u: Any) -> Any:
    """a_x, a_y, r and the wheel speeds."""
    a_x, a_y, _ = body(xp, x, u)
    return xp.concatenate([xp.stack([a_x, a_y]), x[2:7]])


def _drive(steps: int) -> tuple[Array, Array]:
    """Inputs (T, 9), true states (T, 15) of a car with stiff linear tires, driven up and down the gears."""
    t = np.arange(steps) * DT
    torque = 180 * np.sin(2 * np.pi * t / 23) + 60
    inputs = np.zeros((steps, 9))
    inputs[:, 0] = 0.03 * np.sin(2 * np.pi * t / 4) * (1 + np.sin(2 * np.pi * t / 31))
    inputs[:, 1:3] = np.maximum(torque, 0)[:, None]
    inputs[:, 5:9] = np.maximum(-torque, 0)[:, None] * np.array([0.6, 0.6, 0.4, 0.4])
    place_x = np.array([TO_FRONT, TO_FRONT, -TO_REAR, -TO_REAR])
    place_y = 0.5 * TRACK * np.array([1, -1, 1, -1])
    v_x, v_y, r, omega = 20.0, 0.0, 0.0, np.full(4, 20.0 / RADIUS)
    states, h_ = np.empty((steps, 15)), DT / _SUBSTEPS
    force = np.zeros((2, 4))
    for k, u in enumerate(inputs):
        steer = np.array([u[0], u[0], 0, 0])
        for _ in range(_SUBSTEPS):
            w_x, w_y = v_x - r * place_y, v_y + r * place_x
            along = w_x * np.cos(steer) + w_y * np.sin(steer)
            angle = steer - np.arctan2(w_y, w_x)
            force = np.stack([6e4 * (RADIUS * omega - along) / along, 5e4 * angle])
            a_x, a_y, yaw_accel = body(np, np.concatenate([[v_x], np.zeros(6), *force]), u)
            v_x, v_y, r = v_x + h_ * (a_x + v_y * r), v_y + h_ * (a_y - v_x * r), r + h_ * yaw_accel
            omega = omega + h_ * (u[1:5] - u[5:9] - RADIUS * force[0]) / WHEEL_INERTIA
        states[k] = np.concatenate([[v_x, v_y, r], omega, *force])
    return inputs, states


def problem(steps: int = 11_000) -> Problem:
    """One drive at 100 Hz with noisy sensors."""
    inputs, states = _drive(steps)
    r = np.array([0.05, 0.05, 0.002, 0.05, 0.05, 0.05, 0.05])
    seen = np.stack([h(np, x, u) for x, u in zip(states, inputs, strict=True)])
    return Problem(
        name="tfobe-lower-ukf",
        method="ukf",
        f=f,
        h=h,
        q=np.array([0.02, 0.02, 0.002, *[0.02] * 4, *[30.0] * 4, *[30.0] * 4]),
        r=r,
        mean=np.concatenate([states[0, :7], np.zeros(8)]),
        std=np.array([0.5, 0.2, 0.05, *[0.5] * 4, *[500.0] * 8]),
        inputs=inputs,
        samples=seen + r * np.random.default_rng(2).standard_normal(seen.shape),
        dt=DT,
        linear=tuple(range(3, 15)),
    )
