"""Reader of tire property files (.tir, the TeimOrbit format): text in, numbers by section out.

Only the syntax and the units are known here; what the numbers mean is :mod:`roadstate.tires.mf_build`'s
business. The files are untrusted: their size, number of entries and line length are bounded, and nothing but
numbers and short texts comes out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from roadstate.core import InputError
from roadstate.core.units import convert

_LARGEST_FILE = 2_000_000
_LONGEST_LINE = 2_000
_MOST_KEYS = 5_000

_SECTION = re.compile(r"^\[\s*([^\[\]]+?)\s*\]$")
_NUMBER = re.compile(r"^[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?$")
# as these files write them, in any case; what is not here is read as it stands ("kN" is not "kn")
_WORDS = {
    "meter": "m",
    "newton": "N",
    "second": "s",
    "radians": "rad",
    "radian": "rad",
    "degrees": "deg",
    "degree": "deg",
    "millimeter": "mm",
    "kilonewton": "kN",
    "pascal": "Pa",
}

# What the dimensional keys measure. The coefficients of the formulas themselves are in N, m, rad and Pa
# whatever the units section says.
_LENGTHS = ("UNLOADED_RADIUS", "WIDTH", "RIM_RADIUS", "RIM_WIDTH", "BOTTOM_OFFST")
_FORCES = ("FNOMIN", "FZMIN", "FZMAX")
_ANGLES = ("ALPMIN", "ALPMAX", "CAMMIN", "CAMMAX")
_SPEEDS = ("LONGVL", "VXLOW")
_PRESSURES = ("INFLPRES", "NOMPRES", "PRESMIN", "PRESMAX", "IP", "IP_NOM")
_STIFFNESSES = ("VERTICAL_STIFFNESS", "LONGITUDINAL_STIFFNESS", "LATERAL_STIFFNESS", "BOTTOM_STIFF")


@dataclass(frozen=True)
class TirFile:
    """A tire property file.

    Attributes:
        path: as given, for messages.
        sections: section → key → number (SI) or text, names in upper case; unknown ones are kept.
        lines: (section, key) → line number.
    """

    path: str
    sections: Mapping[str, Mapping[str, float | str]]
    lines: Mapping[tuple[str, str], int]

    def where(self, section: str, key: str) -> str:
        """``file:line (KEY)``, for messages."""
        return f"{self.path}:{self.lines[section, key]} ({key})"

    def text(self, section: str, key: str) -> str | None:
        """A value as upper-case text, or ``None`` where there is none."""
        value = self.sections.get(section, {}).get(key)
        if value is None:
            return None
        return f"{value:g}" if isinstance(value, float) else value.upper()

    def numbers(self) -> dict[str, float]:
        """Every numeric key of the data sections, by name.

        Raises:
            InputError: a key stands in two sections with two values.
        """
        found: dict[str, float] = {}
        for section, entries in self.sections.items():
            for key, value in entries.items():
                if not isinstance(value, float):
                    continue
                if found.setdefault(key, value) != value:
                    raise InputError(
                        f"given twice, as {found[key]:g} and {value:g}",
                        where=self.where(section, key),
                        mend="keep one",
                    )
        return found


def read_tir(path: str | Path) -> TirFile:
    """Read a tire property file.

    Args:
        path: the file.

    Raises:
        InputError: missing, too large, not text, without sections, a malformed or duplicated line, or an
            unknown unit.
    """
    where = str(path)
    sections: dict[str, dict[str, float | str]] = {}
    lines: dict[tuple[str, str], int] = {}
    section: str | None = None
    for number, line in enumerate(_read(path, where).splitlines(), 1):
        if len(line) > _LONGEST_LINE:
            raise InputError("a line is too long for a tire property file", where=f"{where}:{number}")
        content = _without_comment(line).strip()
        header = _SECTION.match(content)
        if header:
            section = header[1].upper()
            sections.setdefault(section, {})
            continue
        # tables ([SHAPE] and the like: numbers in columns) are not needed for the forces
        if section is None or "=" not in content:
            continue
        key, _, value = (part.strip() for part in content.partition("="))
        key = key.upper()
        if not key or len(lines) >= _MOST_KEYS:
            problem = "a value without a name" if not key else "too many entries for a tire property file"
            raise InputError(problem, where=f"{where}:{number}", mend="is this a .tir file?")
        if (section, key) in lines:
            raise InputError(
                f"{key} is given again (first on line {lines[section, key]})",
                where=f"{where}:{number}",
                mend="keep one",
            )
        lines[section, key] = number
        sections[section][key] = _value(value, f"{where}:{number} ({key})")
    if not sections:
        raise InputError(
            "no [section] in it",
            where=where,
            mend="give a tire property file (.tir) as MF-Tyre or Adams write",
        )
    _to_si(sections, where)
    return TirFile(where, sections, lines)


def _read(path: str | Path, where: str) -> str:
    try:
        with Path(path).open("rb") as stream:
            raw = stream.read(_LARGEST_FILE + 1)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"cannot read ({reason})", where=where, mend="check the path") from error
    if len(raw) > _LARGEST_FILE:
        raise InputError("too large for a tire property file", where=where, mend="is this a .tir file?")
    if b"\0" in raw:
        raise InputError("not a text file", where=where, mend="is this a .tir file?")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _without_comment(line: str) -> str:
    quote = ""
    for index, character in enumerate(line):
        if quote:
            quote = "" if character == quote else quote
        elif character in "'\"":
            quote = character
        elif character in "$!":
            return line[:index]
    return line


def _value(text: str, where: str) -> float | str:
    if len(text) >= 2 and text[0] == text[-1] and text[0] in "'\"":
        return text[1:-1].strip()
    if _NUMBER.match(text):
        number = float(text.upper().replace("D", "E"))
        if math.isfinite(number):
            return number
        raise InputError(f"'{text}' is out of range", where=where, mend="write a finite number")
    if text[:1].isalpha() and text.lower() not in {"nan", "inf", "infinity"}:
        return text
    raise InputError(f"'{text[:40]}' is not a number", where=where, mend="write it like 1.25 or 1.25e-3")


def _to_si(sections: dict[str, dict[str, float | str]], where: str) -> None:
    units = {k: str(v) for k, v in sections.get("UNITS", {}).items()}
    length, force, time = (
        _factor(units.get(key, si), si, where, key)
        for key, si in (("LENGTH", "m"), ("FORCE", "N"), ("TIME", "s"))
    )
    angle = _factor(units.get("ANGLE", "rad"), "rad", where, "ANGLE")
    pressure = (
        _factor(units["PRESSURE"], "Pa", where, "PRESSURE") if "PRESSURE" in units else force / length**2
    )
    factors = {
        **dict.fromkeys(_LENGTHS, length),
        **dict.fromkeys(_FORCES, force),
        **dict.fromkeys(_ANGLES, angle),
        **dict.fromkeys(_SPEEDS, length / time),
        **dict.fromkeys(_PRESSURES, pressure),
        **dict.fromkeys(_STIFFNESSES, force / length),
    }
    for name, entries in sections.items():
        if name == "UNITS":
            continue
        for key, value in entries.items():
            if isinstance(value, float) and key in factors:
                entries[key] = value * factors[key]


def _factor(unit: str, si: str, where: str, key: str) -> float:
    unit = _WORDS.get(unit.lower(), unit)
    try:
        return float(convert(1.0, unit, si))
    except InputError as error:
        raise InputError(error.what, where=f"{where} ([UNITS] {key})", mend=error.mend) from error
