"""Tires: one file, one model. A module that defines a :class:`TireModel` with a name is found."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from roadstate.tires.base import TireForce, TireModel
from roadstate.tires.brush import Brush
from roadstate.tires.curves import curves, linear_stiffness
from roadstate.tires.dugoff import Dugoff
from roadstate.tires.fit import FitResult, Misfit, fit_tire
from roadstate.tires.linear import Linear
from roadstate.tires.magic_formula import MagicFormula, RelaxationLengths
from roadstate.tires.magic_formula_simple import MagicFormulaSimple
from roadstate.tires.mf_build import load_tir
from roadstate.tires.mf_moment import TireMoments
from roadstate.tires.modified_dugoff import ModifiedDugoff
from roadstate.tires.normalized_dugoff import NormalizedDugoff
from roadstate.tires.relaxation import relax, relaxation_rate
from roadstate.tires.tir import TirFile, read_tir

__all__ = [
    "Brush",
    "Dugoff",
    "FitResult",
    "Linear",
    "MagicFormula",
    "MagicFormulaSimple",
    "Misfit",
    "ModifiedDugoff",
    "NormalizedDugoff",
    "RelaxationLengths",
    "TirFile",
    "TireForce",
    "TireModel",
    "TireMoments",
    "all_tires",
    "curves",
    "fit_tire",
    "linear_stiffness",
    "load_tir",
    "read_tir",
    "relax",
    "relaxation_rate",
]


@cache
def all_tires() -> dict[str, type[TireModel]]:
    """Every tire model class by name, in alphabetical order."""
    found: dict[str, type[TireModel]] = {}
    for module in pkgutil.iter_modules(__path__, f"{__name__}."):
        for value in vars(importlib.import_module(module.name)).values():
            if isinstance(value, type) and issubclass(value, TireModel) and "name" in vars(value):
                found[value.name] = value
    return dict(sorted(found.items()))
