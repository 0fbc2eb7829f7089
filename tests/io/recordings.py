"""Recordings made by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from roadstate.core import Recording, Signal
from roadstate.io.mapping import Mapping, load_mapping


def recording(time: Any = None, **signals: Any) -> Recording:
    """Signals on one time base, 1 s apart; each a list of values, or (values, unit), or a Signal."""
    made: dict[str, Signal] = {}
    time = None if time is None else np.asarray(time, dtype=float)
    for name, value in signals.items():
        if isinstance(value, Signal):
            made[name] = value
            continue
        values, unit = value if isinstance(value, tuple) else (value, None)
        if time is None:
            time = np.arange(len(values), dtype=float)
        made[name] = Signal(time, np.asarray(values, dtype=float), unit, f"drive.csv:{name}")
    return Recording(made, {"files": ["logs/drive.csv"], "format": "CSV"})


def can(
    values: Any, message: str, unit: str | None = None, bus: int | None = None, time: Any = None
) -> Signal:
    """A signal of a CAN message."""
    time = np.arange(len(values), dtype=float) if time is None else np.asarray(time, dtype=float)
    return Signal(time, np.asarray(values, dtype=float), unit, message=message, bus=bus)


def mapping_of(tmp_path: Path, content: str | dict[str, Any]) -> Mapping:
    """The mapping that a file with this content is."""
    path = tmp_path / "mapping.yaml"
    text = content if isinstance(content, str) else yaml.safe_dump(content, sort_keys=False)
    path.write_text(text, encoding="utf-8")
    return load_mapping(path)
