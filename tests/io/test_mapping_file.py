"""Mapping files as people write them, well and badly; their document and their schema."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from recordings import mapping_of

from roadstate.core import InputError
from roadstate.core.yaml_text import read_yaml
from roadstate.io.mapping import DEFAULT_MAPPING, Mapping, load_mapping
from roadstate.io.mapping_schema import SlopeMap, json_schema

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "mapping.md"
SCHEMA = ROOT / "docs" / "schema" / "mapping.schema.json"
EXAMPLES = sorted((ROOT / "examples").glob("*/mapping*.yaml"))
REGENERATE = (
    'python -c "import json, roadstate.io.mapping_schema as m; print(json.dumps(m.json_schema(), indent=2, '
    'ensure_ascii=False))" > docs/schema/mapping.schema.json'
)


def blocks() -> list[str]:
    return re.findall(r"^```yaml\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("chanels: {}", ", line 1: unknown key 'chanels'; did you mean 'channels'?"),
        (
            "channels: {acel_x: a}",
            ", line 1: channels: 'acel_x' is not a canonical channel; "
            "did you mean 'accel_x' or 'accel_z' or 'accel_y'?",
        ),
        (
            "channels:\n  speed:\n    from: v\n    sing: -1",
            ", line 4: channels.speed: unknown key 'sing'; did you mean 'sign'?",
        ),
        (
            "channels: {speed: {form: v}}",
            ", line 1: channels.speed: unknown key 'form'; did you mean 'from'?",
        ),
        (
            "channels: {speed: {from: [{glop: v}]}}",
            ", line 1: channels.speed.from.0: unknown key 'glop'; did you mean 'glob'?",
        ),
        (
            "imu:\n  accel:\n    x: a\n    dealy: 1",
            ", line 3: imu.accel.x: unknown key 'dealy'; did you mean 'delay'?",
        ),
        (
            "reference: {ref_grade: {slope_of: h, speed: v, over: 9, min_sped: 1}}",
            ", line 1: reference.ref_grade: unknown key 'min_sped'; did you mean 'min_speed' or 'speed'?",
        ),
        ("channels: {speed: {from: v, valid: {signal: s, equls: 1}}}", "did you mean 'equals'"),
        ("rotation: {forwards: X}\nimu: {accel: {x: a}}", "unknown key 'forwards'; did you mean 'forward'?"),
        ("channels: {speed: a, speed: b}", "channels.speed: given twice (first in line 1); keep one of them"),
        ("channels: {speed: {from: v, unit: kg}}", "channels.speed: unit 'kg' cannot be converted to 'm/s'"),
        ("channels: {speed: {from: v, unit: foo}}", "channels.speed.unit: unknown unit 'foo'"),
        ("channels: {speed: {from: v, delay: 3 m}}", "channels.speed.delay: unit 'm' does not fit"),
        ("channels: {speed: {from: v, delay: 70}}", "70 s is outside -60 to 60 s"),
        ("channels: {speed: {from: v, scale: 0}}", "'0' is no scale; write it like 3.2 or '3.2 N*m/%'"),
        ("channels: {speed: {from: v, scale: 1.2.3}}", "'1.2.3' is no scale"),
        ("channels: {speed: {from: v, scale: 3 N}}", "unit 'N' of the scale does not lead to 'm/s'"),
        ("channels: {speed: {from: v, offset: 3 N}}", "channels.speed.offset: unit 'N' does not fit"),
        ("channels: {speed: {from: v, offset: nan}}", "channels.speed.offset: 'nan' is not a number"),
        ("channels: {speed: {from: v, sign: 2}}", "channels.speed.sign: should be 1 or -1"),
        ("channels: {speed: {from: v, range: [3, 1]}}", "range [3, 1] is empty; give [least, largest]"),
        ("channels: {speed: {from: v, invalid: abc}}", "channels.speed.invalid.0: should be a valid number"),
        ("channels: {speed: {from: v, valid: {signal: s}}}", "'s' has none of equals, min, max"),
        ("channels: {speed: {from: {signal: a, glob: b}}}", "exactly one of signal, glob, regex"),
        ("channels: {speed: {from: []}}", "channels.speed.from: Value should have at least 1 item"),
        ("channels: {speed: {from: {regex: '('}}}", "regex '(' cannot be read"),
        ("channels: {speed: {from: {regex: '(a+)+b'}}}", "regex '(a+)+b' repeats a group"),
        ("channels: {speed: {from: {regex: '.*a.*b.*c.*d.*'}}}", "too many repeats and choices"),
        (f"channels: {{speed: {{from: {{regex: {'a' * 201}}}}}}}", "at most 200 characters"),
        ("channels: {time: t}", "time is no channel; use the section 'time:' instead"),
        ("time: {unit: m}", "time.unit: unit 'm' cannot be converted to 's'"),
        ("time: {repair: maybe}", "time.repair: should be 'error' or 'drop'"),
        ("rotation: {forward: X, up: Z}", "rotation: there is no imu to rotate"),
        ("rotation: {forward: X}\nimu: {accel: {x: a}}", "1 of the car's axes are named, two are needed"),
        ("rotation: {forward: X, up: -X}\nimu: {accel: {x: a}}", "forward and up lie on one axis"),
        ("rotation: {forward: Q, up: X}\nimu: {accel: {x: a}}", "rotation.forward: 'Q' is no axis"),
        ("rotation: {forward: X, left: Y, up: -Z}\nimu: {accel: {x: a}}", "is no right-handed set of axes"),
        ("rotation: {matrix: [[1, 0, 0], [0, 1, 0]]}\nimu: {accel: {x: a}}", "is no 3x3 matrix"),
        ("rotation: [[1, 0, 0], [0, 1, 0], [0, 0, 2]]\nimu: {accel: {x: a}}", "is not orthonormal within"),
        ("rotation: [[1, 0, 0], [0, 1, 0], [0, 0, -1]]\nimu: {accel: {x: a}}", "mirrors"),
        (
            "rotation: {forward: X, up: Z, matrix: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}\nimu: {accel: {x: a}}",
            "both a matrix and named axes",
        ),
        ("imu: {}", "imu: no sensor is given; give accel, gyro or both"),
        ("imu: {accel: {unit: g}}", "imu.accel: "),
        ("imu: {gyro: {x: {from: a, unit: m}}}", "imu.gyro.x: unit 'm' cannot be converted to 'rad/s'"),
        ("imu: {accel: {x: a}}\nchannels: {accel_y: b}", "accel_y is also made from imu"),
        ("reference: {speed: a}", "speed is no reference; move it to 'channels:'"),
        (
            "channels: {ref_grade: a}\nreference: {ref_grade: b}",
            "ref_grade is also listed under channels; keep one",
        ),
        ("reference: {ref_bank: {slope_of: a, speed: b, over: 9}}", "slope_of makes a grade"),
        ("reference: {ref_grade: {slope_of: a, speed: b}}", "reference.ref_grade: 'over' is missing; add it"),
        ("reference: {ref_grade: {slope_of: a, speed: b, over: 0}}", "0 m is outside 1 to 10000 m"),
        ("channels: [a, b]", "channels: should be a valid dictionary"),
        ("- a\n- b", ": is not a list of 'key: value' lines"),
        ("", ": the file is empty"),
        ("channels: {speed: *wheel}", "not valid YAML"),
        ("a: [", ", line 1: not valid YAML"),
        ("x: !!python/object/apply:os.system ['true']", "unknown key 'x'"),
    ],
)
def test_each_fault_is_one_line_that_names_file_line_and_key(
    tmp_path: Path, content: str, message: str
) -> None:
    with pytest.raises(InputError) as caught:
        mapping_of(tmp_path, content)
    text = str(caught.value)
    assert text.startswith(str(tmp_path / "mapping.yaml"))
    assert message in text
    assert "\n" not in text
    assert len(text) < 600


def test_several_faults_are_counted(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\(1 more to mend after it\)$"):
        mapping_of(tmp_path, "chanels: {}\nrotations: {}")


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        load_mapping(tmp_path / "absent.yaml")
    with pytest.raises(InputError, match="is a folder"):
        load_mapping(tmp_path)
    path = tmp_path / "log.mf4"
    path.write_bytes(b"MDF     4.10\xff\xfe\x80")
    with pytest.raises(InputError, match="not UTF-8 text"):
        load_mapping(path)
    path.write_bytes(b"#" * 1_000_001)
    with pytest.raises(InputError, match="over 1 MB"):
        load_mapping(path)


def test_sections_may_be_empty_and_keys_may_carry_a_byte_order_mark(tmp_path: Path) -> None:
    assert mapping_of(tmp_path, "\ufeffchannels:\nreference:\n") == DEFAULT_MAPPING


def test_words_that_yaml_reads_its_own_way_stay_words(tmp_path: Path) -> None:
    mapping = mapping_of(tmp_path, "channels: {speed: no, accel_x: 12:30, brake: 0x10}")
    assert [c.from_[0].signal for c in mapping.channels.values()] == ["no", "12:30", "0x10"]


def test_all_settings_reach_their_place(tmp_path: Path) -> None:
    mapping = mapping_of(
        tmp_path,
        """
time: {column: t_ms, unit: ms, repair: drop}
channels:
  yaw_rate:
    from: [a, {regex: "b.*", bus: 2, message: M}]
    unit: deg/s
    sign: -1
    scale: 1.5
    offset: 1 deg/s
    delay: 120 ms
    valid: [{signal: ok, equals: true}, {signal: acc, max: 3, min: -1}]
    invalid: [-64, 1e9]
    range: [-300, 300]
    optional: true
only_listed: true
""",
    )
    assert (mapping.time_column, mapping.time_unit, mapping.time.repair) == ("t_ms", "ms", "drop")
    assert mapping.only_listed
    spec = mapping.channels["yaw_rate"]
    assert (spec.from_[1].regex, spec.from_[1].bus, spec.from_[1].message) == ("b.*", 2, "M")
    assert (spec.unit, spec.sign, spec.scale.value, spec.optional) == ("deg/s", -1, 1.5, True)
    assert spec.delay == pytest.approx(0.12)
    assert spec.offset_in("yaw_rate") == pytest.approx(0.0174532925)
    assert [(v.equals, v.min, v.max) for v in spec.valid] == [(1.0, None, None), (None, -1.0, 3.0)]
    assert spec.invalid == (-64.0, 1e9)
    assert spec.range == (-300.0, 300.0)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: f"{p.parent.name}/{p.name}")
def test_a_mapping_survives_being_dumped(path: Path) -> None:
    mapping = load_mapping(path)
    assert Mapping.model_validate(mapping.model_dump(by_alias=True, exclude_none=True)) == mapping
    assert Mapping.model_validate_json(mapping.model_dump_json(by_alias=True, exclude_none=True)) == mapping


def test_there_are_examples() -> None:
    assert [f"{p.parent.name}/{p.name}" for p in EXAMPLES] == [
        "comma2k19/mapping.yaml",
        "comma2k19/mapping_phone.yaml",
        "css_mf4/mapping.yaml",
        "revs_250lm/mapping.yaml",
    ]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: f"{p.parent.name}/{p.name}")
def test_no_example_is_compared_with_its_own_inputs(path: Path) -> None:
    mapping = load_mapping(path)
    inputs = {c for spec in mapping.channels.values() for c in spec.from_}
    truths = [s.slope_of if isinstance(s, SlopeMap) else s for s in mapping.reference.values()]
    assert truths
    assert not inputs & {c for spec in truths for c in spec.from_}


@pytest.mark.parametrize("block", blocks())
def test_the_documents_examples_load(tmp_path: Path, block: str) -> None:
    mapping_of(tmp_path, block)


def test_the_document_says_every_key() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for form in json_schema()["$defs"].values():
        for key in form.get("properties", {}):
            assert re.search(rf"`{key}`|\b{key}:", page), key


def test_the_exported_schema_is_current() -> None:
    assert json.loads(SCHEMA.read_text(encoding="utf-8")) == json_schema(), f"run: {REGENERATE}"


# --- the schema agrees with the loader -------------------------------------------------------------------


def fits(value: Any, form: dict[str, Any], root: dict[str, Any]) -> bool:
    """Whether data fits the part of JSON Schema that the schema uses; YAML's scalars are all texts here."""
    if "$ref" in form:
        return fits(value, root["$defs"][form["$ref"].rpartition("/")[2]], root)
    for kind in ("anyOf", "oneOf"):
        if kind in form:
            return any(fits(value, f, root) for f in form[kind])
    if isinstance(value, str):
        return form.get("type") in ("string", "number", "integer", "boolean")
    if isinstance(value, list):
        items = form.get("items", {})
        parts = form.get("prefixItems") or [items] * len(value)
        return form.get("type") == "array" and all(
            fits(v, p, root) for v, p in zip(value, parts, strict=False)
        )
    if form.get("type") != "object" or not set(form.get("required", ())) <= value.keys():
        return False
    names = form.get("propertyNames", {}).get("enum")
    other = form.get("additionalProperties", {})
    return all(
        (names is None or k in names)
        and (
            fits(v, form["properties"][k], root)
            if k in form.get("properties", {})
            else other and fits(v, other, root)
        )
        for k, v in value.items()
    )


@pytest.mark.parametrize("text", [*(p.read_text(encoding="utf-8") for p in EXAMPLES), *blocks()])
def test_the_schema_takes_what_the_loader_takes(text: str) -> None:
    assert fits(read_yaml(text, "example").data, json_schema(), json_schema())


@pytest.mark.parametrize(
    "text",
    [
        "chanels: {}",
        "channels: {acel_x: a}",
        "channels: {speed: {form: a}}",
        "reference: {speed: a}",
        "imu: {accel: {x: a, dealy: 1}}",
    ],
)
def test_the_schema_refuses_what_the_loader_refuses(text: str) -> None:
    assert not fits(read_yaml(text, "example").data, json_schema(), json_schema())
