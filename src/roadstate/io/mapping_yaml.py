"""A mapping file nobody has checked, read into plain data, and its faults told in one line."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from roadstate.core import InputError
from roadstate.core.channels import did_you_mean
from roadstate.core.yaml_text import YamlMapping, read_yaml, short
from roadstate.io.mapping_schema import json_schema
from roadstate.io.paths import check_file

_MAX_BYTES = 1_000_000
_TAGS = ("map", "slope")  # what pydantic puts into a place to tell the forms of an entry apart


def read_mapping_file(path: str | Path) -> YamlMapping:
    """The file's keys and values, with their lines.

    Raises:
        InputError: no such file, too large, no text, no YAML, or a key given twice.
    """
    where = str(path)
    check_file(Path(path))
    with open(path, "rb") as file:
        data = file.read(_MAX_BYTES + 1)
    if len(data) > _MAX_BYTES:
        raise InputError("is over 1 MB", where=where, mend="is it a mapping file?")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError("is not UTF-8 text", where=where, mend="is it a mapping file?") from error
    return read_yaml(text, where)


def in_one_line(error: ValidationError, content: YamlMapping, where: str) -> InputError:
    """The first fault pydantic found, as one line that names file, line and key and how to mend it.

    Args:
        error: what pydantic found.
        content: the file, for its lines.
        where: the file's name.
    """
    # an unknown key explains a missing one
    faults = error.errors(include_url=False, include_input=False)
    fault = min(faults, key=lambda f: f["type"] == "missing")
    path = tuple(p for i, p in enumerate(fault["loc"]) if not (i == 2 and p in _TAGS))
    known = [path[:n] for n in range(len(path), 0, -1) if path[:n] in content.lines]
    place = f"{where}, line {content.lines[known[0]]}" if known else where
    shown = [short(str(p)) for p in path]
    context = fault.get("ctx", {})
    cause = context.get("error")
    mend = "see the table of keys in the documentation"
    if isinstance(cause, InputError):
        what, mend = cause.what, cause.mend or mend
        shown += [short(cause.where)] if cause.where else []
    elif fault["type"] == "refused":
        what, mend = context["what"], context["mend"]
    elif fault["type"] == "extra_forbidden":
        what = f"unknown key '{shown.pop()}'"
        mend = did_you_mean(str(path[-1]), _keys_at(shown))
    elif fault["type"] == "missing":
        what = f"'{shown.pop()}' is missing"
        mend = "add it"
    else:
        what = fault["msg"].removeprefix("Input ")
    if len(faults) > 1:
        mend += f" ({len(faults) - 1} more to mend after it)"
    return InputError(what, where=f"{place}: {'.'.join(shown)}" if shown else place, mend=mend)


def _keys_at(path: Iterable[str]) -> list[str]:
    """The keys that may stand at a place of the file, found by walking its JSON schema."""
    schema = json_schema()
    forms = [schema]
    for step in path:
        nearer = []
        for form in _resolved(forms, schema):
            if step in form.get("properties", {}):
                nearer.append(form["properties"][step])
            elif step.isdigit() and "items" in form:
                nearer.append(form["items"])
            elif isinstance(form.get("additionalProperties"), dict):
                nearer.append(form["additionalProperties"])
        # a list of one may stand in the file as the thing itself
        forms = nearer or (forms if step.isdigit() else [])
    return sorted({key for form in _resolved(forms, schema) for key in form.get("properties", {})})


def _resolved(forms: list[dict[str, Any]], schema: dict[str, Any]) -> list[dict[str, Any]]:
    plain: list[dict[str, Any]] = []
    queue = list(forms)
    while queue:
        form = queue.pop()
        if "$ref" in form:
            queue.append(schema["$defs"][form["$ref"].rpartition("/")[2]])
        elif "anyOf" in form or "oneOf" in form:
            queue += form.get("anyOf", []) + form.get("oneOf", [])
        else:
            plain.append(form)
    return plain
