"""Estimators for a car and a log's channels, those that can be had."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Any

from roadstate.core import InputError
from roadstate.estimators import Estimator, build
from roadstate.vehicles import Vehicle


def buildable(
    names: Sequence[str], car: Vehicle, available: Collection[str]
) -> Iterator[tuple[str, Estimator[Any]]]:
    """Name and estimator, one after another; those that lack a channel or a figure are left out."""
    for name in names:
        try:
            estimator = build(name, car, available)
        except InputError:
            continue
        yield name, estimator
