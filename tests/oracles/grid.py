"""Bayes' rule on a fine grid of one state."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def grid_filter(
    f: Callable[[Array, float], Array],
    h: Callable[[Array], Array],
    q: float,
    r: float,
    mean: float,
    std: float,
    inputs: Array,
    samples: Array,
    grid: Array,
) -> tuple[Array, Array, Array]:
    """Means, standard deviations and log-likelihoods (T,) of x⁺ = f(x, u) + q w, z = h(x) + r v."""
    width = grid[1] - grid[0]
    density = np.exp(-0.5 * ((grid - mean) / std) ** 2)
    density /= density.sum() * width
    out = []
    for u, z in zip(inputs, samples, strict=True):
        kernel = np.exp(-0.5 * ((grid[:, None] - f(grid, u)) / q) ** 2) / (q * np.sqrt(2 * np.pi))
        density = kernel @ density * width
        log_likelihood = 0.0
        if np.isfinite(z):
            density = density * np.exp(-0.5 * ((z - h(grid)) / r) ** 2) / (r * np.sqrt(2 * np.pi))
            total = density.sum() * width
            log_likelihood = float(np.log(total))
            density = density / total
        m = (grid * density).sum() * width
        out.append((m, np.sqrt(((grid - m) ** 2 * density).sum() * width), log_likelihood))
    means, stds, logs = np.array(out).T
    return means, stds, logs
