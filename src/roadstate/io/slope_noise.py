"""How well the slope of a straight line is known when the heights' noise wanders."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_EXACT = 100  # samples; for longer lines the exact factors are those of this many, scaled


@dataclass(frozen=True)
class Lines:
    """Straight lines fitted to heights in windows, one per entry.

    Attributes:
        slope: (N,) rise over run.
        scatter: (N,) Σ(s − s̄)² in m².
        residual: (N,) Σe², residuals e in m, in m².
        roughness: (N,) Σ(eᵢ₊₁ − eᵢ)² in m².
        span: (N,) last place less first, in m.
        count: (N,) number of samples.
    """

    slope: Array
    scatter: Array
    residual: Array
    roughness: Array
    span: Array
    count: NDArray[np.int64]

    def __getitem__(self, rows: NDArray[np.bool_]) -> Lines:
        return Lines(
            self.slope[rows],
            self.scatter[rows],
            self.residual[rows],
            self.roughness[rows],
            self.span[rows],
            self.count[rows],
        )


def slope_std(lines: Lines, resolution: float) -> Array:
    """Standard error of each slope.

    The heights' noise is taken as white noise of variance r plus a random walk of intensity q per metre: the
    error of a GNSS or barometric height wanders, and a walk looks like road where white noise does not. Both
    are found from all lines together by the method of moments, since Σe² and Σ(Δe)² weigh them differently
    (the latter over the former is Durbin and Watson's statistic, *Biometrika* 37, 1950). What the line cannot
    follow of the road itself counts as walk, so the figure errs on the large side where the road undulates
    within a window. For many samples over a span W the variance of the slope is r/Σ(s − s̄)² + 6/5 q/W.

    Args:
        lines: (N,) fits, all of at least 4 samples.
        resolution: step in which the heights come, in m; r is at least resolution²/12.

    Returns:
        (N,) rise over run.
    """
    if not len(lines.count):
        return np.zeros(0)
    known, rows = np.unique(lines.count, return_inverse=True)
    white_residual, walk_residual, white_roughness, walk_roughness, walk_slope = np.array(
        [_factors(int(n)) for n in known]
    ).T[:, rows]
    total = np.array([lines.residual.sum(), lines.roughness.sum()])
    moments = np.array(
        [
            [white_residual.sum(), (walk_residual * lines.span).sum()],
            [white_roughness.sum(), (walk_roughness * lines.span).sum()],
        ]
    )
    white, walk = np.linalg.solve(moments, total)
    if white < 0:  # smoother than any walk
        white, walk = 0.0, total[0] / moments[0, 1]
    elif walk < 0:  # rougher than white
        white, walk = total[0] / moments[0, 0], 0.0
    white = max(white, resolution**2 / 12)
    std: Array = np.sqrt(white / lines.scatter + walk * walk_slope / lines.span)
    return std


@lru_cache(maxsize=_EXACT)
def _exact_factors(count: int) -> tuple[float, float, float, float, float]:
    """What unit noise does to a line through evenly spaced samples over a unit span.

    Returns:
        E Σe² for white noise and for a walk, E Σ(Δe)² for both, variance of the slope for a walk.
    """
    x = np.linspace(-0.5, 0.5, count)
    design = np.stack([np.ones(count), x], axis=1)
    remove = np.eye(count) - design @ np.linalg.pinv(design)
    walk = np.minimum.outer(np.arange(count), np.arange(count)) / (count - 1)
    differ = np.diff(np.eye(count), axis=0) @ remove
    return (
        count - 2.0,
        float(np.trace(remove @ walk @ remove)),
        float(np.trace(differ @ differ.T)),
        float(np.trace(differ @ walk @ differ.T)),
        float(x @ walk @ x / (x @ x) ** 2),
    )


def _factors(count: int) -> tuple[float, float, float, float, float]:
    if count <= _EXACT:
        return _exact_factors(count)
    _, walk_residual, _, walk_roughness, walk_slope = _exact_factors(_EXACT)
    return count - 2.0, walk_residual * count / _EXACT, 2.0 * (count - 1), walk_roughness, walk_slope
