"""From a tire property file to a :class:`MagicFormula`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from roadstate.core import InputError
from roadstate.tires.base import as_leaf
from roadstate.tires.magic_formula import Combination, Form, MagicFormula, Relaxation
from roadstate.tires.mf_coefficients import ALIASES, ASYMMETRIC, DEFAULTS, MANDATORY
from roadstate.tires.mf_combined import highest
from roadstate.tires.tir import TirFile, read_tir

PASSENGER = Path(__file__).parent / "passenger_205_60r15.tir"
"""The tire property file that comes with the package."""

_FITTYP: dict[str, Form] = {
    **dict.fromkeys(("5", "6", "21", "51", "52", "MF5", "MF51", "MF52", "MF_05"), "MF5.2"),
    **dict.fromkeys(("60", "61", "62", "MF60", "MF61", "MF62"), "MF6.1"),
    "PAC2002": "PAC2002",
}
_POSITIVE = (
    "FNOMIN",
    "UNLOADED_RADIUS",
    "NOMPRES",
    "LONGVL",
    "VXLOW",
    "LFZO",
    "PKX1",
    "PCX1",
    "PCY1",
    "PKY2",
)


def load_tir(
    path: str | Path,
    *,
    symmetric: bool = False,
    friction_as: Literal["peak", "factor"] = "peak",
    side: Literal["left", "right"] | None = None,
    combination: Combination | None = None,
    stiffness_follows_friction: bool = False,
    bounded: bool = False,
) -> MagicFormula:
    """Read a ``.tir`` file as a tire: MF 6.x (FITTYP 60–62), MF 5.x (5, 6, 21, 51, 52) or PAC2002.

    Coefficients that the file does not give take the standard's defaults.

    Args:
        path: the file.
        symmetric: drop ply steer, conicity and every other shift that tells left from right or pulls without
            slip, as suits one tire used at all four wheels.
        friction_as: what :meth:`MagicFormula.forces` takes for friction: the peak coefficient itself, or a
            factor on the file's (1: as measured).
        side: where the wheel is mounted; mirrored if the file says it was measured on the other side.
        combination: how pure slips combine; by default the weighting functions, or the friction ellipse where
            the file asks for it (FE_METHOD) or has no coefficients to weight with.
        stiffness_follows_friction: scale the slip stiffness with friction; real tires' hardly does.
        bounded: keep the force within the pure peaks, whatever camber and shifts add.

    Raises:
        InputError: as :func:`roadstate.tires.tir.read_tir`; another kind of tire model; a coefficient is
            missing or impossible.
    """
    file = read_tir(path)
    form = _form(file)
    numbers = {ALIASES.get(key, key): value for key, value in file.numbers().items()}
    _check(file, numbers)
    if "NOMPRES" not in numbers and "INFLPRES" in numbers:
        numbers["NOMPRES"] = numbers["INFLPRES"]
    numbers = {key: numbers.get(key, default) for key, default in DEFAULTS.items()}
    if symmetric:
        numbers.update(dict.fromkeys(ASYMMETRIC, 0.0))
    if friction_as == "peak":
        reference_x = abs(numbers["PDX1"]) * float(highest(numbers["PCX1"] * numbers["LCX"]))
        reference_y = abs(numbers["PDY1"]) * float(highest(numbers["PCY1"] * numbers["LCY"]))
    else:
        reference_x, reference_y = 1 / numbers["LMUX"], 1 / numbers["LMUY"]
    measured = file.text("MODEL", "TYRESIDE")
    tire = MagicFormula(
        coefficients={key: as_leaf(value) for key, value in numbers.items()},
        reference_x=as_leaf(reference_x),
        reference_y=as_leaf(reference_y),
        form=form,
        combination=combination or _combination(file, numbers),
        relaxation=_relaxation(numbers),
        mirrored=side is not None and measured in {"LEFT", "RIGHT"} and measured != side.upper(),
        stiffness_follows_friction=stiffness_follows_friction,
        bounded=bounded,
    )
    _try(tire, file)
    return tire


def _form(file: TirFile) -> Form:
    said = file.text("MODEL", "PROPERTY_FILE_FORMAT")
    fittyp = file.text("MODEL", "FITTYP")
    for text in (said, fittyp):
        if text in _FITTYP:
            return _FITTYP[text]
    told = " and ".join(
        f"{key} '{text}'" for key, text in (("PROPERTY_FILE_FORMAT", said), ("FITTYP", fittyp)) if text
    )
    raise InputError(
        f"{told} is not a Magic Formula this reader knows" if told else "no FITTYP in [MODEL]",
        where=file.path,
        mend="readable are FITTYP 5, 6, 21, 51, 52, 60, 61, 62 and PROPERTY_FILE_FORMAT 'PAC2002'",
    )


def _check(file: TirFile, numbers: dict[str, float]) -> None:
    for section, entries in file.sections.items():
        for key, value in entries.items():
            if ALIASES.get(key, key) in DEFAULTS and isinstance(value, str) and section != "UNITS":
                raise InputError(f"'{value[:40]}' is not a number", where=file.where(section, key))
    missing = [key for key in MANDATORY if key not in numbers]
    if missing:
        raise InputError(
            f"{', '.join(missing)} missing", where=file.path, mend="without them there is no tire force"
        )
    bad = [key for key in _POSITIVE if numbers.get(key, 1.0) <= 0]
    bad += [key for key in ("PDX1", "PDY1", "LMUX", "LMUY", "LCX", "LCY") if numbers.get(key, 1.0) == 0]
    bad += ["PTY2"] if numbers.get("PTY1", 0.0) != 0 and numbers.get("PTY2", 0.0) <= 0 else []
    if bad:
        values = ", ".join(f"{key} = {numbers.get(key, 0.0):g}" for key in bad)
        raise InputError(f"impossible: {values}", where=file.path, mend="it must be above zero")
    if numbers["PKY1"] >= 0:
        raise InputError(
            f"PKY1 = {numbers['PKY1']:g}: the file is not in ISO-W axes",
            where=file.path,
            mend="there the cornering stiffness is negative; convert the coefficients' signs",
        )


def _combination(file: TirFile, numbers: dict[str, float]) -> Combination:
    asked = file.text("MODEL", "FE_METHOD") == "YES"
    return "ellipse" if asked or (numbers["RBX1"] == 0 and numbers["RBY1"] == 0) else "weighting"


def _relaxation(numbers: dict[str, float]) -> Relaxation:
    if numbers["PTX1"] or numbers["PTY1"]:
        return "polynomial"
    has_carcass = numbers["LONGITUDINAL_STIFFNESS"] > 0 and numbers["LATERAL_STIFFNESS"] > 0
    return "carcass" if has_carcass else "none"


def _try(tire: MagicFormula, file: TirFile) -> None:
    # a coefficient can be a number and still absurd: better said here than as NaN in a simulation
    nominal = float(tire.coefficients["FNOMIN"])
    slips = np.array([-1.0, -0.1, 0.0, 0.1, 1.0])
    loads = nominal * np.array([0.5, 1.0, 1.5])
    result = tire.forces(slips[:, None, None], 0.5 * slips[:, None], loads, tire.reference_x, 20.0)
    if not all(np.all(np.abs(force) < 100 * nominal) for force in result):
        raise InputError(
            "its coefficients give no sensible force around the nominal load",
            where=file.path,
            mend="look for a misplaced decimal point",
        )
