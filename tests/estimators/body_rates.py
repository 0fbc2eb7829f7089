"""What a gyroscope in a turning body reads."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from roadstate.sim.plant.vectors import rotation


def body_rates(yaw: float, pitch: float, roll: float, rates: tuple[float, float, float]) -> np.ndarray:
    """Roll, pitch and yaw rate about the body's axes, from the change of its rotation matrix."""
    step = 1e-6
    ahead, behind = (
        np.asarray(rotation(jnp.asarray(np.array([yaw, pitch, roll]) + side * step * np.array(rates))))
        for side in (0.5, -0.5)
    )
    spin = ((ahead + behind) / 2).T @ (ahead - behind) / step
    return np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
