"""The marginalised unscented Kalman filter: sigma points only where there is curvature."""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.core.gaussian import Gaussian, Info
from roadstate.core.kernel import once
from roadstate.filters.base import FilterState, Moved
from roadstate.filters.ukf import UKF
from roadstate.statespace import StateSpaceModel


class _Image(NamedTuple):
    """What a function y makes of x = x̂ + S w, w ~ N(0, I): y ≈ mean + rows w + extra v.

    Attributes:
        mean: (m,).
        rows: (m, n) Cov(y, x) S⁻ᵀ.
        extra: (m, k) factor of what is uncorrelated with x.
    """

    mean: Float[Array, " m"]
    rows: Float[Array, "m n"]
    extra: Float[Array, "m k"]


class MarginalUKF(UKF):
    """Unscented Kalman filter that draws sigma points only for the states that enter nonlinearly.

    With x = (a, b), f and h affine in b given a (``model.nonlinear`` names a), and the lower-triangular
    factor S = [[S_aa, 0], [S_ba, S_bb]] of P, S_bb is the factor of the covariance of b given a, and the
    sigma points of a, each with the mean that b has given it, are x̂ ± c · (the first columns of S). So 2l + 1
    points are needed, not 2n + 1, and the rest goes through ∂f/∂b S_bb (Morelande & Moran 2007). States of a
    model are best ordered with a first: l counts up to the last state of a.

    Deviations d± of a pair of points enter as (d+ − d−)/√2, which is all that is correlated with x, and
    (d+ + d−)/√2, which vanishes without curvature; so P_xz = S rowsᵀ with S as it stands.

    By default ∂f/∂b is taken at the mean of a, as the full filter in effect does, from which it differs by
    terms of fourth order in S. With ``exact`` it is taken at
    every point of a: then its mean and its variation over a, E[∂f/∂b S_bb S_bbᵀ ∂f/∂bᵀ], are as exact as the
    points are, which the full filter neglects. This costs 2l(n − l) more columns.

    Attributes:
        alpha, beta, kappa: of the points of a; l + κ must be positive.
        exact: take the linear part at every point.
        gate: innovation gate, or ``None`` to take every sample.

    Raises:
        ValueError: parameters that :class:`~roadstate.filters.ukf.UKF` refuses; in :meth:`init`, l + κ ≤ 0
            or a nonlinear state that the model does not have.
    """

    name: ClassVar[str] = "marginal-ukf"
    exact: bool = eqx.field(default=False, static=True, kw_only=True)

    def init(self, model: StateSpaceModel) -> FilterState:
        """The model's prior, with clear gates."""
        unknown = ", ".join(sorted(set(model.nonlinear) - set(model.states)))
        if unknown:
            raise ValueError(f"nonlinear names {unknown}, which the model has no state for")
        count = _leading(model)
        if count and not count + self.kappa > 0:
            raise ValueError(f"kappa must exceed -{count} with {count} nonlinear states, got {self.kappa}")
        return FilterState(model.prior(), jnp.zeros(len(model.sensors), jnp.int32))

    def move(self, model: StateSpaceModel, gaussian: Gaussian, u: Any, dt: Float[Array, ""]) -> Moved:
        """f at the points of the nonlinear states."""
        u = once(u)
        image = self._image(lambda x: model.f(x, u, dt), gaussian, _leading(model))
        return Moved(image.mean, gaussian.factor, image.rows, (image.extra, model.sqrt_Q(u, dt)))

    def update(
        self, model: StateSpaceModel, state: FilterState, u: Any, z: Float[Array, " m"]
    ) -> tuple[FilterState, Info]:
        """Measurement update."""
        seen = self._image(lambda x: model.h(x, u), state.gaussian, _leading(model))
        noise = jnp.concatenate([model.sqrt_R(u), seen.extra], axis=1)
        return self._condition(state, z, seen.mean, state.gaussian.factor, seen.rows, noise)

    def _image(
        self, function: Callable[[Float[Array, " n"]], Float[Array, " m"]], gaussian: Gaussian, count: int
    ) -> _Image:
        mean, factor = gaussian.mean, gaussian.factor
        spread = self.alpha * sqrt(count + self.kappa) if count else 1.0
        offsets = spread * factor[:, :count].T
        points = jnp.concatenate([mean[None], mean + offsets, mean - offsets])
        straight = factor[:, count:].T

        def sloped(x: Float[Array, " n"]) -> tuple[Float[Array, " m"], Float[Array, "k m"]]:
            value, slope = jax.linearize(function, x)
            return value, jax.vmap(slope)(straight)

        if not self.exact:
            values = self._pairs(once(jax.vmap(function)(points)), spread)
            rows = jnp.concatenate([values.odd, sloped(mean)[1]])
            return _Image(values.mean, rows.T, values.even.T)
        values, slopes = (self._pairs(part, spread) for part in once(jax.vmap(sloped)(points)))
        rows = jnp.concatenate([values.odd, slopes.mean])
        wavering = jnp.concatenate([slopes.odd, slopes.even]).reshape(-1, rows.shape[1])
        return _Image(values.mean, rows.T, jnp.concatenate([values.even, wavering]).T)


def _leading(model: StateSpaceModel) -> int:
    """How many states there are up to the last nonlinear one."""
    return max((model.states.index(name) + 1 for name in model.nonlinear), default=0)
