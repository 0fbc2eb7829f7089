"""The contract of an estimator: a state-space model and a filter, fed from canonical channels."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, Self, TypeVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from roadstate.core.channels import CHANNELS
from roadstate.core.errors import InputError
from roadstate.core.gaussian import Info
from roadstate.core.traced import returned
from roadstate.filters.base import Filter

if TYPE_CHECKING:
    from roadstate.vehicles.parameters import Vehicle

Sample = Mapping[str, Float[Array, ""]]
"""One instant: a scalar for each of the estimator's channels, SI units, NaN where missing."""

SILENT_STEP = 0.1
"""Seconds of the shortest steps, without any sample, that lead through a break in a log: see
:func:`roadstate.run.chunk.through`. A sample that leads out of one comes sooner."""


def leaf(value: float) -> Float[Array, ""]:
    """A parameter as an array, so that its value is data to the compiled step and not part of it."""
    return jnp.asarray(float(value))


@returned
class Estimate(NamedTuple):
    """What an estimator says at one instant.

    Attributes:
        values: quantity → scalar in SI.
        std: quantity → standard deviation (1σ).
        validity: :class:`roadstate.core.Validity` code.
        faults: (f,) which of :attr:`Estimator.fault_names` are there now; ``None`` of one that tells of none.
    """

    values: dict[str, Float[Array, ""]]
    std: dict[str, Float[Array, ""]]
    validity: Int[Array, ""]
    faults: Bool[Array, " f"] | None = None


@dataclass(frozen=True)
class Need:
    """One thing an estimator needs, and the sets of channels any one of which provides it.

    Attributes:
        what: in words, for messages.
        alternatives: sets of canonical channel names; all of a set must be there.
    """

    what: str
    alternatives: tuple[tuple[str, ...], ...]

    def is_met(self, available: Collection[str]) -> bool:
        """Whether the available channels provide it."""
        return any(all(c in available for c in group) for group in self.alternatives)


class Smoothable(NamedTuple):
    """Where an estimator keeps the Gaussian filter by which it can be smoothed after the drive.

    Attributes:
        filter: name of the estimator's field that holds the filter; it is used by its ``step`` alone.
        state: name of the field of the estimator's state that holds the filter's.
        quantities: what is told of that filter's Gaussian, as far as the channels allow.
    """

    filter: str
    state: str
    quantities: tuple[str, ...]


def known_only(given: Collection[str], known: Collection[str]) -> None:
    """Refuse settings that there are not.

    Raises:
        InputError: for the first of ``given`` that is not ``known``.
    """
    for name in given:
        if name not in known:
            listed = f"known: {', '.join(known)}" if known else "there are none"
            raise InputError(f"no setting is called '{name}'", mend=listed)


F = TypeVar("F", bound=Filter[Any])


def with_options(kind: type[F], options: Mapping[str, Any]) -> F:
    """A filter set as ``options`` say.

    Raises:
        InputError: it has no such option, or refuses its value.
    """
    known_only(options, [field.name for field in fields(kind)])
    try:
        return kind(**options)
    except ValueError as error:
        raise InputError(str(error), where="filter_options") from error


S = TypeVar("S")


class Estimator(eqx.Module, Generic[S]):
    """An estimator: ``init``, ``step``, ``estimate``, all pure; the state ``S`` is any pytree.

    A stream, a scan over a log and a batch of logs all call the same :meth:`step`. Parameters are leaves
    (arrays), so they can be batched and differentiated, and changing one compiles nothing anew.

    Attributes:
        smoothable: by what :func:`roadstate.run.smooth` smooths it; ``None`` where nothing does.
        channels: canonical channels read from each sample.
        sensors: names of the filter's sensors: the rows of :class:`Info`.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    needs: ClassVar[tuple[Need, ...]]
    optional: ClassVar[tuple[str, ...]] = ()
    smoothable: ClassVar[Smoothable | None] = None

    channels: eqx.AbstractVar[tuple[str, ...]]
    sensors: eqx.AbstractVar[tuple[str, ...]]

    @property
    def sensor_units(self) -> Mapping[str, str]:
        """Sensor → SI unit of its reading; an estimator adds those that are no canonical channels."""
        return {s: CHANNELS[s].unit for s in self.sensors if s in CHANNELS}

    @property
    def fault_names(self) -> tuple[str, ...]:
        """Sensors' faults that :attr:`Estimate.faults` tells of, each a sentence with the channel's name."""
        return ()

    @classmethod
    @abstractmethod
    def build(cls, vehicle: Vehicle, available: Collection[str], **options: Any) -> Self:
        """Compose the estimator for a vehicle and the channels that are there.

        Raises:
            InputError: a need is not met, the vehicle file lacks what the estimator uses, or there is no such
                option.
        """

    @abstractmethod
    def init(self) -> S:
        """The state before the first sample."""

    @abstractmethod
    def step(self, state: S, sample: Sample, dt: Float[Array, ""]) -> tuple[S, Info]:
        """Advance by ``dt`` seconds (0 at the first sample) and take the sample."""

    @abstractmethod
    def estimate(self, state: S) -> Estimate:
        """What the state says of the quantities now."""
