"""How a mapping file describes one channel: where it comes from, and how raw values become SI."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    PlainValidator,
    WithJsonSchema,
    field_validator,
    model_validator,
)
from pydantic_core import PydanticCustomError

from roadstate.core import CHANNELS, InputError
from roadstate.core.quantity import Quantity
from roadstate.core.units import convert, is_same_dimension, parse_unit
from roadstate.io.matching import Candidate, as_candidate

_SCALE = re.compile(r"\s*([+-]?[0-9.]+(?:[eE][+-]?[0-9]+)?)\s*(.*?)\s*")
_LARGE = 1e12
_NUMBER_OR_TEXT: dict[str, Any] = {"anyOf": [{"type": "number"}, {"type": "string"}]}

Finite = Annotated[float, Field(allow_inf_nan=False)]
Text = Annotated[str, Field(min_length=1, max_length=200)]


@dataclass(frozen=True)
class Gain:
    """A factor and the unit written with it; without one it is a plain number."""

    value: float = 1.0
    unit: str | None = None

    def __str__(self) -> str:
        return f"{self.value!r} {self.unit}" if self.unit else repr(self.value)

    @classmethod
    def parse(cls, value: object) -> Gain:
        """Read ``3.2`` or ``3.2 N*m/%``.

        Raises:
            InputError: neither, or zero.
        """
        match = _SCALE.fullmatch(str(value)[:80])
        try:
            number = float(match[1]) if match else 0.0
        except ValueError:
            number = 0.0
        if match is None or not 0.0 < abs(number) < _LARGE:
            raise InputError(f"'{str(value)[:80]}' is no scale", mend="write it like 3.2 or '3.2 N*m/%'")
        return cls(number, match[2] or None)


def _as_list(value: Any) -> Any:
    return value if isinstance(value, list | tuple) else [value]


def _as_candidates(value: Any) -> Any:
    return [as_candidate(v) for v in _as_list(value)]


def _as_number(value: Any) -> Any:
    return {"true": 1.0, "false": 0.0}.get(value, value) if isinstance(value, str) else value


def _as_sign(value: Any) -> Any:
    return {"1": 1, "+1": 1, "-1": -1}.get(value, value) if isinstance(value, str) else value


class Section(BaseModel):
    """A part of the file: frozen, no keys but its own."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Condition(Section):
    """A companion signal that says whether samples of another are valid.

    Attributes:
        signal: its exact name: key or last part.
        message: the bus message that carries it.
        bus: the bus channel that carries it.
        equals: the value that means valid.
        min: least value that means valid, in the companion's raw unit.
        max: largest value that means valid, in the companion's raw unit.
    """

    signal: Text
    message: Text | None = None
    bus: int | None = Field(None, ge=0)
    equals: Annotated[Finite, BeforeValidator(_as_number)] | None = None
    min: Finite | None = None
    max: Finite | None = None

    @model_validator(mode="after")
    def _says_something(self) -> Condition:
        if self.equals is None and self.min is None and self.max is None:
            raise InputError(f"condition on '{self.signal}' has none of equals, min, max")
        return self

    @property
    def candidate(self) -> Candidate:
        """The companion as a candidate to look up."""
        return Candidate(signal=self.signal, message=self.message, bus=self.bus, glob=None, regex=None)


class ChannelMap(Section):
    """Where one channel comes from and how raw values become SI: ``y = sign·scale·convert(x) + offset``.

    Attributes:
        from_: (``from``) candidates in order: the first that matches a raw signal is taken.
        unit: unit of the raw values, in place of the file's; needed where the file gives none and they are
            not in the channel's SI unit.
        sign: -1 where the sensor counts the other way.
        scale: factor, applied in the channel's SI unit; with a unit (``320 N*m``) it turns a dimensionless
            signal (``%``, ``-`` or counts) into the channel's.
        offset: added last, in the channel's SI unit unless it names another of the same kind (``0.5 deg``).
        delay: s by which the signal arrives late; its time stamps are moved earlier by it.
        valid: conditions on companion signals; where one fails the sample is missing.
        invalid: raw values (before any conversion) that mean missing.
        range: least and largest raw value (before any conversion) that is a measurement.
        optional: leave the channel out where no candidate matches, rather than refuse.
    """

    from_: Annotated[
        tuple[Candidate, ...],
        BeforeValidator(_as_candidates),
        Field(alias="from", min_length=1, max_length=50),
    ]
    unit: str | None = Field(None, max_length=40)
    sign: Annotated[Literal[1, -1], BeforeValidator(_as_sign)] = 1
    scale: Annotated[
        Gain, PlainValidator(Gain.parse), PlainSerializer(str), WithJsonSchema(_NUMBER_OR_TEXT)
    ] = Gain()
    offset: Annotated[str | float, WithJsonSchema(_NUMBER_OR_TEXT)] = 0.0
    delay: Annotated[float, Quantity("s", -60, 60)] = 0.0
    valid: Annotated[tuple[Condition, ...], BeforeValidator(_as_list)] = ()
    invalid: Annotated[tuple[Finite, ...], BeforeValidator(_as_list)] = ()
    range: tuple[Finite, Finite] | None = None
    optional: bool = False

    @model_validator(mode="before")
    @classmethod
    def _short_form(cls, value: Any) -> Any:
        return {"from": value} if isinstance(value, str | list) else value

    @field_validator("unit")
    @classmethod
    def _readable_unit(cls, unit: str | None) -> str | None:
        if unit is not None:
            parse_unit(unit)
        return unit

    @field_validator("range")
    @classmethod
    def _ordered(cls, limits: tuple[float, float] | None) -> tuple[float, float] | None:
        if limits is not None and limits[0] >= limits[1]:
            raise InputError(f"range [{limits[0]:g}, {limits[1]:g}] is empty", mend="give [least, largest]")
        return limits

    def offset_in(self, name: str) -> float:
        """The offset in the unit of the channel ``name``.

        Raises:
            PydanticCustomError: it is in a unit that does not fit.
        """
        unit = CHANNELS[name].unit
        return Quantity(unit, -_LARGE, _LARGE, is_slope=is_slope(name)).parse(self.offset)

    def check_units(self, name: str) -> None:
        """Refuse units that do not fit the channel they are mapped to.

        Raises:
            InputError: unit or scale measures something else than the channel.
            PydanticCustomError: so does the offset.
        """
        target = CHANNELS[name].unit
        self.offset_in(name)
        if self.scale.unit is not None:
            if not is_same_dimension(self.scale.unit, target):
                raise InputError(
                    f"unit '{self.scale.unit}' of the scale does not lead to '{target}'",
                    mend="a scale with a unit turns a signal without one (-, %) into the channel's",
                )
        elif self.unit is not None and not is_linear_wheel_speed(name, self.unit):
            convert(0.0, self.unit, target)


def is_slope(name: str) -> bool:
    """Whether a channel is an angle of the road, which logs give in percent or as a ratio too."""
    return name in ("ref_grade", "ref_bank")


def is_linear_wheel_speed(name: str, unit: str) -> bool:
    """Whether a wheel's speed is given along the road rather than about its axle."""
    return name.startswith("wheel_speed_") and unit != "rad/s" and is_same_dimension(unit, "m/s")


def check_units(spec: ChannelMap, name: str, place: str) -> None:
    """:meth:`ChannelMap.check_units`, the error naming the ``place`` in the file."""
    try:
        spec.check_units(name)
    except InputError as error:
        raise InputError(error.what, where=place, mend=error.mend) from error
    except PydanticCustomError as error:
        context = error.context or {}
        raise InputError(context["what"], where=f"{place}.offset", mend=context["mend"]) from error
