"""The Kalman filter, in square-root form."""

from __future__ import annotations

from typing import Any, ClassVar

import equinox as eqx
import jax
from jaxtyping import Array, Float

from roadstate.core.gaussian import Gaussian, Info
from roadstate.core.kernel import once
from roadstate.filters.base import FilterState, GateRule, GaussianFilter, Moved
from roadstate.linalg import product
from roadstate.statespace import StateSpaceModel


class KF(GaussianFilter):
    """Kalman filter for a model whose f and h are affine in x (they may depend on u and Δt at will).

    Time update x̂ = f(x̂), P = F P Fᵀ + Q; measurement update K = P Hᵀ S⁻¹, P = (I − K H) P, both by
    orthogonal triangularisation (Kailath, Sayed & Hassibi, *Linear Estimation*, ch. 12). F and H come from f
    and h by automatic differentiation, which for an affine model is exact.

    Attributes:
        gate: innovation gate, or ``None`` to take every sample.
    """

    name: ClassVar[str] = "kf"
    gate: GateRule | None = eqx.field(default=None, kw_only=True)

    def move(self, model: StateSpaceModel, gaussian: Gaussian, u: Any, dt: Float[Array, ""]) -> Moved:
        """f, linearised at the mean."""
        mean, factor = gaussian.mean, gaussian.factor
        u = once(u)
        moved, F, noise = once((model.f(mean, u, dt), jax.jacfwd(model.f)(mean, u, dt), model.sqrt_Q(u, dt)))
        return Moved(moved, factor, product(F, factor), (noise,))

    def update(
        self, model: StateSpaceModel, state: FilterState, u: Any, z: Float[Array, " m"]
    ) -> tuple[FilterState, Info]:
        """Measurement update."""
        mean, factor = state.gaussian.mean, state.gaussian.factor
        H = jax.jacfwd(model.h)(mean, u)
        return self._condition(state, z, model.h(mean, u), factor, product(H, factor), model.sqrt_R(u))
