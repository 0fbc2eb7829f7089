"""The Kalman filter, in square-root form."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
from jaxtyping import Array, Float

from roadstate.core.gaussian import Gaussian, Info
from roadstate.core.kernel import once
from roadstate.filters.base import FilterState, GateRule, GaussianFilter, Moved
from roadstate.linalg import product
from roadstate.statespace import StateSpaceModel


def linearize(
    function: Callable[[Float[Array, " n"]], Float[Array, " m"]], x: Float[Array, " n"]
) -> tuple[Float[Array, " m"], Float[Array, "m n"]]:
    """Value and Jacobian of ``function`` at ``x``, from one evaluation."""

    def twice(point: Float[Array, " n"]) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
        value = function(point)
        return value, value

    jacobian, value = jax.jacfwd(twice, has_aux=True)(x)
    return value, jacobian


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
        (moved, F), noise = once((linearize(lambda x: model.f(x, u, dt), mean), model.sqrt_Q(u, dt)))
        return Moved(moved, factor, product(F, factor), (noise,))

    def update(
        self, model: StateSpaceModel, state: FilterState, u: Any, z: Float[Array, " m"]
    ) -> tuple[FilterState, Info]:
        """Measurement update."""
        mean, factor = state.gaussian.mean, state.gaussian.factor
        z_hat, H = linearize(lambda x: model.h(x, u), mean)
        return self._condition(state, z, z_hat, factor, product(H, factor), model.sqrt_R(u))
