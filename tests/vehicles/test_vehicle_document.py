"""The document and the exported schema say what the code does, and the document's examples load."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from roadstate.vehicles import json_schema, parse_vehicle

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "vehicle-file.md"
SCHEMA = ROOT / "docs" / "schema" / "vehicle.schema.json"
REGENERATE = (
    'python -c "import json, roadstate.vehicles as v; print(json.dumps(v.json_schema(), indent=2, '
    'ensure_ascii=False))" > docs/schema/vehicle.schema.json'
)


def blocks() -> list[str]:
    return re.findall(r"^```yaml\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


def rows() -> list[str]:
    """The table of keys as the schema has it."""
    schema = json_schema()
    return list(_rows(schema, schema["$defs"], ""))


def _rows(section: dict[str, Any], sections: dict[str, Any], prefix: str) -> Any:
    for key, field in section["properties"].items():
        name = f"{prefix}{key}"
        required = key in section.get("required", ())
        references = [f["$ref"] for f in (field, *field.get("anyOf", ())) if "$ref" in f]
        if references:
            inner = sections[references[0].removeprefix("#/$defs/")]
            yield f"| **`{name}`** | | {'required' if required else 'optional'} | {field['description']} |"
            yield from _rows(inner, sections, f"{name}.")
            continue
        meaning, unit = field["description"], ""
        if bracketed := re.fullmatch(r"(.*) \[([^\]]*)\]", meaning):
            meaning, unit = bracketed.groups()
        if field.get("type") == "boolean":
            unit = "`true`, `false`"
        choices = ", ".join(f"`{c}`" for c in field.get("enum", ()))
        default = "required" if required else json.dumps(field["default"], ensure_ascii=False)
        if default in ("null", "[]", '""'):
            default = "none"
        yield f"| `{name}` | {unit or choices or 'text'} | {default} | {meaning} |"


def test_the_table_of_keys_is_the_schema_s() -> None:
    printed = [
        line for line in PAGE.read_text(encoding="utf-8").splitlines() if re.match(r"\| (\*\*)?`", line)
    ]
    assert printed == rows()


def test_the_exported_schema_is_current() -> None:
    exported = json.loads(SCHEMA.read_text(encoding="utf-8"))
    assert exported == json_schema(), f"write it anew: {REGENERATE}"
    assert REGENERATE in PAGE.read_text(encoding="utf-8")


def test_the_page_has_examples() -> None:
    assert len(blocks()) >= 2


@pytest.mark.parametrize("text", blocks(), ids=lambda text: text.split("\n")[0])
def test_an_example_of_the_page_loads(text: str) -> None:
    assert parse_vehicle(text, "docs/vehicle-file.md").mass > 0


def test_every_quantity_of_the_schema_tells_its_unit() -> None:
    def quantities(node: Any) -> Any:
        if isinstance(node, dict):
            kinds = {option.get("type") for option in node.get("anyOf", ())}
            if {"number", "string"} <= kinds:
                yield node
            for value in node.values():
                yield from quantities(value)
        elif isinstance(node, list):
            for item in node:
                yield from quantities(item)

    found = list(quantities(json_schema()))
    assert len(found) > 40
    assert all(isinstance(q.get("unit"), str) for q in found)


def test_the_schema_knows_mass_in_kilograms() -> None:
    mass = json_schema()["properties"]["mass"]
    assert mass["unit"] == "kg"
    assert mass["description"].endswith("[kg]")
    assert {option["type"] for option in mass["anyOf"]} == {"number", "string"}
    assert json_schema()["additionalProperties"] is False


def test_the_page_s_python_runs(capsys: pytest.CaptureFixture[str]) -> None:
    code = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    assert len(code) == 1
    exec(code[0], {})
    # 1500 kg on 2.7 m; in first gear 4·1.0/0.308² + 0.2·(3.62·4.06)²/0.308² kg on top
    assert capsys.readouterr().out == "8445 N, 6265 N, 0.622 m², 1998 kg\n"
