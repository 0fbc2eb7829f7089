"""The Rauch–Tung–Striebel smoother for every Gaussian filter, in square-root form."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from roadstate.core.gaussian import Gaussian, Info
from roadstate.core.numerics import jit_loop
from roadstate.dense import solve_upper
from roadstate.filters.base import Filter, FilterState, GaussianFilter, Moved
from roadstate.linalg import product, tria
from roadstate.statespace import StateSpaceModel

_GROUND = 64.0
"""What is left of a row counts as nothing below this many of its rounding errors."""


class Smoothed(NamedTuple):
    """Result of :func:`smooth`, over T samples.

    Attributes:
        means: (T, n) of x given all samples.
        factors: (T, n, n) lower-triangular factors of its covariance.
        filtered: means (T, n) and factors (T, n, n) given the samples up to then.
        infos: what the filter told of each step, leaves with a leading axis T.
    """

    means: Float[Array, "T n"]
    factors: Float[Array, "T n n"]
    filtered: Gaussian
    infos: Info

    @property
    def std(self) -> Float[Array, "T n"]:
        """(T, n) standard deviations given all samples."""
        return jnp.sqrt(jnp.sum(self.factors**2, axis=-1))


def smooth(
    model: StateSpaceModel,
    filter: GaussianFilter,
    inputs: Any,
    measurements: Float[Array, "T m"],
    dt: Float[Array, " T"],
) -> Smoothed:
    """Mean and covariance of each state given all samples, before and after it.

    With the filter's own picture of a step, P = X Xᵀ, x⁺ − x̂⁺ = X⁺ w + N v (:class:`Moved`), one
    triangularisation

        [[X⁺, N], [X, 0]] Θ = [[L₁₁, 0], [L₂₁, L₂₂]]

    yields the gain G = L₂₁ L₁₁⁻¹ = P_{x x⁺} (P⁺)⁻¹ and L₂₂, a factor of what x⁺ leaves open, from which
    x̂ˢ = x̂ + G(x̂ˢ₊ − x̂⁺) and Pˢ = L₂₂ L₂₂ᵀ + G Pˢ₊ Gᵀ follow without a difference of covariances (Rauch,
    Tung & Striebel 1965; Särkkä, *Bayesian Filtering and Smoothing*, ch. 8 and 10, for the unscented one).
    Directions of x⁺ without uncertainty teach nothing and are left out of G. A step that the filter refused,
    for an input that is not finite, counts as no step, as it does there.

    Args:
        model: of n states and m sensors.
        filter: any Gaussian filter.
        inputs: u of each sample, a pytree with leading axis T, or ``None``.
        measurements: (T, m), NaN where missing.
        dt: (T,) time in s since the sample before; the first belongs to the prior.
    """
    return cast(Smoothed, _smooth(model, filter, inputs, measurements, dt))


@jit_loop
def _smooth(model: StateSpaceModel, filter: GaussianFilter, inputs: Any, measurements: Any, dt: Any) -> Any:
    def forth(state: Any, row: Any) -> Any:
        u, z, step = row
        new, info = filter.step(model, state, u, z, step)
        return new, (filter.posterior(new), info)

    def back(later: Gaussian, row: tuple[Gaussian, Any, Any]) -> tuple[Gaussian, Gaussian]:
        now, u, step = row
        smoothed = look_back(now, _or_no_step(filter.move(model, now, u, step), now), later)
        return smoothed, smoothed

    _, (filtered, infos) = jax.lax.scan(forth, filter.init(model), (inputs, measurements, dt))
    last = jax.tree.map(lambda a: a[-1], filtered)
    before = jax.tree.map(lambda a: a[:-1], filtered)
    steps = jax.tree.map(lambda a: a[1:], (inputs, dt))
    _, rest = jax.lax.scan(back, last, (before, *steps), reverse=True)
    whole = jax.tree.map(lambda a, b: jnp.concatenate([a, b[None]]), rest, last)
    return Smoothed(whole.mean, whole.factor, filtered, infos)


class Recorded(NamedTuple):
    """State of a :class:`Recorder`.

    Attributes:
        gaussian, rejected: as :class:`~roadstate.filters.base.FilterState`.
        moved: the step that led here, from the posterior before; ``None`` where none was taken.
    """

    gaussian: Gaussian
    rejected: Int[Array, " m"]
    moved: Moved | None


class Recorder(Filter[Recorded]):
    """A Gaussian filter that keeps with its state what it made of the last step.

    In place of the filter of a larger system it lets that system be smoothed by :func:`look_back`, whatever
    goes into the filter's inputs.

    Attributes:
        filter: that does the work.
    """

    filter: GaussianFilter

    def init(self, model: StateSpaceModel) -> Recorded:
        """The filter's; no step was taken."""
        return Recorded(*self.filter.init(model), None)

    def predict(self, model: StateSpaceModel, state: Recorded, u: Any, dt: Float[Array, ""]) -> Recorded:
        """The filter's."""
        moved = _or_no_step(self.filter.move(model, state.gaussian, u, dt), state.gaussian)
        return Recorded(*self.filter.predict(model, _plain(state), u, dt), moved)

    def update(
        self, model: StateSpaceModel, state: Recorded, u: Any, z: Float[Array, " m"]
    ) -> tuple[Recorded, Info]:
        """The filter's."""
        new, info = self.filter.update(model, _plain(state), u, z)
        return Recorded(*new, state.moved), info

    def step(
        self, model: StateSpaceModel, state: Recorded, u: Any, z: Float[Array, " m"], dt: Float[Array, ""]
    ) -> tuple[Recorded, Info]:
        """The filter's."""
        moved = _or_no_step(self.filter.move(model, state.gaussian, u, dt), state.gaussian)
        new, info = self.filter.step(model, _plain(state), u, z, dt)
        return Recorded(*new, moved), info

    def posterior(self, state: Recorded) -> Gaussian:
        """The Gaussian held."""
        return state.gaussian


def _plain(state: Recorded) -> FilterState:
    return FilterState(state.gaussian, state.rejected)


def look_back(now: Gaussian, moved: Moved, later: Gaussian) -> Gaussian:
    """What is known of x by the samples up to then and by what is known of x⁺: one step of the smoother.

    Args:
        now: x given the samples up to then.
        moved: what the filter made of it.
        later: x⁺ given all samples.
    """
    top = jnp.concatenate([moved.after, *moved.noise], axis=1)
    bottom = jnp.pad(moved.before, ((0, 0), (0, top.shape[1] - moved.before.shape[1])))
    upper, lower, rest = _reduce(top, bottom)
    # a zero pivot has a column of zeros: any number will do on the diagonal
    pivots = jnp.diagonal(upper)
    upper = upper + jnp.diag(jnp.where(pivots > 0, 0, 1).astype(pivots.dtype))
    gain = solve_upper(upper, lower.T).T
    mean = now.mean + product(gain, (later.mean - moved.mean)[:, None])[:, 0]
    return Gaussian(mean, tria(jnp.concatenate([rest, product(gain, later.factor)], axis=1)))


def _reduce(
    top: Float[Array, "n k"], bottom: Float[Array, "n k"]
) -> tuple[Float[Array, "n n"], Float[Array, "n n"], Float[Array, "n k"]]:
    """L₁₁, L₂₁ and L₂₂ (unreduced), by modified Gram–Schmidt over the rows on top.

    Not by :func:`tria`: where a row depends on those before it, Householder's pivot is a rounding error and
    its direction anything, whereas here the direction is left out altogether.
    """
    n = top.shape[0]
    both = jnp.concatenate([top, bottom])
    least = (_GROUND * float(np.finfo(top.dtype).eps)) ** 2 * jnp.sum(top**2, axis=1)

    def along_row(i: Any, now: tuple[Array, Array]) -> tuple[Array, Array]:
        both, L = now
        square = jnp.sum(both[i] ** 2)
        sound = square > least[i]
        direction = both[i] * jnp.where(sound, 1 / jnp.sqrt(jnp.where(sound, square, 1)), 0)
        column = both @ direction
        return both - jnp.outer(column, direction), L.at[:, i].set(column)

    both, L = jax.lax.fori_loop(0, n, along_row, (both, jnp.zeros((2 * n, n), top.dtype)))
    return jnp.tril(L[:n]), L[n:], both[n:]


def _or_no_step(moved: Moved, gaussian: Gaussian) -> Moved:
    finite = jnp.asarray(True)
    for part in (moved.mean, moved.after, *moved.noise):
        finite &= jnp.all(jnp.isfinite(part))
    return Moved(
        mean=jnp.where(finite, moved.mean, gaussian.mean),
        before=moved.before,
        after=jnp.where(finite, moved.after, moved.before),
        noise=tuple(jnp.where(finite, block, 0) for block in moved.noise),
    )
