"""What samples can tell of a state, and what they cannot: along a drive, for any state-space model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.typing import NDArray

from roadstate.core.numerics import jit_loop
from roadstate.filters.weighted import masked
from roadstate.linalg import solve_lower
from roadstate.statespace import StateSpaceModel

_NAMED = 0.2
"""Share of a direction's largest part below which a state is not named."""


def empirical_gramian(
    model: StateSpaceModel,
    states: Float[Array, "T n"],
    inputs: Any,
    dt: Float[Array, " T"],
    spread: Float[Array, "n n"],
    *,
    window: int | None = None,
    every: int = 1,
    present: Bool[Array, "T m"] | None = None,
) -> Float[Array, "K n n"]:
    """Empirical observability Gramians of windows along a drive, in units of what is uncertain beforehand.

    From each start, x is moved by ± each column of ``spread`` and run through f without noise;
    W_ij = Σ_k ¼ (y_k⁺ⁱ − y_k⁻ⁱ)ᵀ R⁻¹ (y_k⁺ʲ − y_k⁻ʲ) (Lall, Marsden & Glavaški 2002; Krener & Ide 2009).
    Steps of the size of the uncertainty, not infinitesimal ones, see what saturates within it. W is
    information over prior information: an eigenvalue of 1 means that the window's samples tell as much of a
    direction as was known before. There is no process noise: what drifts while it is estimated is known less
    well than W says; :func:`~roadstate.cramer_rao.cramer_rao_bound` accounts for that.

    Args:
        model: of n states and m sensors.
        states: (T, n) the drive: true states, or estimates.
        inputs: u of each sample, a pytree with leading axis T, or ``None``.
        dt: (T,) s since the sample before.
        spread: (n, n) factor of the covariance before the window, or (n,) standard deviations.
        window: samples in a window; all by default.
        every: samples from one window's start to the next.
        present: (T, m) which samples there are; all by default.

    Returns:
        (K, n, n), one for each whole window.

    Raises:
        ValueError: a window or stride that the drive does not hold.
    """
    total = len(states)
    length = total if window is None else window
    if not 0 < length <= total or every < 1:
        raise ValueError(f"windows of {length} samples, every {every}, do not fit {total} samples")
    there = jnp.ones((total, len(model.sensors)), bool) if present is None else jnp.asarray(present)
    factor = jnp.diag(jnp.asarray(spread)) if jnp.ndim(spread) == 1 else jnp.asarray(spread)
    starts = jnp.arange(0, total - length + 1, every)
    log = jnp.asarray(states), inputs, jnp.asarray(dt), there
    return cast(Array, _gramians(model, log, factor, starts, length))


@jit_loop
def _gramians(model: StateSpaceModel, log: Any, factor: Array, starts: Array, length: int) -> Any:
    def one(start: Array) -> Array:
        states, *rest = jax.tree.map(lambda a: jax.lax.dynamic_slice_in_dim(a, start, length), log)
        moved = jnp.concatenate([states[0] + factor.T, states[0] - factor.T])

        def step(x: Array, row: Any) -> tuple[Array, Array]:
            first, (u, dt, used) = row
            x = jnp.where(first, x, jax.vmap(lambda x: model.f(x, u, dt))(x))
            seen = jax.vmap(lambda x: model.h(x, u))(x)
            ahead, behind = jnp.split(jnp.where(used, seen, 0), 2)
            noise = masked(model.sqrt_R(u), used)
            return x, jax.vmap(lambda v: solve_lower(noise, v))((ahead - behind) / 2)

        first = jnp.arange(length) == 0
        _, told = jax.lax.scan(step, moved, (first, tuple(rest)))
        return jnp.einsum("kim,kjm->ij", told, told)

    return jax.lax.map(one, starts)


@dataclass(frozen=True)
class Direction:
    """A combination of states, and what samples leave of its uncertainty.

    Attributes:
        change: state → how far it moves for one prior standard deviation along the direction, in its unit.
        remaining: share of the prior standard deviation that remains, 1 for a direction no sample tells of.
        words: the same, in words.
    """

    change: dict[str, float]
    remaining: float
    words: str


def directions(
    states: Sequence[str], gramian: NDArray[Any] | Array, spread: NDArray[Any] | Array
) -> list[Direction]:
    """The independent directions of state space, those that samples tell least of first.

    Eigenvectors of W, the eigenvalues λ of which leave 1/√(1 + λ) of the prior standard deviation.

    Args:
        states: n names.
        gramian: (n, n) W of :func:`empirical_gramian`.
        spread: (n, n) or (n,) as given there.
    """
    W, S = np.asarray(gramian, float), _factor(spread)
    eigenvalues, vectors = np.linalg.eigh((W + W.T) / 2)
    size = np.linalg.norm(S, axis=1)
    found = []
    for value, vector in zip(np.clip(eigenvalues, 0, None), vectors.T, strict=True):
        upwards = vector * np.sign(vector[np.argmax(np.abs(vector))])
        change = dict(zip(states, (S @ upwards).tolist(), strict=True))
        remaining = float(1 / np.sqrt(1 + value))
        found.append(Direction(change, remaining, _in_words(change, size, remaining)))
    return found


def unobservable(
    states: Sequence[str],
    gramian: NDArray[Any] | Array,
    spread: NDArray[Any] | Array,
    *,
    remaining: float = 0.9,
) -> list[Direction]:
    """The directions of which samples leave at least the share ``remaining`` of the prior uncertainty.

    Args:
        states: n names.
        gramian: (n, n) W of :func:`empirical_gramian`.
        spread: (n, n) or (n,) as given there.
        remaining: share of the prior standard deviation from which a direction counts as unobservable.
    """
    return [d for d in directions(states, gramian, spread) if d.remaining >= remaining]


def remaining_share(gramian: NDArray[Any] | Array, spread: NDArray[Any] | Array) -> NDArray[np.float64]:
    """Share of each state's prior standard deviation that samples leave: √diag(S(I + W)⁻¹Sᵀ)/√diag(S Sᵀ).

    Args:
        gramian: (…, n, n) W of :func:`empirical_gramian`.
        spread: (n, n) or (n,) as given there.

    Returns:
        (…, n), 0 for a state without uncertainty.
    """
    W, S = np.asarray(gramian, float), _factor(spread)
    left = np.linalg.solve(np.eye(len(S)) + W, S.T)
    variance = np.einsum("ij,...ji->...i", S, left)
    prior = np.sum(S**2, axis=1)
    share: NDArray[np.float64] = np.divide(variance, prior, out=np.zeros_like(variance), where=prior > 0)
    return np.sqrt(share)


def _factor(spread: NDArray[Any] | Array) -> NDArray[np.float64]:
    S = np.asarray(spread, float)
    return np.diag(S) if S.ndim == 1 else S


def _in_words(change: dict[str, float], size: NDArray[np.float64], remaining: float) -> str:
    relative = {
        name: abs(step) / std if std > 0 else 0.0
        for (name, step), std in zip(change.items(), size, strict=True)
    }
    named = [name for name, part in relative.items() if part >= _NAMED * max(relative.values())]
    named.sort(key=lambda name: -relative[name])
    if len(named) == 1:
        what = f"{named[0]} alone"
    else:
        moves = [
            f"{name} {'up' if change[name] > 0 else 'down'} by {abs(change[name]):.3g}" for name in named
        ]
        what = " with ".join([moves[0], " and ".join(moves[1:])])
    return f"{what}: the samples leave {100 * remaining:.3g} % of the prior 1σ"
