"""OpenCRG files, written here from closed forms, read back; damaged ones are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from roadstate.core import InputError
from roadstate.sim.roads import Road, load_road, uniform
from roadstate.sim.roads.opencrg import read_opencrg

STEP, V = 0.2, np.array([-1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5])
U = STEP * np.arange(301)


def phi(u: np.ndarray) -> np.ndarray:
    return 0.2 + 0.3 * np.sin(u / 20)


def reference(u: np.ndarray) -> np.ndarray:
    """Height of the reference line."""
    return 50.0 + 0.6 * (1 - np.cos(u / 15))


def bank(u: np.ndarray) -> np.ndarray:
    return 0.03 * np.sin(u / 12)


def grid(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return 0.01 * np.sin(u / 2) * (1 + 0.2 * v)


HEAD = f"""\
$CT                     ! comment
a road from closed forms
$
$ROAD_CRG
REFERENCE_LINE_INCREMENT = {STEP}
REFERENCE_LINE_START_Z = {reference(np.zeros(1))[0]}   ! m
REFERENCE_LINE_START_X = 7.0
LONG_SECTION_V_RIGHT = {V[0]}
LONG_SECTION_V_INCREMENT = 0.5
* a comment line
$
"""


def table() -> np.ndarray:
    middle = np.concatenate([[np.nan], U[1:] - STEP / 2])
    slope = np.concatenate([[np.nan], np.diff(reference(U)) / STEP])
    return np.column_stack([phi(middle), slope, bank(U), grid(U[:, None], V)])


def definition(kind: str, by_place: bool = False) -> str:
    names = [f"long section at v = {v:.3f}" if by_place else f"long section {i + 1}" for i, v in enumerate(V)]
    lines = [
        "$KD_DEFINITION",
        f"#:{kind}",
        "D:reference line phi,rad",
        "D:reference line slope,m/m",
        "D:reference line banking,m/m",
        *(f"D:{name},m" for name in names),
        "$",
        "$" * 72,
    ]
    return "\n".join(lines) + "\n"


def write(path: Path, kind: str, values: np.ndarray, head: str = HEAD, by_place: bool = False) -> Path:
    header = (head + definition(kind, by_place)).encode("latin-1")
    if kind in ("KRBI", "KDBI"):
        size = 4 if kind == "KRBI" else 8
        filled = np.concatenate([values.reshape(-1), np.full(-values.size % (80 // size), np.nan)])
        path.write_bytes(header + filled.astype(f">f{size}").tobytes())
        return path
    width, form = (10, "{:10.6f}") if kind == "LRFI" else (20, "{:20.12e}")
    per_line, rows = 80 // width, []
    for row in values:
        cells = ["**unused**".rjust(width) if np.isnan(v) else form.format(v) for v in row]
        rows += ["".join(cells[i : i + per_line]) for i in range(0, len(cells), per_line)]
    path.write_bytes(header + ("\n".join(rows) + "\n").encode())
    return path


@pytest.mark.parametrize("kind", ["LRFI", "LDFI", "KRBI", "KDBI"])
@pytest.mark.parametrize("by_place", [False, True])
def test_road_is_the_one_written(tmp_path: Path, kind: str, by_place: bool) -> None:
    road = load_road(write(tmp_path / "road.crg", kind, table(), by_place=by_place))
    check(road, 2e-4)


def check(road: Road, tolerance: float) -> None:
    rng = np.random.default_rng(0)
    u, v = rng.uniform(1, 59, 200), rng.uniform(-1.5, 1.5, 200)
    p = road.at(u, v)
    assert np.asarray(p.z) == pytest.approx(reference(u) + bank(u) * v + grid(u, v), abs=tolerance)
    assert np.asarray(p.heading) == pytest.approx(phi(u), abs=2e-4)
    assert np.asarray(p.curvature) == pytest.approx(0.015 * np.cos(u / 20), abs=2e-4)
    slope = 0.04 * np.sin(u / 15) + 0.0025 * np.cos(u / 12) * v + 0.005 * np.cos(u / 2) * (1 + 0.2 * v)
    assert np.asarray(p.dz_ds) == pytest.approx(slope, abs=1e-3)
    fine = np.linspace(0, 40, 40_001)
    x = 7.0 + np.sum(np.cos(phi(fine[1:] - 5e-4))) * 1e-3
    assert float(road.at(40.0, 0.0).x) == pytest.approx(x, abs=1e-3)
    assert np.asarray(p.friction) == pytest.approx(0.85)


def test_missing_heights_are_filled_across(tmp_path: Path) -> None:
    values = table()
    values[5:9, 3] = np.nan  # the right side
    values[40, 6] = np.nan  # in the middle
    road = read_opencrg(write(tmp_path / "a.crg", "KDBI", values), uniform(0.3))
    p = road.at([1.2, 8.0], [-1.5, 0.0])
    expected = [grid(1.2, -1.0) + bank(1.2) * -1.5 + reference(1.2), grid(8.0, 0.0) + reference(8.0)]
    assert np.asarray(p.z) == pytest.approx(expected, abs=1e-4)
    assert np.asarray(p.friction) == pytest.approx(0.3)


def test_least_file_is_a_straight_level_strip(tmp_path: Path) -> None:
    channels = "U:reference line u,m,0.0,1.0\nD:long section 1,m\nD:long section 2,m\n"
    text = f"$ROAD_CRG\n$\n$KD_DEFINITION\n#:LRFI\n{channels}$\n$$$$\n"
    path = tmp_path / "a.crg"
    path.write_text(text + "0.1       0.3\n0.2       0.4\n", encoding="latin-1")
    p = load_road(path).at([0.0, 1.0, 5.0, -3.0], [-0.005, 0.005, 1.0, -1.0])
    assert np.asarray(p.z) == pytest.approx([0.1, 0.4, 0.4, 0.1])
    assert np.asarray(p.y) == pytest.approx([-0.005, 0.005, 1.0, -1.0])


def test_surface_named_by_a_road_file_gets_its_friction(tmp_path: Path) -> None:
    write(tmp_path / "a.crg", "LDFI", table())
    path = tmp_path / "road.yaml"
    path.write_text("crg: a.crg\nfriction: {ground: 0.5, patches: [{stop: 10, friction: 0.2}]}\n", "utf-8")
    road = load_road(path)
    assert np.asarray(road.at([5.0, 20.0], 0.0).friction) == pytest.approx([0.2, 0.5])
    (tmp_path / "a.crg").write_bytes(b"nothing")
    with pytest.raises(InputError, match=r"a\.crg"):
        load_road(path)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda t: t.replace(b"$KD_DEFINITION", b"$SOMETHING"), "no block KD_DEFINITION"),
        (lambda t: t.replace(b"$" * 72, b"data"), "no line of"),
        (lambda t: t.replace(b"#:LDFI", b"#:XXXX"), "data of the kind 'XXXX'"),
        (lambda t: t.replace(b"phi,rad", b"phi,deg"), "is not in rad"),
        (lambda t: t.replace(b"INCREMENT = 0.2", b"INCREMENT = fast"), "gives no number"),
        (lambda t: t.replace(b"INCREMENT = 0.2", b"INCREMENT = -1"), "increment of -1"),
        (lambda t: t[:-90], "to a cross section"),
        (lambda t: t + b"\n" * 3 + b"hello" + b"\n" * 2, "line"),
        (lambda t: t.replace(b"e-01", b"q-01", 1), "is no number"),
        (lambda t: b"$ROAD_CRG_MODS\nSCALE_Z_GRID = 2\n$\n" + t, "scale_z_grid"),
        (lambda t: b"$ROAD_CRG_FILE\nother.crg\n$\n" + t, "refers to another file"),
        (lambda t: t.replace(b"long section 7", b"long section 6"), "side by side"),
        (lambda t: t.replace(b"long section 7", b"long section x"), "without a place"),
        (lambda t: t[: t.index(b"$$$$") + 73], "cross section"),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, change: object, what: str) -> None:
    path = write(tmp_path / "a.crg", "LDFI", table())
    path.write_bytes(change(path.read_bytes()))  # type: ignore[operator]
    with pytest.raises(InputError, match=what) as error:
        load_road(path)
    assert "\n" not in str(error.value)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 2**32), st.sampled_from(["LRFI", "KRBI"]), st.sampled_from(["flip", "cut", "insert"]))
def test_random_damage_never_does_worse_than_an_input_error(
    tmp_path: Path, seed: int, kind: str, how: str
) -> None:
    rng = np.random.default_rng(seed)
    path = write(tmp_path / "a.crg", kind, table()[:8])
    raw = bytearray(path.read_bytes())
    place = int(rng.integers(0, len(raw)))
    if how == "flip":
        raw[place] = int(rng.integers(0, 256))
    elif how == "cut":
        raw = raw[:place]
    else:
        raw[place:place] = rng.bytes(int(rng.integers(1, 30)))
    path.write_bytes(bytes(raw))
    try:
        road = load_road(path)
    except InputError:
        return
    p = road.at(0.7, 0.3)
    assert np.isfinite(float(p.z))
