"""The new vehicle file: the old one's keys in their order, with what has been learned."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import yaml

from roadstate.calibration.fit import Calibration, Learned
from roadstate.calibration.parameters import Path as Keys
from roadstate.core.yaml_text import read_yaml
from roadstate.vehicles import parse_vehicle

# below which a fit's own 1σ is not believed: what it was fitted to does not hold for every drive
_FLOORS: Mapping[Keys, float] = {
    ("prior", "mass_relative"): 0.005,
    ("prior", "drag_relative"): 0.02,
    ("prior", "rolling_resistance_std"): 3e-4,
    ("prior", "pitch_gradient_std"): 2e-4,
    ("prior", "stiffness_relative"): 0.03,
    ("prior", "tire_shape_std"): 0.05,
    ("prior", "friction_relative"): 0.08,  # dry roads differ
    ("sensors", "wheel_speed", "scale"): 0.002,
}
_LONGEST_SOURCE = 4000
_PLAIN = re.compile(r"[A-Za-z0-9_./*^() +%°-]+")


def learned_yaml(text: str, where: str, calibration: Calibration) -> str:
    """The text of the new vehicle file; keys keep their order, comments are lost.

    Args:
        text: of the old file.
        where: its name.
        calibration: what has been learned.

    Raises:
        InputError: the old file is not one, or the new one would not be.
    """
    data = dict(read_yaml(text, where).data)
    notes: dict[Keys, str] = {}
    for one in calibration.learned:
        keys, unit = one.parameter.path, one.parameter.unit
        _set(data, keys, _written(one.value, unit, one.std))
        if _prior_of(one, calibration.learned) is None:
            notes[keys] = f"± {_short(one.std)}, learned"
        else:
            notes[keys] = "learned"
        if keys == ("geometry", "cg_to_front_axle"):
            rear = calibration.vehicle.geometry.cg_to_rear_axle
            _set(data, ("geometry", "cg_to_rear_axle"), _written(rear, unit, one.std))
            notes[("geometry", "cg_to_rear_axle")] = "learned"
    for keys, value in _uncertainties(calibration).items():
        unit = _unit(calibration, keys)
        _set(data, keys, _written(value, unit, value / 100))
        notes[keys] = "from the fit"
    data["source"] = _source(data.get("source"), calibration)
    result = "\n".join(_lines(data, (), notes)) + "\n"
    parse_vehicle(result, "the new vehicle file")
    return result


def _uncertainties(calibration: Calibration) -> dict[Keys, float]:
    """Where the file says how exact learned figures are, and what the fit says of it."""
    found: dict[Keys, float] = {}
    for one in calibration.learned:
        keys = _prior_of(one, calibration.learned)
        if keys is not None:
            found[keys] = max(one.relative, found.get(keys, _FLOORS.get(keys, 0.0)))
    return found


def _prior_of(one: Learned, learned: Sequence[Learned]) -> Keys | None:
    """Where its 1σ stands, if what has been learned is all that this stands for."""
    prior = one.parameter.prior
    if prior is None or prior[-1] == "stiffness_relative":
        names = {other.parameter.path[-1] for other in learned}
        return prior if prior is not None and names >= _STIFFNESSES else None
    return prior


_STIFFNESSES = {"cornering_stiffness_front", "cornering_stiffness_rear", "slip_stiffness"}


def _unit(calibration: Calibration, keys: Keys) -> str:
    """A standard deviation of a logarithm is a share; of others it is in the figure's unit."""
    return next(
        "-" if one.parameter.is_log else one.parameter.unit
        for one in calibration.learned
        if one.parameter.prior == keys
    )


def _source(before: Any, calibration: Calibration) -> str:
    names = ", ".join(one.parameter.name for one in calibration.learned)
    logs = ", ".join("".join(c if c.isprintable() else "?" for c in name) for name in calibration.logs)
    kind = "maximum a posteriori" if calibration.uses_prior else "maximum likelihood"
    road = "" if calibration.road_friction is None else f", road friction {calibration.road_friction:g}"
    told = f"{names} learned from {logs} ({kind}, estimator {calibration.estimator}{road})"
    whole = f"{before}; {told}" if isinstance(before, str) and before else told
    return whole if len(whole) <= _LONGEST_SOURCE else told[: _LONGEST_SOURCE - 1] + "…"


def _set(data: dict[str, Any], keys: Keys, value: str) -> None:
    for key in keys[:-1]:
        inner = data.get(key)
        data[key] = dict(inner) if isinstance(inner, dict) else {}
        data = data[key]
    data[keys[-1]] = value


def _written(value: float, unit: str, std: float) -> str:
    """A figure to a hundredth of its standard deviation, with its unit."""
    digits = 6
    if std > 0 and value:
        digits = int(np.clip(np.ceil(np.log10(abs(value) / std)) + 3, 3, 12))
    number = f"{value:.{digits}g}"
    return number if unit == "-" else f"{number} {unit}"


def _short(value: float) -> str:
    return f"{value:.2g}" if value < 100 else f"{value:.0f}"


def _lines(data: Mapping[str, Any], path: Keys, notes: Mapping[Keys, str]) -> list[str]:
    lines: list[str] = []
    indent = "  " * len(path)
    for key, value in data.items():
        here = (*path, key)
        head = f"{indent}{_scalar(key)}:"
        if isinstance(value, dict):
            lines += [head, *_lines(value, here, notes)] if value else [f"{head} {{}}"]
        elif isinstance(value, list):
            lines.append(f"{head} [{', '.join(_scalar(item) for item in value)}]")
        elif value is None:
            lines.append(head)
        else:
            note = f"  # {notes[here]}" if here in notes else ""
            lines.append(f"{head} {_scalar(value)}{note}")
    return lines


def _scalar(value: Any) -> str:
    """A scalar in one line, quoted where it must be."""
    text = str(value)
    if _PLAIN.fullmatch(text) and text == text.strip() and text[0] not in "-%*. ?" and not text.endswith(":"):
        return text
    return yaml.safe_dump(text, width=10**9, allow_unicode=True, default_style='"').strip()
