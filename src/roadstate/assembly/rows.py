"""Names in, rows out: families of four wheels, groupings, and values by row or by family."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from math import inf, isfinite
from typing import Any, Literal, NamedTuple, TypeVar

from roadstate.core.channels import WHEELS, did_you_mean
from roadstate.core.errors import InputError
from roadstate.vehicles.model import per_wheel

T = TypeVar("T")

Grouping = Literal["one", "front_rear", "left_right", "four"]
"""Which of four wheels share a number."""

_GROUPS: dict[str, tuple[tuple[str, ...], tuple[int, ...]]] = {
    "one": ((), (0, 0, 0, 0)),
    "front_rear": (("front", "rear"), (0, 0, 1, 1)),
    "left_right": (("left", "right"), (0, 1, 0, 1)),
    "four": (WHEELS, (0, 1, 2, 3)),
}


class Family(NamedTuple):
    """The rows that one name stands for.

    Attributes:
        name: as the caller wrote it.
        rows: names of the rows of x.
        of_wheel: for each wheel, which of the rows is its own; empty where the name is no wheels' matter.
    """

    name: str
    rows: tuple[str, ...]
    of_wheel: tuple[int, ...] = ()


Rows = Sequence[tuple[str, Family]]
"""Each row with the family it belongs to."""


def grouped(name: str, grouping: str, where: str) -> Family:
    """The rows of a four-wheel quantity under a grouping.

    Raises:
        InputError: there is no such grouping.
    """
    if grouping not in _GROUPS:
        raise InputError(
            f"'{grouping}' is no grouping of four wheels", where=where, mend=f"choose {', '.join(_GROUPS)}"
        )
    ends, of_wheel = _GROUPS[grouping]
    return Family(name, tuple(f"{name}_{end}" for end in ends) or (name,), of_wheel)


def expand(names: Iterable[str], known: Collection[str], where: str) -> tuple[tuple[str, Family], ...]:
    """(row, family) for each row; a name that has four wheels (``wheel_speed``) stands for all of them.

    Raises:
        InputError: a name is unknown or comes twice.
    """
    found: list[tuple[str, Family]] = []
    for name in names:
        rows = (name,) if name in known else per_wheel(name)
        if not all(row in known for row in rows):
            families = {row.removesuffix(f"_{w}") for row in known for w in WHEELS}
            raise InputError(f"unknown '{name}'", where=where, mend=did_you_mean(name, sorted(families)))
        found += [(row, Family(name, rows)) for row in rows]
    refuse_twice([row for row, _ in found], where)
    return tuple(found)


def refuse_twice(rows: Sequence[str], where: str) -> None:
    """Refuse a row that is listed twice.

    Raises:
        InputError: naming it.
    """
    twice = [row for i, row in enumerate(rows) if row in rows[:i]]
    if twice:
        raise InputError(f"'{twice[0]}' comes twice", where=where, mend="name it once")


def values_of(given: Mapping[str, T], rows: Rows, where: str, *, default: T | None = None) -> list[T]:
    """The value of each row, by its own name or by its family's.

    Raises:
        InputError: a row has no value (and there is no default), or a value goes to no row.
    """
    known = {name for row, family in rows for name in (row, family.name)}
    for name in given:
        if name not in known:
            raise InputError(
                f"'{name}' is not a row of this model", where=where, mend=did_you_mean(name, sorted(known))
            )
    values: list[T] = []
    for row, family in rows:
        value = given.get(row, given.get(family.name, default))
        if value is None:
            raise InputError(f"nothing is said of '{row}'", where=where, mend=f"add '{family.name}'")
        values.append(value)
    return values


def number(
    value: Any, row: str, where: str, *, zero: bool = False, negative: bool = False, infinite: bool = False
) -> float:
    """``value`` as a float above zero and finite.

    Args:
        value: anything.
        row, where: for the message.
        zero, negative, infinite: what else will do; where negative numbers do, so does zero.

    Raises:
        InputError: it is no such number.
    """
    try:
        result = float(value)
    except (TypeError, ValueError):
        raise InputError(f"{value!r} is not a number", where=f"{where}: {row}") from None
    fits = isfinite(result) or (infinite and result == inf)
    if not fits or not (negative or result > 0 or (zero and result == 0)):
        wanted = "a finite number" if negative else "zero or more" if zero else "more than zero"
        raise InputError(f"{result:g} is out of range", where=f"{where}: {row}", mend=f"give {wanted}")
    return result
