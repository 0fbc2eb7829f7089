"""Adaptive filters: they learn the measurement noise from what the samples say of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from roadstate.core.gaussian import Gate, Gaussian, Info
from roadstate.filters.averages import Average, AverageState, Window, unbiased
from roadstate.filters.base import Filter
from roadstate.filters.ekf import EKF
from roadstate.filters.noise import WithNoise
from roadstate.filters.spectral import spectral
from roadstate.filters.ukf import UKF
from roadstate.linalg import product
from roadstate.statespace import StateSpaceModel


class AdaptiveState(NamedTuple):
    """State of an :class:`AdaptiveNoise` filter.

    Attributes:
        filter: the state of the filter inside.
        average: means of the deviations and of R̂'s samples, in the sensors' nominal standard deviations.
    """

    filter: Any
    average: AverageState


class AdaptiveNoise(Filter[AdaptiveState]):
    """Any Gaussian filter, with the measurement noise R learned while it runs.

    Residual form: with ε = z − ẑ⁺ the residual and P_zz⁺ = Σ w_c (z_i⁺ − ẑ⁺)(z_i⁺ − ẑ⁺)ᵀ the covariance of
    the measurement predicted from the posterior (HP⁺Hᵀ for an EKF), E[εεᵀ] = R − P_zz⁺, so

        R̂ = mean(εεᵀ + P_zz⁺),

    positive semidefinite whatever the data (paper 000 eqs. 47–49, of which eq. 49 adds a matrix to a
    vector; Mohamed & Schwarz 1999; Akhlaghi, Zhou & Huang 2017). Innovation form: R̂ = mean(νν ᵀ − P_zz⁻) with
    ν = z − ẑ⁻ (Mehra 1972), cheaper, unbiased only as far as P⁻ is, and in need of its floor. The mean is
    over a :class:`~roadstate.filters.averages.Window`, or fading as in Sage and Husa's filter with
    :class:`~roadstate.filters.averages.Forgetting`. R̂ from the samples before is used for the next one.

    What is learned is a factor on the model's own R, which may change from sample to sample; a sensor that
    has shown fewer than ``minimum`` samples keeps the model's R. Q is not learned: from one innovation
    sequence R and Q cannot be told apart in general, and a Sage–Husa Q̂ loses definiteness.

    Attributes:
        filter: the Gaussian filter inside. If it has a gate, samples the gate refuses teach nothing.
        average: how samples are averaged.
        statistic: ``"residual"`` or ``"innovation"``.
        centered: take variances about the average's own mean, so that samples which all point the same way
            (a state that is wrong) do not count as noise; false is the paper's form.
        full: learn correlations between sensors too (from samples in which none is missing).
        minimum: samples of a sensor before its R̂ is believed.
        floor: least R̂, as a multiple of the model's R (variance).
        ceiling: largest R̂, likewise.
        excited: ``excited(model, x, u)`` says whether the sample may teach; ``None`` is always. A method
            ``Model.excited(self, x, u)`` fits as it stands.
    """

    filter: Filter[Any] = eqx.field(kw_only=True)
    average: Average = eqx.field(default=Window(50), kw_only=True)
    statistic: Literal["residual", "innovation"] = eqx.field(default="residual", static=True, kw_only=True)
    centered: bool = eqx.field(default=True, static=True, kw_only=True)
    full: bool = eqx.field(default=False, static=True, kw_only=True)
    minimum: int = eqx.field(default=20, static=True, kw_only=True)
    floor: float = eqx.field(default=1e-2, static=True, kw_only=True)
    ceiling: float = eqx.field(default=1e4, static=True, kw_only=True)
    excited: Callable[[Any, Float[Array, " n"], Any], Bool[Array, ""]] | None = eqx.field(
        default=None, static=True, kw_only=True
    )

    def __check_init__(self) -> None:
        """Refuse a choice that cannot work."""
        if self.statistic not in ("residual", "innovation"):
            raise ValueError(f"statistic must be 'residual' or 'innovation', got {self.statistic!r}")
        if not 0 < self.floor <= 1 <= self.ceiling:
            raise ValueError(f"floor ≤ 1 ≤ ceiling is needed, got {self.floor} and {self.ceiling}")

    def init(self, model: StateSpaceModel) -> AdaptiveState:
        """The model's prior and its R."""
        m = len(model.sensors)
        shape = (1 + m, m) if self.full else (2, m)
        return AdaptiveState(self.filter.init(model), self.average.init(shape, model.prior().mean.dtype))

    def predict(
        self, model: StateSpaceModel, state: AdaptiveState, u: Any, dt: Float[Array, ""]
    ) -> AdaptiveState:
        """Time update of the filter inside."""
        return state._replace(filter=self.filter.predict(model, state.filter, u, dt))

    def update(
        self, model: StateSpaceModel, state: AdaptiveState, u: Any, z: Float[Array, " m"]
    ) -> tuple[AdaptiveState, Info]:
        """Measurement update with the R̂ of the samples before, then learn."""
        nominal = model.sqrt_R(u)
        noise = self._learned(state.average, nominal)
        adapted = WithNoise(model, noise)
        new, info = self.filter.update(adapted, state.filter, u, z)
        if self.statistic == "residual":  # seen again from the posterior, the innovation is the residual
            seen, sign = self.filter.update(adapted, new, u, z)[1], 1.0
        else:
            seen, sign = info, -1.0

        teaches = jnp.isfinite(z) & (info.gate != Gate.REJECTED) & info.ok
        if self.excited is not None:
            teaches &= self.excited(model, self.filter.posterior(new).mean, u)
        std = _std(nominal)
        deviation = jnp.where(teaches, seen.innovation, 0) / std
        predicted = (seen.S - product(noise, noise.T)) / (std[:, None] * std)
        second = deviation[:, None] * deviation + sign * predicted
        if self.full:
            teaches = jnp.broadcast_to(jnp.all(teaches), teaches.shape)
        else:
            second = jnp.diagonal(second)[None]
        sample = jnp.concatenate([deviation[None], second])
        return AdaptiveState(new, self.average.add(state.average, sample, teaches)), info

    def posterior(self, state: AdaptiveState) -> Gaussian:
        """The Gaussian of the filter inside."""
        return self.filter.posterior(state.filter)

    def noise_scale(self, state: AdaptiveState) -> Float[Array, " m"]:
        """(m,) variances of R̂ as multiples of the model's: what has been learned so far."""
        m, dtype = state.average.taken.shape[1], state.average.kept.dtype
        return jnp.sum(self._learned(state.average, jnp.eye(m, dtype=dtype)) ** 2, axis=1)

    def _learned(self, average: AverageState, nominal: Float[Array, "m m"]) -> Float[Array, "m m"]:
        """A factor of R̂."""
        mean, second = jnp.split(self.average.mean(average), [1])
        enough = self.average.is_filled(average, self.minimum)[0]
        if self.centered:
            second = (second - (mean.T * mean if self.full else mean**2)) * unbiased(self.average)
        if not self.full:
            scale = jnp.where(enough, jnp.clip(second[0], self.floor, self.ceiling), 1)
            return jnp.sqrt(scale)[:, None] * nominal
        (factor,), _ = spectral(self._root_within, second)
        return jnp.where(enough, _std(nominal)[:, None] * factor, nominal)

    def _root_within(self, eigenvalues: Float[Array, " m"]) -> Float[Array, "1 m"]:
        return jnp.sqrt(jnp.clip(eigenvalues, self.floor, self.ceiling))[None]


class AdaptiveUKF(AdaptiveNoise):
    """Adaptive unscented Kalman filter (paper 000 §2.4): see :class:`AdaptiveNoise`."""

    name: ClassVar[str] = "adaptive-ukf"
    filter: UKF = eqx.field(default=UKF(), kw_only=True)


class AdaptiveEKF(AdaptiveNoise):
    """Adaptive extended Kalman filter: see :class:`AdaptiveNoise`."""

    name: ClassVar[str] = "adaptive-ekf"
    filter: EKF = eqx.field(default=EKF(), kw_only=True)


def _std(sqrt_R: Float[Array, "m m"]) -> Float[Array, " m"]:
    """Each sensor's standard deviation; 1 for one without noise, which has none to learn."""
    variance = jnp.sum(sqrt_R**2, axis=1)
    return jnp.sqrt(jnp.where(variance > 0, variance, 1))
