"""The contract of a filter, and what the Gaussian ones share."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from roadstate.core.gaussian import Gate, Gaussian, Info, Reason
from roadstate.core.traced import returned
from roadstate.linalg import correct, product, tria
from roadstate.statespace import StateSpaceModel

T = TypeVar("T")
LOG_2PI = 1.8378770664093453


class FilterState(NamedTuple):
    """State of a Gaussian filter.

    Attributes:
        gaussian: x̂ and a factor of P.
        rejected: (m,) how many samples of each sensor the gate has refused in a row.
    """

    gaussian: Gaussian
    rejected: Int[Array, " m"]


@returned
class Moved(NamedTuple):
    """A Gaussian carried through f, as deviations: P = X Xᵀ, Cov(x⁺, x) = X⁺ Xᵀ, P⁺ = X⁺ X⁺ᵀ + N Nᵀ.

    Attributes:
        mean: (n,) x̂⁺.
        before: (n, k) X.
        after: (n, k) X⁺, what becomes of the same columns.
        noise: N, blocks of n rows: √Q, and what f adds that is uncorrelated with x.
    """

    mean: Float[Array, " n"]
    before: Float[Array, "n k"]
    after: Float[Array, "n k"]
    noise: tuple[Float[Array, "n _"], ...]


class GateRule(eqx.Module):
    """Refuses a sensor's sample whose squared Mahalanobis distance ν²/S exceeds a χ² quantile (1 degree).

    A sensor refused ``patience`` times in a row is believed again, since by then it is likelier that the
    filter is wrong than the sensor; so a gate can never lock a filter out.

    Attributes:
        threshold: χ² quantile; 10.83 refuses 1 good sample in 1000, 15.14 in 10 000, 19.51 in 100 000.
        patience: refusals in a row after which the next sample is taken whatever it says.
    """

    threshold: float = eqx.field(default=19.51, static=True)
    patience: int = eqx.field(default=10, static=True)

    def __check_init__(self) -> None:
        """Refuse a rule that no sample, or every one, would pass."""
        if not self.threshold > 0:
            raise ValueError(f"threshold must be positive, got {self.threshold}")
        if self.patience < 1:
            raise ValueError(
                f"patience must be at least 1, got {self.patience}; gate=None takes every sample"
            )

    def __call__(
        self, squared: Float[Array, " m"], present: Bool[Array, " m"], rejected: Int[Array, " m"]
    ) -> tuple[Bool[Array, " m"], Int[Array, " m"], Int[Array, " m"]]:
        """``(used, codes, rejected)``: which samples to take, their :class:`Gate` codes, the new counters."""
        outside = present & ~(squared <= self.threshold)
        refuse = outside & (rejected < self.patience)
        used = present & ~refuse
        codes = jnp.where(present, jnp.where(refuse, Gate.REJECTED, Gate.PASSED), Gate.NOT_TESTED)
        counter = jnp.where(refuse, rejected + 1, jnp.where(present, 0, rejected))
        return used, codes, counter


def examine(
    gate: GateRule | None,
    innovation: Float[Array, " m"],
    variance: Float[Array, " m"],
    rejected: Int[Array, " m"],
) -> tuple[Bool[Array, " m"], Int[Array, " m"], Int[Array, " m"]]:
    """Which samples to take: those that are there and pass the gate, if there is one.

    Args:
        gate: ``None`` takes every sample.
        innovation: (m,) z − ẑ, NaN where the sample is missing.
        variance: (m,) of the innovation.
        rejected: (m,) how many samples of each sensor were refused in a row.

    Returns:
        ``(used, codes, rejected)`` as of :class:`GateRule`.
    """
    present = jnp.isfinite(innovation)
    if gate is None:
        return present, jnp.full(innovation.shape, Gate.NOT_TESTED), rejected
    return gate(jnp.where(present, innovation, 0) ** 2 / variance, present, rejected)


def is_finite(gaussian: Gaussian) -> Bool[Array, ""]:
    """Whether a Gaussian is free of NaN and infinity."""
    return jnp.all(jnp.isfinite(gaussian.mean)) & jnp.all(jnp.isfinite(gaussian.factor))


def select(condition: Bool[Array, ""], one: T, other: T) -> T:
    """One state or the other, which are built alike."""
    return cast(T, jax.tree.map(lambda a, b: jnp.where(condition, a, b), one, other))


S = TypeVar("S")


class Filter(eqx.Module, Generic[S]):
    """A filter: pure functions on a state ``S`` that is any pytree.

    ``NaN`` in a measurement means that this sensor has no sample now; what is there is used.
    """

    name: ClassVar[str]

    @abstractmethod
    def init(self, model: StateSpaceModel) -> S:
        """The state before the first sample."""

    @abstractmethod
    def predict(self, model: StateSpaceModel, state: S, u: Any, dt: Float[Array, ""]) -> S:
        """Move Δt ahead (time update)."""

    @abstractmethod
    def update(self, model: StateSpaceModel, state: S, u: Any, z: Float[Array, " m"]) -> tuple[S, Info]:
        """Take the samples ``z`` (measurement update)."""

    @abstractmethod
    def posterior(self, state: S) -> Gaussian:
        """Mean and covariance of the state now."""

    def step(
        self, model: StateSpaceModel, state: S, u: Any, z: Float[Array, " m"], dt: Float[Array, ""]
    ) -> tuple[S, Info]:
        """Predict over Δt, then update; where the prediction is not finite (as with an input that is not),
        the state stays as it was and ``Info.ok`` is false.
        """
        ahead = self.predict(model, state, u, dt)
        finite = self._is_finite(ahead)
        updated, info = self._update_if(finite, model, select(finite, ahead, state), u, z)
        reason = jnp.where(finite, info.reason, Reason.NOT_FINITE)
        return updated, replace(info, ok=info.ok & finite, reason=reason)

    def _is_finite(self, state: S) -> Bool[Array, ""]:
        """Whether a predicted state is free of NaN and infinity."""
        return is_finite(self.posterior(state))

    def _update_if(
        self, sound: Bool[Array, ""], model: StateSpaceModel, state: S, u: Any, z: Float[Array, " m"]
    ) -> tuple[S, Info]:
        """:meth:`update`, whose state counts only where ``sound``: else it stays as it is."""
        updated, info = self.update(model, state, u, z)
        return select(sound, updated, state), info


class GaussianFilter(Filter[FilterState]):
    """What the square-root Gaussian filters share: how deviations become a Gaussian and an :class:`Info`."""

    gate: eqx.AbstractVar[GateRule | None]

    @abstractmethod
    def move(self, model: StateSpaceModel, gaussian: Gaussian, u: Any, dt: Float[Array, ""]) -> Moved:
        """What f makes of a Gaussian over Δt, as this filter approximates it."""

    def init(self, model: StateSpaceModel) -> FilterState:
        """The model's prior, with clear gates."""
        return FilterState(model.prior(), jnp.zeros(len(model.sensors), jnp.int32))

    def predict(
        self, model: StateSpaceModel, state: FilterState, u: Any, dt: Float[Array, ""]
    ) -> FilterState:
        """Time update."""
        moved = self.move(model, state.gaussian, u, dt)
        return FilterState(Gaussian(moved.mean, tria(moved.after, *moved.noise)), state.rejected)

    def posterior(self, state: FilterState) -> Gaussian:
        """The Gaussian held."""
        return state.gaussian

    def _condition(
        self,
        state: FilterState,
        z: Float[Array, " m"],
        z_hat: Float[Array, " m"],
        state_rows: Float[Array, "n k"],
        sensor_rows: Float[Array, "m k"],
        sqrt_R: Float[Array, "m q"],
    ) -> tuple[FilterState, Info]:
        innovation = jnp.where(jnp.isfinite(z), z - z_hat, jnp.nan)
        S = product(sensor_rows, sensor_rows.T) + product(sqrt_R, sqrt_R.T)
        used, codes, rejected = examine(self.gate, innovation, jnp.diagonal(S), state.rejected)
        result = correct(state_rows, sensor_rows, sqrt_R, innovation, used)
        posterior = Gaussian(state.gaussian.mean + result.delta, result.factor)
        finite = is_finite(posterior)
        posterior = select(finite, posterior, state.gaussian)
        any_used = jnp.any(used)
        reason = jnp.where(finite, jnp.where(any_used, Reason.OK, Reason.NO_MEASUREMENT), Reason.NOT_FINITE)
        count = jnp.sum(used)
        return FilterState(posterior, rejected), Info(
            innovation=innovation,
            S=S,
            nis=result.nis,
            log_likelihood=-0.5 * (result.nis + result.log_det + count * LOG_2PI),
            gate=codes,
            ok=finite,
            reason=reason,
        )
