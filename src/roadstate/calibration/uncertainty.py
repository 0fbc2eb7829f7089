"""How well data determine parameters, where the filter's model of their errors is not exact."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from roadstate.calibration.parameters import Parameter

Numbers = NDArray[np.float64]
Mask = NDArray[np.bool_]

BLOCK = 10.0
"""Seconds of a block, over which errors of the filter's model may be correlated."""
WEAK = 0.7
"""Share of the prior standard deviation from which on a parameter counts as undetermined."""
HARDLY = "hardly shows in these data"
_CLOSE = 0.5  # correlation of errors from which on a parameter is named beside another


def dispersion(scores: Sequence[Numbers], times: Sequence[Numbers]) -> Numbers:
    """(p, p) covariance of the sum of scores, from their sums over blocks of time.

    Scores of a filter whose model is not exact are correlated; sums over blocks much longer than that lasts
    are not (Newey & West 1987, Econometrica 55, 703–708, to the same end).

    Args:
        scores: of each log (p, T).
        times: of each log (T,), s.
    """
    sums = []
    for score, time in zip(scores, times, strict=True):
        count = max(round((time[-1] - time[0]) / BLOCK), 1)
        # where a break is longer than a block, there are some without any sample
        edges = np.unique(np.searchsorted(time, np.linspace(time[0], time[-1], count + 1)[:-1]))
        sums.append(np.add.reduceat(score, edges, axis=1))
    blocks = np.concatenate(sums, axis=1)
    count = blocks.shape[1]
    blocks = blocks - blocks.mean(axis=1, keepdims=True)
    result: Numbers = blocks @ blocks.T * count / max(count - 1, 1)
    return result


def covariance(
    H: Numbers, J: Numbers, active: Mask, *, use_prior: bool = True, beside: Numbers | None = None
) -> Numbers:
    """(a, a) covariance of the a active parameters' estimates, in prior standard deviations.

    M⁻¹ (J + P + H_ac H_ca + B Bᵀ) M⁻¹ with M = H + P: White's sandwich (1982, Econometrica 50, 1–25), the
    error of the prior P = I where it is used, and that of the parameters c which are not learned but kept at
    the file's values, and of others in the file (Schmidt's *consider* parameters; Bierman, *Factorization
    Methods*, ch. VIII). Where J is less than H, H is taken: few blocks may look alike by chance.

    Args:
        H: (p, p) information of all parameters.
        J: (p, p) of :func:`dispersion`.
        active: (p,).
        use_prior: whether the estimates are a posteriori.
        beside: B, (p, b) by how much the gradient changes with 1σ of each of b other figures in the file.
    """
    own = H[np.ix_(active, active)]
    prior = np.eye(len(own)) if use_prior else np.zeros_like(own)
    cross = H[np.ix_(active, ~active)]
    inverse = np.linalg.pinv(own + prior)
    if beside is not None:
        cross = np.hstack([cross, beside[active]])
    spread = _at_least(J[np.ix_(active, active)], own) + prior + cross @ cross.T
    result: Numbers = inverse @ spread @ inverse
    return result


def _at_least(J: Numbers, H: Numbers) -> Numbers:
    """J with no direction in which it is less than H: its excess over H, without what is negative."""
    values, vectors = np.linalg.eigh(J - H)
    result: Numbers = H + (vectors * np.maximum(values, 0.0)) @ vectors.T
    return result


def unseen(H: Numbers) -> list[int]:
    """Parameters whose 1σ would remain more than :data:`WEAK` of the prior's if all others were known.

    Args:
        H: (p, p) information, in prior standard deviations.
    """
    return [int(i) for i in np.flatnonzero(1 / (1 + np.diag(H)) > WEAK**2)]


def undetermined(H: Numbers, J: Numbers, parameters: Sequence[Parameter], active: Mask) -> dict[int, str]:
    """Active parameters whose 1σ remains more than :data:`WEAK` of the prior's, and why.

    One after another, the worst first: without it, the others may be determined.

    Args:
        H, J, active: as of :func:`covariance`.
        parameters: all of them.
    """
    found: dict[int, str] = {}
    left = active.copy()
    while left.any():
        places = np.flatnonzero(left)
        C = covariance(H, J, left)
        std = np.sqrt(np.diag(C))
        worst = int(std.argmax())
        if std[worst] <= WEAK:
            break
        share = np.abs(C[worst]) / (std * std[worst])
        share[worst] = 0.0
        others = [parameters[places[k]].name for k in np.flatnonzero(share >= _CLOSE)]
        found[int(places[worst])] = f"shows only together with {' and '.join(others)}" if others else HARDLY
        left[places[worst]] = False
    return found
