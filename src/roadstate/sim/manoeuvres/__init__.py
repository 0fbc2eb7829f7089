"""Manoeuvres: one file, one family. A :class:`ManoeuvreKind` at the top level of a module here is found."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from typing import TYPE_CHECKING

from roadstate.lazy import lazily

if TYPE_CHECKING:
    from roadstate.sim.manoeuvres.base import KMH, Manoeuvre, ManoeuvreKind, Setting
    from roadstate.sim.manoeuvres.driver import Driver, DriverState, Seen, seen
    from roadstate.sim.manoeuvres.path import Path
    from roadstate.sim.manoeuvres.script import Script

_HOME = {
    "KMH": "base",
    "Driver": "driver",
    "DriverState": "driver",
    "Manoeuvre": "base",
    "ManoeuvreKind": "base",
    "Path": "path",
    "Script": "script",
    "Seen": "driver",
    "Setting": "base",
    "seen": "driver",
}

__all__ = [
    "KMH",
    "Driver",
    "DriverState",
    "Manoeuvre",
    "ManoeuvreKind",
    "Path",
    "Script",
    "Seen",
    "Setting",
    "all_manoeuvres",
    "manoeuvre",
    "seen",
]


@cache
def all_manoeuvres() -> dict[str, ManoeuvreKind]:
    """Every manoeuvre by name, in alphabetical order."""
    from roadstate.sim.manoeuvres.base import ManoeuvreKind

    found: dict[str, ManoeuvreKind] = {}
    for module in pkgutil.iter_modules(__path__, f"{__name__}."):
        for value in vars(importlib.import_module(module.name)).values():
            if isinstance(value, ManoeuvreKind):
                found[value.name] = value
    return dict(sorted(found.items()))


def manoeuvre(name: str) -> ManoeuvreKind:
    """The manoeuvre called ``name``.

    Raises:
        InputError: there is none; names the closest.
    """
    from roadstate.core import InputError
    from roadstate.core.channels import did_you_mean

    if name not in all_manoeuvres():
        raise InputError(f"no manoeuvre is called '{name}'", mend=did_you_mean(name, all_manoeuvres()))
    return all_manoeuvres()[name]


__getattr__ = lazily(__name__, _HOME)
