"""Estimators: one file, one system. A module that defines an :class:`Estimator` with a name is found."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Collection
from functools import cache
from typing import TYPE_CHECKING, Any

import jax

from roadstate.core.channels import channel, did_you_mean
from roadstate.core.errors import InputError
from roadstate.estimators.base import Estimate, Estimator, Need, Sample

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

__all__ = ["Estimate", "Estimator", "Need", "Sample", "all_estimators", "build", "runnable"]


@cache
def all_estimators() -> dict[str, type[Estimator[Any]]]:
    """Every estimator class by name, in alphabetical order."""
    found: dict[str, type[Estimator[Any]]] = {}
    for module in pkgutil.iter_modules(__path__, f"{__name__}."):
        for value in vars(importlib.import_module(module.name)).values():
            if isinstance(value, type) and issubclass(value, Estimator) and "name" in vars(value):
                found[value.name] = value
    return dict(sorted(found.items()))


def runnable(available: Collection[str]) -> list[str]:
    """Names of the estimators whose needs these channels meet."""
    return [n for n, e in all_estimators().items() if all(need.is_met(available) for need in e.needs)]


def build(name: str, vehicle: Vehicle, available: Collection[str], **options: Any) -> Estimator[Any]:
    """Build an estimator by name for a vehicle and the channels that a log has.

    Raises:
        InputError: no such estimator, a name for a vehicle, a channel that is none, or one it needs that is
            missing (says which, and which estimators the channels would do for).
    """
    if isinstance(vehicle, str):
        raise InputError("the vehicle is a name", mend=f"give load_vehicle('{vehicle}')")
    for each in available:
        channel(each)
    classes = all_estimators()
    if name not in classes:
        raise InputError(f"no estimator is called '{name}'", mend=did_you_mean(name, classes))
    missing = [need for need in classes[name].needs if not need.is_met(available)]
    if missing:
        ways = " and ".join(
            f"{need.what} ({' or '.join('+'.join(group) for group in need.alternatives)})" for need in missing
        )
        others = ", ".join(runnable(available)) or "none"
        raise InputError(
            f"'{name}' needs {ways}",
            mend=f"map the channel, or use an estimator these channels do for: {others}",
        )
    built = classes[name].build(vehicle, available, **options)
    # a number of Python's and one of NumPy's become arrays of different types: one program shall do for both
    strong: Estimator[Any] = jax.tree.map(
        lambda a: a.astype(a.dtype) if isinstance(a, jax.Array) else a, built
    )
    return strong
