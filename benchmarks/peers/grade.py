"""Grade from speed and accelerometer (KMBE): a linear system of two states and one sensor."""

from __future__ import annotations

from typing import Any

import numpy as np
from benchmarks.peers.problems import Problem

DT = 0.01


def f(xp: Any, x: Any, u: Any, dt: Any) -> Any:
    """v_x and g sin θ under the specific force u."""
    return xp.stack([x[0] + dt * (u[0] - x[1]), x[1]])


def h(xp: Any, x: Any, u: Any) -> Any:
    """v_x."""
    return x[:1]


def problem(steps: int = 11_000) -> Problem:
    """A hilly road at a wandering speed."""
    t = np.arange(steps) * DT
    rng = np.random.default_rng(4)
    speed = 20 + 5 * np.sin(2 * np.pi * t / 40)
    gravity = 9.81 * 0.05 * np.sin(2 * np.pi * t / 60)
    specific = np.gradient(speed, DT) + gravity + 0.1 * rng.standard_normal(steps)
    return Problem(
        name="kf-2",
        method="kf",
        f=f,
        h=h,
        q=np.array([0.001, 0.005]),
        r=np.array([0.1]),
        mean=np.array([20.0, 0.0]),
        std=np.array([0.5, 0.5]),
        inputs=specific[:, None],
        samples=(speed + 0.1 * rng.standard_normal(steps))[:, None],
        dt=DT,
    )
