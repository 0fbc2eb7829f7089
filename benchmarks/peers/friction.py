"""Friction of four wheels from a_x, a_y and ṙ, with Dugoff's tire: 4 states, 3 sensors."""

from __future__ import annotations

from typing import Any

import numpy as np
from benchmarks.peers.problems import Method, Problem

MASS, YAW_INERTIA, TO_FRONT, TO_REAR, TRACK = 1412.0, 1536.7, 1.015, 1.895, 1.675
DT = 0.01


def f(xp: Any, x: Any, u: Any, dt: Any) -> Any:
    """μ wanders."""
    return x


def h(xp: Any, x: Any, u: Any) -> Any:
    """Specific forces and ṙ; u is δ, C_κσ_x (4), C_ασ_y (4) and F_z (4)."""
    cos, sin = xp.cos(u[0]), xp.sin(u[0])
    stiff_x, stiff_y = u[1:5], u[5:9]
    adhesive = xp.sqrt(stiff_x * stiff_x + stiff_y * stiff_y)
    ratio = xp.minimum(0.5 * x * u[9:13] / adhesive, 1.0)
    held = ratio * (2 - ratio)
    force_x, force_y = held * stiff_x, held * stiff_y
    front_x, front_y = force_x[:2] * cos - force_y[:2] * sin, force_x[:2] * sin + force_y[:2] * cos
    along = front_x[0] + front_x[1] + force_x[2] + force_x[3]
    across = front_y[0] + front_y[1], force_y[2] + force_y[3]
    twist = front_x[1] - front_x[0] + force_x[3] - force_x[2]
    return xp.stack(
        [
            along / MASS,
            (across[0] + across[1]) / MASS,
            (TO_FRONT * across[0] - TO_REAR * across[1] + 0.5 * TRACK * twist) / YAW_INERTIA,
        ]
    )


def problem(method: Method = "ukf", steps: int = 11_000) -> Problem:
    """A road whose friction falls from 0.8 to 0.4 and back, under hard steering and driving."""
    t = np.arange(steps) * DT
    rng = np.random.default_rng(3)
    sway, push = np.sin(2 * np.pi * t / 3), np.sin(2 * np.pi * t / 7 + 1)
    phase = np.arange(4) * 0.05
    load = 3400 + 900 * np.stack([-sway, sway, -sway, sway], 1) - 300 * push[:, None] * [1, 1, -1, -1]
    stiff_y = 4500 * np.sin(2 * np.pi * t[:, None] / 3 - phase)
    stiff_x = 2500 * np.sin(2 * np.pi * t[:, None] / 7 + 1 - phase)
    inputs = np.concatenate([0.05 * sway[:, None], stiff_x, stiff_y, load], 1)
    friction = np.where((t // 20) % 2 == 0, 0.8, 0.4)[:, None] * [1.0, 1.0, 1.05, 1.05]
    r = np.array([0.1, 0.1, 0.1])
    seen = np.stack([h(np, x, u) for x, u in zip(friction, inputs, strict=True)])
    return Problem(
        name="friction-pf-1000" if method == "pf" else "friction-ukf",
        method=method,
        f=f,
        h=h,
        q=np.full(4, 0.005),
        r=r,
        mean=np.full(4, 0.9),
        std=np.full(4, 0.2),
        inputs=inputs,
        samples=seen + r * rng.standard_normal(seen.shape),
        dt=DT,
        particles=1000 if method == "pf" else 0,
    )
