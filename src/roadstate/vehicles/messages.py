"""What pydantic refuses in a vehicle file or its like, in one line: file, line, key, what, mend."""

from __future__ import annotations

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from roadstate.core.channels import did_you_mean
from roadstate.core.errors import InputError
from roadstate.core.yaml_text import Path, YamlMapping, short
from roadstate.vehicles.parameters import Vehicle


def as_input_error(
    error: ValidationError, content: YamlMapping, where: str, root: type[BaseModel] = Vehicle
) -> InputError:
    """The first thing to mend, in one line.

    Args:
        error: what pydantic found.
        content: the file, for its lines.
        where: the file's name.
        root: what the file describes.
    """
    # an unknown key comes first: a misspelt key is a missing one too
    details = sorted(
        error.errors(include_url=False, include_input=False), key=lambda d: d["type"] != "extra_forbidden"
    )
    detail = details[0]
    counted = [d for d in details[1:] if d["type"] != "missing" or detail["type"] != "extra_forbidden"]
    context = detail.get("ctx", {})
    path: Path = detail["loc"]
    if context.get("key"):
        path = (*path, context["key"])
    what, mend = _in_words(detail, path, root)
    if counted:
        mend += f" ({len(counted)} more to mend after it)"
    line = next((content.lines[path[:n]] for n in range(len(path), 0, -1) if path[:n] in content.lines), None)
    place = f"{where}, line {line}" if line else where
    return InputError(what, where=f"{place}: {_dotted(path)}" if path else place, mend=mend)


def _dotted(path: Path) -> str:
    text = "".join(f"[{p + 1}]" if isinstance(p, int) else f".{short(p)}" for p in path)
    return text.removeprefix(".")


def _in_words(detail: ErrorDetails, path: Path, root: type[BaseModel]) -> tuple[str, str]:
    kind, context = detail["type"], detail.get("ctx", {})
    if kind == "refused":
        return str(context["what"]), str(context["mend"])
    if kind == "extra_forbidden":
        return "unknown key", _where_it_belongs(path, root)
    if kind == "missing":
        return "is missing", f"add '{path[-1]}'{_meaning(path, root)}"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        known = ", ".join(_section(path, root).model_fields)
        return "is a section, not a value", f"write its keys below it, indented: {known}"
    if kind == "literal_error":
        return "not one of the choices", f"choose {context['expected']}"
    if kind == "tuple_type":
        return "is not a list", "write it in brackets, such as [3.6, 2.0, 1.3]"
    if kind in ("bool_parsing", "bool_type"):
        return "is neither true nor false", "write true or false"
    if kind == "string_type":
        return "is not text", "write a word or a line of text"
    if kind == "string_pattern_mismatch":
        return "holds characters that cannot be shown", "write plain text"
    return str(detail["msg"]), "see the table of keys in the documentation"


def _section(path: Path, root: type[BaseModel]) -> type[BaseModel]:
    """The model of the section at ``path``, or of the one around it."""
    model = root
    for key in path:
        field = model.model_fields.get(str(key))
        kinds = [] if field is None else [field.annotation, *getattr(field.annotation, "__args__", ())]
        inner = [k for k in kinds if isinstance(k, type) and issubclass(k, BaseModel)]
        if not inner:
            break
        model = inner[0]
    return model


def _meaning(path: Path, root: type[BaseModel]) -> str:
    field = _section(path[:-1], root).model_fields.get(str(path[-1]))
    return f": {field.description}" if field is not None and field.description else ""


def _where_it_belongs(path: Path, root: type[BaseModel]) -> str:
    name = str(path[-1])
    homes = [
        key
        for key in root.model_fields
        if _section((key,), root) is not root and name in _section((key,), root).model_fields
    ]
    if homes:
        return f"it belongs under '{homes[0]}'"
    known = _section(path[:-1], root).model_fields
    close = did_you_mean(name, known)
    return close if close.startswith("did") else f"known here: {', '.join(known)}"
