"""Whatever a mapping file or a recording holds, the end is a result or one line."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from recordings import recording

from roadstate.core import CHANNELS, InputError, Recording, Signal
from roadstate.io.mapping import Mapping, load_mapping
from roadstate.io.mapping_schema import json_schema
from roadstate.io.matching import Candidate, check_pattern

FUZZ = settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])

KEYS = re.findall(r'"([a-z_]+)": \{', json.dumps(json_schema()))
keys = st.sampled_from([*KEYS, "accel_x", "wheel_speed_fl", "ref_grade", "yaw_rate"])
scalars = (
    st.none()
    | st.booleans()
    | st.integers(-(10**30), 10**30)
    | st.floats()
    | st.text(max_size=20)
    | st.sampled_from(
        ["m/s", "km/h", "%", "-", "-Y", "X", "a", "3 m", "120 ms", "1e999", "nan", "deg/s", "drop", "*a*"]
    )
)
trees = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(keys | st.text(max_size=8), inner, max_size=5)
    ),
    max_leaves=25,
)


def outcome(path: Path) -> Mapping | InputError:
    """The mapping or the refusal that a file ends in."""
    try:
        return load_mapping(path)
    except InputError as error:
        refusal = error
    assert str(refusal).startswith(str(path))
    assert str(refusal).isprintable()
    assert len(str(refusal)) < len(str(path)) + 1000
    return refusal


@given(st.binary(max_size=300))
@example(b"\xff\xfe\x00")
@example(b"a: &a [*a]")
@example(b"? [a]\n: b")
@example(b"? {a: b}\n: c")
@example(b"<<: {channels: {}}")
@example(b"channels: !!python/name:os.system x")
@example(b"a: " + b"[" * 290)
@example(b"--- a\n--- b")
@example(b'"\\UFFFFFFFF": 1')
@example(b"%YAML 9.9\n---\na: b")
@FUZZ
def test_any_bytes(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "m.yaml"
    path.write_bytes(data)
    outcome(path)


@given(st.text(max_size=300))
@FUZZ
def test_any_text(tmp_path: Path, text: str) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(text, encoding="utf-8", errors="replace")
    outcome(path)


@given(st.dictionaries(keys, trees, max_size=6))
@example({"channels": {"speed": {"from": [[["a"]]]}}})
@example({"channels": {"speed": {"from": "a", "scale": "9" * 60 + " m/s"}}})
@example({"rotation": {"matrix": [[1e308] * 3] * 3}, "imu": {"accel": {"x": "a"}}})
@example({"imu": {"accel": {"x": {"y": "z"}}}})
@example({"imu": {"accel": {"x": 1, "from": "b"}}})
@FUZZ
def test_any_tree_of_known_keys(tmp_path: Path, tree: dict[str, Any]) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(yaml.safe_dump(tree, allow_unicode=True), encoding="utf-8", errors="replace")
    outcome(path)


def test_deep_nesting_ends_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    for text in ("[" * 50_000, "a: " * 50_000, "- " * 50_000, "{a: " * 20_000):
        path.write_text(text)
        assert isinstance(outcome(path), InputError)


# --- patterns --------------------------------------------------------------------------------------------


@given(st.text("ab(|)*+?.[]{}1,\\^$", max_size=60))
@example("a?" * 12 + "a" * 12)
@example("(a|aa)" * 15)
@example("(?:a?){20}a{20}")
@example(r"\(a+\)+")
@example("[(]a[*]*")
@settings(max_examples=300, deadline=None)
@pytest.mark.filterwarnings("ignore:Possible:FutureWarning")
def test_no_pattern_that_is_let_through_runs_for_ages(pattern: str) -> None:
    try:
        check_pattern(pattern)
    except InputError:
        return
    compiled = re.compile(pattern)
    start = time.perf_counter()
    for name in ("a" * 128, "a" * 64 + "b" * 64, "ab" * 64):
        compiled.fullmatch(name)
    assert time.perf_counter() - start < 5.0


@pytest.mark.parametrize("pattern", ["(a+)+$", "(a|a)*", "(?:x{2})+", "((a))*", "a?" * 31, "(a|b)" * 31])
def test_patterns_that_could_are_refused(pattern: str) -> None:
    with pytest.raises(InputError):
        check_pattern(pattern)


@pytest.mark.parametrize(
    "pattern", [r"ESP_\d+\.Gier.*", r"(?:yaw|gier)_?rate", r"[^.]*\.Speed\(raw\)", r"(?i)v.*fl"]
)
def test_patterns_that_people_write_are_let_through(pattern: str) -> None:
    check_pattern(pattern)


@given(st.text("*?[]a!-", max_size=40), st.text("a-", max_size=200))
@settings(max_examples=200, deadline=None)
def test_no_glob_runs_for_ages(glob: str, name: str) -> None:
    if not glob or not name:
        return
    start = time.perf_counter()
    Candidate(glob=glob).matches({name: Signal(np.zeros(1), np.zeros(1))})
    assert time.perf_counter() - start < 5.0


# --- applying --------------------------------------------------------------------------------------------

names = st.sampled_from(["a", "b", "m.a", "m.b@1", "m.b@2", "speed", "accel_x", "yaw_rate", "ok"])
samples = st.floats(width=32) | st.floats(-5, 5) | st.sampled_from([0.0, 1.0, -64.0])
steps = st.just(1.0) | st.sampled_from([1.0, 1.0, 1.0, 1.0, 0.1, 0.0, -1.0, np.nan, np.inf])


@st.composite
def signals(draw: st.DrawFn) -> Signal:
    size = draw(st.integers(0, 6))
    is_clean = draw(st.sampled_from([True, True, True, False]))
    time = np.cumsum(draw(st.lists(st.just(1.0) if is_clean else steps, min_size=size, max_size=size)))
    values = draw(st.lists(st.floats(-5, 5) if is_clean else samples, min_size=size, max_size=size))
    unit = draw(st.sampled_from([None, None, None, "", "m/s", "deg/s", "%", "g", "bar", "nonsense"]))
    message, bus = draw(st.sampled_from([(None, None), ("m", 1), ("m", 2), ("n", 1)]))
    return Signal(np.array(time, dtype=float), np.array(values, dtype=float), unit, "f", message, bus)


def specs(*units: str) -> st.SearchStrategy[dict[str, Any]]:
    """Settings of a channel that may be given in ``units``."""
    candidates = names | st.sampled_from([{"glob": "?"}, {"regex": "m.*"}, {"signal": "b", "bus": 1}])
    condition = st.fixed_dictionaries({"signal": names, "equals": st.sampled_from([0, 1])})
    rare = st.just({}) | st.just({}) | st.fixed_dictionaries({"valid": condition})
    plain = st.fixed_dictionaries(
        {
            "from": st.lists(candidates, min_size=1, max_size=4),
            "optional": st.sampled_from([True, True, False]),
        },
        optional={
            "unit": st.sampled_from(units),
            "sign": st.sampled_from([1, -1]),
            "scale": st.sampled_from([1, -2.5, 1e9, f"3 {units[0]}"]),
            "offset": st.sampled_from([0, 1, -1e9, f"1 {units[0]}"]),
            "delay": st.sampled_from([0, "120 ms", -3]),
            "invalid": st.lists(st.sampled_from([-64, 0]), max_size=2),
            "range": st.just([-100, 100]),
        },
    )
    return st.tuples(plain, rare).map(lambda parts: {**parts[0], **parts[1]})


rate, accel = specs("deg/s", "rad/s"), specs("m/s^2", "g")
contents = st.fixed_dictionaries(
    {},
    optional={
        "channels": st.fixed_dictionaries(
            {},
            optional={
                "speed": specs("m/s", "km/h"),
                "accel_y": accel,
                "wheel_speed_fl": specs("rad/s", "m/s"),
                "brake": specs("-"),
            },
        ),
        "imu": st.fixed_dictionaries(
            {"gyro": st.fixed_dictionaries({"x": rate}, optional={"y": rate, "z": rate})}
        ),
        "reference": st.fixed_dictionaries(
            {
                "ref_grade": st.fixed_dictionaries(
                    {
                        "slope_of": specs("m", "km"),
                        "speed": specs("m/s", "km/h"),
                        "over": st.sampled_from([1, 20, 10_000]),
                        "min_speed": st.just(0.1),
                    }
                )
            }
        ),
        "time": st.sampled_from([{"repair": "drop"}, {"repair": "error"}]),
        "only_listed": st.booleans(),
    },
).flatmap(
    lambda c: st.sampled_from([{}, {"forward": "-Y", "up": "X"}, {"yaw": 0.1}]).map(
        lambda r: {**c, "rotation": r} if r and "imu" in c else c
    )
)


@given(contents, st.dictionaries(names, signals(), max_size=5), st.sampled_from([None, 0.3, 0.0, np.nan]))
@example(
    {"channels": {"yaw_rate": {"from": ["a"]}}, "time": {"repair": "drop"}},
    {"a": Signal(np.array([np.inf, np.inf]), np.zeros(2), None, "f")},
    None,
)
@settings(max_examples=500, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@pytest.mark.filterwarnings("error")
def test_applying_ends_in_si_channels_or_one_line(
    content: dict[str, Any], raw: dict[str, Signal], radius: float | None
) -> None:
    try:
        mapping = Mapping.model_validate(content)
    except ValidationError:
        return
    before = {k: (s.time.copy(), s.values.copy()) for k, s in raw.items()}
    try:
        out = mapping.apply(Recording(raw, {"files": ["d/f.csv"]}), wheel_radius=radius)
    except InputError as error:
        out = Recording({}, {"mapped": {}, "refusal": str(error)})
    assert str(out.metadata.get("refusal", "")).isprintable()
    assert set(out.signals) <= set(CHANNELS) - {"time"}
    assert set(out.metadata["mapped"]) == set(out.signals)
    for name, signal in out.signals.items():
        assert signal.unit == CHANNELS[name].unit
        assert not np.isinf(signal.values).any()
        assert (np.diff(signal.time) > 0).all()
    for key, (then, values) in before.items():
        np.testing.assert_array_equal(raw[key].time, then)
        np.testing.assert_array_equal(raw[key].values, values)


@given(
    st.floats(-50, 50),
    st.floats(-5, 5).filter(lambda s: abs(s) > 1e-3),
    st.floats(-5, 5),
    st.sampled_from([1, -1]),
)
def test_the_formula(value: float, scale: float, offset: float, sign: int) -> None:
    spec = {"from": "w", "unit": "deg", "scale": scale, "offset": offset, "sign": sign}
    content = {"channels": {"steering_wheel": spec}, "only_listed": True}
    out = Mapping.model_validate(content).apply(recording(w=[value]))
    expected = sign * scale * np.radians(value) + offset
    assert out["steering_wheel"].values[0] == pytest.approx(expected, rel=1e-12, abs=1e-12)
