"""Numbers with a unit: a field's type that takes ``1500`` (SI) or ``1.5 t`` and keeps an SI float."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import PydanticCustomError, core_schema

from roadstate.core.errors import InputError
from roadstate.core.units import to_channel_unit

_NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_TEXT = re.compile(rf"({_NUMBER})\s*(.*)", re.DOTALL)
_ANGLE = re.compile(r"deg|rad|°|rev|turn", re.IGNORECASE)
_LONGEST = 80


def refusal(what: str, mend: str, key: str = "") -> PydanticCustomError:
    """A validation error that carries the two halves of an :class:`~roadstate.core.InputError`.

    Args:
        what: what is wrong.
        mend: what to do about it.
        key: the key at fault below the place where the error is raised, if it is not that place itself.
    """
    return PydanticCustomError("refused", "{what}; {mend}", {"what": what, "mend": mend, "key": key})


@dataclass(frozen=True)
class Quantity:
    """Annotation of a float field: its SI unit and the range in which it makes sense (both ends included).

    Attributes:
        unit: SI unit the value is kept in; ``-`` where it has none.
        minimum: smallest sensible value, in ``unit``.
        maximum: largest sensible value, in ``unit``.
        is_slope: the field is an angle of the road, for which ``%`` means rise over run.
    """

    unit: str
    minimum: float
    maximum: float
    is_slope: bool = False

    def parse(self, value: object) -> float:
        """The value in SI.

        Args:
            value: a number in SI, or a text such as ``1500``, ``1500 kg``, ``1.5 t``.

        Raises:
            PydanticCustomError: neither, a unit of another dimension, or out of range.
        """
        written = ""
        if value is None:
            raise refusal("has no value", self._how())
        if isinstance(value, bool) or not isinstance(value, (int, float, str)):
            raise refusal("is not a number", self._how())
        if isinstance(value, str):
            number, written = self._split(value.strip())
        else:
            try:
                number = float(value)
            except OverflowError:
                number = math.inf
        if written and written != self.unit:
            number = self._convert(number, written)
        if not math.isfinite(number):
            raise refusal("is not a finite number", self._how())
        if not self.minimum <= number <= self.maximum:
            raise self._out_of_range(number, has_unit=bool(written))
        return number

    def _split(self, text: str) -> tuple[float, str]:
        match = _TEXT.fullmatch(text) if len(text) <= _LONGEST else None
        if match is None:
            shown = text if len(text) <= _LONGEST else text[:_LONGEST] + "…"
            raise refusal(f"'{shown}' is not a number" if text else "has no value", self._how())
        rest = match[2]
        if rest.startswith((",", "_", ":", "'")):
            raise refusal(
                f"'{text}' is not a number", f"write it with a decimal point and nothing else; {self._how()}"
            )
        return float(match[1]), rest

    def _convert(self, number: float, written: str) -> float:
        refused = refusal(f"unit '{written}' does not fit: this is in {self._in_words()}", self._how())
        if self.unit == "-" and _ANGLE.search(written):
            raise refused
        try:
            return float(to_channel_unit(np.asarray(number), written, self.unit, is_slope=self.is_slope))
        except InputError as error:
            raise refused from error

    def _out_of_range(self, number: float, *, has_unit: bool) -> PydanticCustomError:
        unit = "" if self.unit == "-" else f" {self.unit}"
        mend = "check the figure"
        if number < 0 <= self.minimum:
            mend = "it cannot be negative"
        elif self.unit != "-":
            mend = "check the figure and its unit"
            if not has_unit:
                mend += f"; a number without a unit is taken in {self.unit}"
        return refusal(f"{number:g}{unit} is outside {self.minimum:g} to {self.maximum:g}{unit}", mend)

    def _in_words(self) -> str:
        return "plain numbers" if self.unit == "-" else self.unit

    def _how(self) -> str:
        if self.unit == "-":
            return "give a plain number"
        return f"give a number in {self.unit}, or a number and a unit that converts to it"

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self.parse)

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        number = {"type": "number", "minimum": self.minimum, "maximum": self.maximum}
        text = {"type": "string", "pattern": rf"^\s*{_NUMBER}(\s*\S.*)?$"}
        return {"anyOf": [number, text], "unit": self.unit}
