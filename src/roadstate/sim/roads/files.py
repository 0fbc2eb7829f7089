"""Road files: YAML in and out, OpenCRG in."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml
from pydantic import ValidationError

from roadstate.core.errors import InputError
from roadstate.core.tabular import atomic_path
from roadstate.core.yaml_text import read_yaml
from roadstate.sim.roads.spec import RoadSpec
from roadstate.vehicles.messages import as_input_error

if TYPE_CHECKING:
    from roadstate.sim.roads.road import Road

_LARGEST_YAML = 1_000_000  # bytes


def load_road(path: str | Path) -> Road:
    """The road of a road file (YAML) or of an OpenCRG file (``.crg``).

    Args:
        path: the file; its suffix tells the kind. An OpenCRG file alone has a friction of 0.85.

    Raises:
        InputError: no such file, or one that describes no road; names line and key.
    """
    from roadstate.sim.roads.friction import uniform
    from roadstate.sim.roads.opencrg import read_opencrg

    path = Path(path)
    if path.suffix.lower() == ".crg":
        return read_opencrg(path, uniform(RoadSpec.model_fields["friction"].default.ground))
    spec = read_road(path)
    try:
        if spec.crg is not None:
            return read_opencrg(_beside(path, spec.crg), spec.friction.build())
        return spec.build()
    except InputError as error:
        named = error.where is not None and error.where.startswith(str(path.parent))
        where = error.where if named else ": ".join(w for w in (str(path), error.where) if w)
        raise InputError(error.what, where=where, mend=error.mend) from error


def _beside(path: Path, name: str) -> Path:
    """A file that a road file names; a stranger's road file may name none elsewhere."""
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise InputError(f"'{name}' does not lie beside the road file", where="crg", mend="copy it there")
    return path.parent / name


def read_road(path: str | Path) -> RoadSpec:
    """What a road file says, without building the road.

    Raises:
        InputError: no such file, not YAML, or not a valid road; names line and key.
    """
    raw = read_bytes(Path(path), _LARGEST_YAML)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError("is not text in UTF-8", where=str(path), mend="is it a road file?") from error
    return parse_road(text, str(path))


def parse_road(text: str, where: str) -> RoadSpec:
    """What a road file's text says.

    Args:
        text: YAML.
        where: the file's name, for messages.

    Raises:
        InputError: not YAML, or not a valid road; names line and key.
    """
    content = read_yaml(text, where)
    try:
        return RoadSpec.model_validate({k: v for k, v in content.data.items() if v is not None})
    except ValidationError as error:
        raise as_input_error(error, content, where, RoadSpec) from None


def save_road(spec: RoadSpec, path: str | Path) -> Path:
    """Write a road file, figures in SI; it appears whole or not at all.

    Args:
        spec: the road; what is left at its default is left out.
        path: where.

    Raises:
        InputError: the folder cannot be written.
    """
    path = Path(path)
    data = spec.model_dump(mode="json", exclude_unset=True)
    text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, default_flow_style=None, width=100)
    with atomic_path(path) as part:
        part.write_text(text, encoding="utf-8")
    return path


def json_schema() -> dict[str, Any]:
    """JSON Schema of the road file, for editors; units as in that of the vehicle file."""
    from roadstate.vehicles.library import for_editors

    schema = RoadSpec.model_json_schema()
    for_editors(schema)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **schema,
        "title": "roadstate road file",
    }


def read_bytes(path: Path, largest: int) -> bytes:
    """A file's content, at most ``largest`` bytes.

    Raises:
        InputError: no such file, a folder, unreadable or too large.
    """
    where = str(path)
    try:
        if path.is_dir():
            raise InputError("is a folder", where=where, mend="give a file")
        with path.open("rb") as file:
            raw = file.read(largest + 1)
    except (OSError, ValueError) as error:  # a name with a NUL is a ValueError
        if isinstance(error, InputError):
            raise
        reason = getattr(error, "strerror", None) or "no such file"
        raise InputError(f"cannot be read ({reason})", where=where, mend="check the path") from error
    if len(raw) > largest:
        raise InputError(f"is larger than {largest // 1000} kB", where=where, mend="is it a road file?")
    return raw
