"""Road files: read, refused, written and read again."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadstate.core import InputError
from roadstate.sim.roads import json_schema, load_road, parse_road, read_road, save_road

ROOT = Path(__file__).resolve().parents[2]
WORDS = ["9" * 20, "[", "{", ": ", "\n  ", "-", "nan", "1e400", "&a", "%"]
EXAMPLE = """\
name: hill with a wet spot
start_altitude: 250 m
heading: 35 deg
centreline:
  - {length: 0.2 km}
  - {length: 60, curvature: 0, end_curvature: 10 1/km}
  - {length: 150, curvature: 10 1/km}
grade:
  - {at: 0, grade: -1.8 deg}
  - {at: 200 m, grade: 6 %}
bank:
  - {at: 0, bank: 0}
  - {at: 260, bank: -2.5 %}
roughness: {road_class: B, seed: 4, period: 200 m}
friction:
  ground: 0.85
  edge: 20 cm
  patches:
    - {start: 100, stop: 125 m, left: 0, friction: 0.2}
"""


def test_road_is_what_the_file_says() -> None:
    road = parse_road(EXAMPLE, "road.yaml").build()
    assert float(road.at(0.0, 0.0).heading) == pytest.approx(np.deg2rad(35.0))
    start = road.at(0.0, 0.0)
    assert float(start.z - start.roughness) == pytest.approx(250.0)
    assert float(road.at(300.0, 0.0).curvature) == pytest.approx(0.01)
    p = road.at([110.0, 110.0, 90.0], [-1.0, 1.0, -1.0])
    assert np.asarray(p.friction) == pytest.approx([0.2, 0.85, 0.85])
    p = road.at([300.0, 301.0, 300.0], [0.0, 0.0, 2.0])
    smooth = np.asarray(p.z - p.roughness)
    assert smooth[1] - smooth[0] == pytest.approx(0.06, abs=1e-6)
    assert smooth[2] - smooth[0] == pytest.approx(-0.05, abs=1e-6)
    assert np.std(np.asarray(road.at(np.arange(0, 200, 0.1), 0.0).roughness)) > 1e-3


def test_saved_and_read_again_it_is_the_same(tmp_path: Path) -> None:
    spec = parse_road(EXAMPLE, "road.yaml")
    path = save_road(spec, tmp_path / "road.yaml")
    assert read_road(path) == spec
    a, b = spec.build(), load_road(path)
    s, d = np.linspace(0, 400, 50), np.linspace(-3, 3, 50)
    for x, y in zip(a.at(s, d), b.at(s, d), strict=True):
        assert np.array_equal(x, y)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("name: x\n", "centreline: no centreline"),
        ("centreline: [{length: 5 kg}]\n", "unit 'kg' does not fit"),
        ("centreline: [{length: 100}]\nfricton: {}\n", "did you mean 'friction'"),
        ("centreline: [{length: 100}]\nground: 0.3\n", "it belongs under 'friction'"),
        ("centreline: [{lenght: 100}]\n", "line 1: centreline[1].lenght: unknown key; did you mean 'length'"),
        ("centreline: [{length: 100}]\nroughness: {road_class: G}\n", "not one of the choices"),
        ("centreline: [{length: 100}]\nfriction: {ground: 9}\n", "outside 0.01 to 3"),
        ("centreline: [{length: 100}]\ngrade: [{at: 0, grade: 50 deg}]\n", "outside -0.7 to 0.7"),
        ("centreline: [{length: 100}]\ncrg: a.crg\n", "beside an OpenCRG file"),
        ("- 1\n", "not a list of 'key: value'"),
        ("a: *b\n", "not valid YAML"),
    ],
)
def test_bad_road_files_are_refused_in_one_line(text: str, what: str) -> None:
    with pytest.raises(InputError) as error:
        parse_road(text, "road.yaml")
    assert what in str(error.value)
    assert str(error.value).startswith("road.yaml")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("lines", "what"),
    [
        ("grade: [{at: 5, grade: 0}, {at: 5, grade: 0.1}]", "do not increase"),
        ("bank: [{at: 5, bank: 0}, {at: 3, bank: 0.1}]", "do not increase"),
        ("friction: {patches: [{start: 9, stop: 3, friction: 0.2}]}", "is empty"),
        ("friction: {patches: [{start: 9, stop: 9.1, friction: 0.2}]}", "nearer than their width"),
        ("roughness: {road_class: A, width: 50, period: 5000}", "too large"),
    ],
)
def test_roads_that_cannot_be_built_name_the_file(tmp_path: Path, lines: str, what: str) -> None:
    path = tmp_path / "road.yaml"
    path.write_text(f"centreline: [{{length: 100}}]\n{lines}\n", encoding="utf-8")
    with pytest.raises(InputError, match=what) as error:
        load_road(path)
    assert str(path) in str(error.value)


def test_files_that_are_none(tmp_path: Path) -> None:
    binary = tmp_path / "b.yaml"
    binary.write_bytes(b"\xff\xfe\x00\x01")
    big = tmp_path / "big.yaml"
    big.write_bytes(b"#" * 1_000_001)
    for path, what in (
        (tmp_path / "none.yaml", "cannot be read"),
        (tmp_path, "is a folder"),
        (binary, "UTF-8"),
        (big, "larger than 1000 kB"),
    ):
        with pytest.raises(InputError, match=what):
            load_road(path)


@pytest.mark.parametrize("name", ["/etc/passwd", "../secret.crg"])
def test_a_road_file_reads_nothing_elsewhere(tmp_path: Path, name: str) -> None:
    (tmp_path / "road.yaml").write_text(f"crg: {name}\n", encoding="utf-8")
    with pytest.raises(InputError, match="does not lie beside"):
        load_road(tmp_path / "road.yaml")


def test_exported_schema_is_current() -> None:
    exported = json.loads((ROOT / "docs" / "schema" / "road.schema.json").read_text(encoding="utf-8"))
    assert exported == json_schema(), "write it anew: see docs/simulation.md"
    assert exported["additionalProperties"] is False
    assert exported["$defs"]["Patch"]["properties"]["friction"]["unit"] == "-"


@settings(max_examples=150)
@given(st.integers(0, 2**32))
def test_random_damage_never_does_worse_than_an_input_error(seed: int) -> None:
    rng = np.random.default_rng(seed)
    text = list(EXAMPLE)
    for _ in range(int(rng.integers(1, 6))):
        place = int(rng.integers(0, len(text)))
        match int(rng.integers(0, 3)):
            case 0:
                text[place] = chr(int(rng.integers(1, 300)))
            case 1:
                del text[place]
            case _:
                text[place:place] = str(
                    rng.choice(["9" * 20, "[", "{", ": ", "\n  ", "-", "nan", "1e400", "&a", "%"])
                )
    try:
        spec = parse_road("".join(text), "road.yaml")
    except InputError:
        return
    assert spec.centreline
