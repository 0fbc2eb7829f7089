"""YAML as people write it, read safely: texts, lists and mappings, each with its line.

Scalars stay text. YAML's own guesses would turn ``15:1`` into 901, ``010`` into 8 and ``no`` into false; the
fields know better what they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import yaml

from roadstate.core.errors import InputError

Path = tuple[str | int, ...]
_SHORT = 80


@dataclass(frozen=True)
class YamlMapping:
    """A file's top mapping.

    Attributes:
        data: keys to text, ``None`` (nothing written), lists and mappings of these.
        lines: the line of each key and list item, from 1, by its path.
    """

    data: dict[str, Any]
    lines: dict[Path, int]


def short(text: str) -> str:
    """Text of a stranger's choosing, cut to what a message can bear."""
    return text if len(text) <= _SHORT else text[:_SHORT] + "…"


def read_yaml(text: str, where: str) -> YamlMapping:
    """Read one YAML document.

    Args:
        text: the document.
        where: named in messages.

    Raises:
        InputError: no valid YAML, not a mapping at its top, a key given twice, an alias, or nested too deep.
    """
    lines: dict[Path, int] = {}
    node = _compose(text, where)
    if node is None:
        raise InputError("is empty", where=where, mend="start from the example in the documentation")
    if not isinstance(node, yaml.MappingNode):
        raise InputError("is not a list of 'key: value' lines", where=where, mend="is it the right file?")
    return YamlMapping(_plain(node, (), lines, set(), where), lines)


def _compose(text: str, where: str) -> yaml.Node | None:
    try:
        node: yaml.Node | None = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f"{where}, line {mark.line + 1}" if mark is not None else where
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "cannot be read"
        raise InputError(
            f"not valid YAML ({short(problem)})", where=place, mend="check indentation, colons and quotes"
        ) from error
    except (ValueError, OverflowError) as error:  # an escape such as "\UFFFFFFFF" that is no character
        raise InputError("not valid YAML", where=where, mend="check the escapes in quoted text") from error
    except RecursionError as error:
        raise InputError("nested too deep", where=where, mend="is it the right file?") from error
    return node


def _plain(node: yaml.Node, path: Path, lines: dict[Path, int], seen: set[int], where: str) -> Any:
    line = node.start_mark.line + 1
    if id(node) in seen:
        # an alias is the very node it refers to; a few of them nested can stand for 10⁹ values
        raise InputError("a YAML alias (*name)", where=f"{where}, line {line}", mend="write the value out")
    seen.add(id(node))
    if isinstance(node, yaml.ScalarNode):
        _refuse_surrogates(node, where)
        nothing = node.style is None and node.value in ("", "~", "null")
        return None if nothing else node.value
    if isinstance(node, yaml.SequenceNode):
        items = []
        for i, item in enumerate(node.value):
            lines[(*path, i)] = item.start_mark.line + 1
            items.append(_plain(item, (*path, i), lines, seen, where))
        return items
    mapping: dict[str, Any] = {}
    for key_node, value in node.value:
        line = key_node.start_mark.line + 1
        if not isinstance(key_node, yaml.ScalarNode):
            raise InputError("a key is not a word", where=f"{where}, line {line}", mend="write 'key: value'")
        _refuse_surrogates(key_node, where)
        key = str(key_node.value)
        here = (*path, key)
        if key in mapping:
            dotted = ".".join(short(str(p)) for p in here)
            raise InputError(
                f"given twice (first in line {lines[here]})",
                where=f"{where}, line {line}: {dotted}",
                mend="keep one of them",
            )
        lines[here] = line
        mapping[key] = _plain(value, here, lines, seen, where)
    return mapping


def _refuse_surrogates(node: yaml.ScalarNode, where: str) -> None:
    """Refuse what an escape such as ``"\\ud800"`` makes: half a character, which nothing can encode."""
    if any("\ud800" <= c <= "\udfff" for c in node.value):
        line = node.start_mark.line + 1
        raise InputError(
            "a character that does not exist",
            where=f"{where}, line {line}",
            mend="check the escapes in quoted text",
        )
