"""The part of a vertical axis to show first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def view_limits(
    lines: Array, bands: Array, *, at_least: float = 0.0, with_bands: bool = False
) -> tuple[float, float]:
    """Vertical limits such that one wild sample does not flatten all others.

    All is shown unless it lies further from the central 98 % of the lines than that is wide.

    Args:
        lines: heights of the lines on the figure, finite, one at least.
        bands: heights of the bands' limits, finite, may be empty.
        at_least: least half-width about zero to show, in the figure's unit.
        with_bands: whether the bands' limits say as much as the lines.

    Returns:
        Low and high, with a margin.
    """
    everything = np.concatenate([lines, bands])
    q_low, q_high = (float(q) for q in np.percentile(everything if with_bands else lines, [1, 99]))
    reach = max(q_high - q_low, at_least)
    low = max(float(np.min(everything)), q_low - reach)
    high = min(float(np.max(everything)), q_high + reach)
    if at_least:
        low, high = min(low, -at_least), max(high, at_least)
    pad = 0.06 * (high - low) or max(0.05 * abs(high), 1e-3)
    return low - pad, high + pad


def unit_label(unit: str) -> str:
    """A unit as people write it: ``m/s^2`` → ``m/s²``, ``N*m`` → ``N·m``."""
    return unit.replace("^2", "²").replace("*", "·")


def out_of_view(lines: Array, low: float, high: float) -> str:
    """A note that says how far lines reach beyond the limits; empty where all are inside."""
    least, most = float(np.min(lines)), float(np.max(lines))
    beyond = [f"{v:.4g}" for v, out in ((least, least < low), (most, most > high)) if out]
    if not beyond:
        return ""
    reached = " and ".join(beyond)
    return f"Extremes out of view: the lines reach {reached}; the figure's zoom-out tool shows them."
