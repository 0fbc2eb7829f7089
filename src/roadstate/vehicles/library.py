"""Vehicles by name or by file: the presets, the loader, and the schema for editors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from roadstate.core.channels import did_you_mean
from roadstate.core.errors import InputError
from roadstate.core.yaml_text import read_yaml
from roadstate.vehicles.messages import as_input_error
from roadstate.vehicles.parameters import Vehicle

_LARGEST = 100_000
"""Bytes; a vehicle file has a few thousand, and YAML is slow to read."""


@dataclass(frozen=True)
class VehicleSummary:
    """One line about a preset.

    Attributes:
        name: what ``load_vehicle`` takes.
        description: what car it is.
        mass: kg.
        driven: driven axle: ``front``, ``rear`` or ``all``.
    """

    name: str
    description: str
    mass: float
    driven: str


def load_vehicle(name_or_path: str | Path) -> Vehicle:
    """A preset by its name, or the vehicle that a YAML file describes.

    Args:
        name_or_path: a preset's name (see :func:`presets`), or a file; ``./suv`` is a file even where ``suv``
            is a preset.

    Raises:
        InputError: there is neither, or the file is not a valid vehicle file; names key and line.
    """
    name = str(name_or_path)
    return _preset(name) if name in _preset_texts() else parse_vehicle(vehicle_text(name_or_path), name)


def vehicle_text(name_or_path: str | Path) -> str:
    """The text of a preset's vehicle file, or of a file.

    Args:
        name_or_path: as of :func:`load_vehicle`.

    Raises:
        InputError: there is neither, or the file is too large or not text.
    """
    name = str(name_or_path)
    if name in _preset_texts():
        return _preset_texts()[name]
    path = Path(name_or_path)
    if not _exists(path):
        if path.suffix.lower() in (".yaml", ".yml") or len(path.parts) > 1:
            raise InputError("no such file", where=name, mend=f"check the path; presets: {_preset_list()}")
        close = did_you_mean(name, _preset_texts())
        hint = f"{close} " if close.startswith("did") else ""
        raise InputError(
            f"'{name}' is neither a preset vehicle nor a file",
            where="vehicle",
            mend=f"{hint}presets: {_preset_list()}; or give the path of a vehicle file",
        )
    return _read_text(path)


def parse_vehicle(text: str, where: str) -> Vehicle:
    """The vehicle that a vehicle file's text describes.

    Args:
        text: YAML.
        where: the file's name, for messages.

    Raises:
        InputError: not YAML, or not a valid vehicle; names key and line.
    """
    content = read_yaml(text, where)
    data = {key: value for key, value in content.data.items() if value is not None}
    try:
        return Vehicle.model_validate(data)
    except ValidationError as error:
        raise as_input_error(error, content, where) from None


def presets() -> dict[str, VehicleSummary]:
    """One line about each shipped vehicle, by name."""
    vehicles = {name: _preset(name) for name in _preset_texts()}
    return {n: VehicleSummary(n, v.description, v.mass, v.driveline.driven) for n, v in vehicles.items()}


def json_schema() -> dict[str, Any]:
    """JSON Schema of the vehicle file, for editors; ``unit`` beside each quantity is its SI unit."""
    schema = Vehicle.model_json_schema()
    for_editors(schema)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **schema,
        "title": "roadstate vehicle file",
    }


def for_editors(node: Any) -> None:
    """Change a schema for editors: the unit into each description, which they show; no titles of keys."""
    if isinstance(node, list):
        for item in node:
            for_editors(item)
    elif isinstance(node, dict):
        if isinstance(node.get("title"), str):
            del node["title"]
        unit = _unit_of(node)
        if unit is not None and "description" in node:
            node["description"] += f" [{unit}]"
        for value in node.values():
            for_editors(value)


def _unit_of(node: Mapping[str, Any]) -> str | None:
    inner = [node, node.get("items", {}), *node.get("anyOf", [])]
    return next((str(n["unit"]) for n in inner if isinstance(n.get("unit"), str)), None)


@cache
def _preset_texts() -> dict[str, str]:
    folder = resources.files("roadstate.vehicles").joinpath("presets")
    files = sorted((f for f in folder.iterdir() if f.name.endswith(".yaml")), key=lambda f: f.name)
    return {f.name.removesuffix(".yaml"): f.read_text(encoding="utf-8") for f in files}


@cache
def _preset(name: str) -> Vehicle:
    return parse_vehicle(_preset_texts()[name], f"preset {name}")


def _preset_list() -> str:
    return ", ".join(_preset_texts())


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # a name too long or with a NUL is no file
        return False


def _read_text(path: Path) -> str:
    where = str(path)
    if path.is_dir():
        raise InputError("is a folder", where=where, mend="give a vehicle file")
    try:
        with path.open("rb") as file:
            raw = file.read(_LARGEST + 1)
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", where=where, mend="check the path") from error
    if len(raw) > _LARGEST:
        raise InputError(f"is larger than {_LARGEST // 1000} kB", where=where, mend="is it a vehicle file?")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError("is not text in UTF-8", where=where, mend="is it a vehicle file?") from error
