"""Random road unevenness with the spectrum of ISO 8608."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from roadstate.core import InputError
from roadstate.core import numerics as numerics  # float64 before the first array
from roadstate.sim.roads.surface import Surface, smooth_across

Array = NDArray[np.floating[Any]]

REFERENCE_FREQUENCY = 0.1
"""n₀ in cycles/m."""
CLASSES = {"A": 16e-6, "B": 64e-6, "C": 256e-6, "D": 1024e-6, "E": 4096e-6}
"""Geometric mean of G_d(n₀) in m³ by class (ISO 8608:2016, annex C)."""
LOWEST, HIGHEST = 0.011, 2.83
"""Range of spatial frequencies in cycles/m (ISO 8608:2016, annex C)."""
_STEP = 0.05  # m between the rows: seven to the shortest wave
_SPACING = 0.25  # m between the lines
_LARGEST = 20_000_000  # knots of a surface
_BLOCK = 4_000_000  # numbers in a temporary array
_NODES = 241  # of the integral that is the coherence


def displacement_psd(frequency: Array, road_class: str) -> Array:
    """G_d(n) = G_d(n₀)(n/n₀)⁻², one-sided, in m³ (ISO 8608:2016, annex C).

    Args:
        frequency: n, any shape, cycles/m.
        road_class: ``A`` to ``E``.

    Raises:
        InputError: another class.
    """
    if road_class not in CLASSES:
        raise InputError(f"no road class '{road_class}'", mend=f"choose {', '.join(CLASSES)}")
    return CLASSES[road_class] * (frequency / REFERENCE_FREQUENCY) ** -2.0


def coherence(frequency: Array, distance: Array) -> Array:
    """Cross spectrum over spectrum of two parallel tracks, for a surface that is alike in all directions.

    For G_d ∝ n⁻² it is x K₁(x) with x = 2πn·distance: the two-dimensional spectrum that gives n⁻² along every
    line is ∝ (n_s² + n_d²)^(−3/2), whose transform over n_d this is (the isotropy hypothesis: Dodds & Robson,
    *J. Sound Vib.* 31, 1973, with the exponent of ISO 8608).

    Args:
        frequency: n, cycles/m.
        distance: between the tracks, m.
    """
    x = 2 * np.pi * np.abs(frequency * distance)
    # K₁(x) = ∫₀^∞ exp(−x cosh t) cosh t dt: the trapezoidal rule converges faster than any power
    t = np.linspace(0.0, 12.0, _NODES)
    weight = np.full(t.shape, t[1])
    weight[0] /= 2
    safe = np.maximum(x, 1e-3)[..., None]
    K1 = np.sum(np.exp(-safe * np.cosh(t)) * np.cosh(t) * weight, axis=-1)
    return np.where(x < 1e-3, 1.0, x * K1)


def rough_surface(
    road_class: str, seed: int, length: float, width: float = 8.0, step: float = _STEP
) -> Surface:
    """A random surface, periodic along the road, of the same spectrum along every line.

    Each frequency has an independent complex normal amplitude at every line, correlated across lines by
    :func:`coherence`; slopes at the knots are those of the sum of waves itself.

    Args:
        road_class: ``A`` (very good) to ``E`` (very poor), of which the geometric mean is taken.
        seed: same seed, same surface.
        length: of a period, m; at least 100 to hold the longest wave.
        width: from the right to the left line, m, centred.
        step: between rows, m.

    Raises:
        InputError: another class, or a surface too small or too large.
    """
    rows, lines = round(length / step), round(width / _SPACING) + 1
    if not (length >= 100 and lines >= 2):
        raise InputError(
            f"a rough surface of {length:g} × {width:g} m", mend="give 100 m of length, 0.25 m of width"
        )
    if rows * lines > _LARGEST:
        raise InputError(
            f"a rough surface of {length:g} × {width:g} m is too large", mend="shorten its period"
        )
    period = rows * step
    frequency = np.arange(rows // 2 + 1) / period
    used = np.flatnonzero((frequency >= LOWEST) & (frequency <= HIGHEST))
    n = frequency[used]
    psd = displacement_psd(n, road_class)
    distance = _SPACING * np.arange(lines)
    rng = np.random.default_rng(seed)
    normal = rng.standard_normal((2, len(used), lines))
    amplitude = 0.5 * np.sqrt(psd / period)[:, None]
    waves = np.zeros((rows // 2 + 1, lines), complex)
    index = np.abs(np.arange(lines)[:, None] - np.arange(lines))
    # a covariance per frequency: those of a long and wide surface would not fit into memory at once
    count = max(_BLOCK // (lines * max(lines, _NODES)), 1)
    for k in (slice(first, first + count) for first in range(0, len(used), count)):
        by_distance = coherence(n[k, None], distance)
        factor = np.linalg.cholesky(by_distance[:, index] + 1e-9 * np.eye(lines))
        waves[used[k]] = amplitude[k] * np.einsum("kij,kj->ki", factor, normal[0, k] + 1j * normal[1, k])
    height = np.fft.irfft(waves, rows, axis=0) * rows
    slope = np.fft.irfft(waves * (2j * np.pi * frequency[:, None]), rows, axis=0) * rows
    return Surface(
        knots=jnp.asarray(smooth_across(np.stack([height, slope * step], axis=-1), level_edges=True)),
        start=jnp.asarray(0.0),
        right=jnp.asarray(-0.5 * float(distance[-1])),
        step=jnp.asarray(step),
        spacing=jnp.asarray(_SPACING),
        wraps=True,
    )
