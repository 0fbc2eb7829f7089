"""Reading a vehicle file: what it gives, and the one line each mistake gets."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

import roadstate.vehicles
from roadstate.core import InputError
from roadstate.vehicles import Vehicle, load_vehicle, parse_vehicle

GOOD = """\
name: car
mass: 1500 kg
yaw_inertia: 2500 kg*m^2
geometry:
  cg_to_front_axle: 1.2 m
  cg_to_rear_axle: 1.8 m
  cg_height: 0.55 m
  track_front: 1.55 m
  track_rear: 1.54 m
wheels: {radius: 0.3 m, inertia: 0.9}
steering:
  ratio: 15
aerodynamics: {drag_coefficient: 0.3, frontal_area: 2 m^2}
driveline:
  driven: front
  gear_ratios: [4.0, 2.0]
  final_drive: 3.0
  engine_inertia: 0.2
tires: {cornering_stiffness_front: 10, cornering_stiffness_rear: 16}
"""


def edited(old: str, new: str) -> str:
    assert GOOD.count(old) == 1
    return GOOD.replace(old, new)


def refusal(text: str) -> str:
    with pytest.raises(InputError) as caught:
        parse_vehicle(text, "car.yaml")
    message = str(caught.value)
    assert message.isprintable()  # one line, no escape sequences
    return message


def test_derived_figures_by_hand() -> None:
    car = parse_vehicle(GOOD, "car.yaml")
    assert car.wheelbase == car.geometry.wheelbase == pytest.approx(3.0)
    # 1500 kg × 9.80665 m/s² = 14709.975 N; the axles carry 1.8/3 and 1.2/3 of it
    assert car.static_axle_loads == pytest.approx((8825.985, 5883.99))
    assert car.axle_cornering_stiffness == pytest.approx((88259.85, 94143.84))
    assert car.drag_area == pytest.approx(0.6)
    # 1/10 − 1/16 = 0.0375 rad per g
    assert car.understeer_gradient == pytest.approx(0.0375 / 9.80665)
    assert car.driveline.total_ratios == pytest.approx((12.0, 6.0))
    # four wheels: 4 × 0.9/0.09 = 40 kg; engine in first gear: 0.2 × 144/0.09 = 320 kg
    assert car.effective_mass() == pytest.approx(1540.0)
    assert car.effective_mass(12.0) == pytest.approx(1860.0)


def test_understeer_is_what_the_axle_stiffnesses_give() -> None:
    car = parse_vehicle(GOOD, "car.yaml")
    front, rear = car.axle_cornering_stiffness
    classical = (car.mass / car.wheelbase) * (
        car.geometry.cg_to_rear_axle / front - car.geometry.cg_to_front_axle / rear
    )
    assert car.understeer_gradient == pytest.approx(classical)


def test_dual_rear_tires_turn_with_the_rest() -> None:
    car = parse_vehicle(edited("inertia: 0.9}", "inertia: 0.9, dual_rear: true}"), "car.yaml")
    assert car.effective_mass() == pytest.approx(1560.0)


def test_optional_sections_have_defaults_or_are_absent() -> None:
    car = parse_vehicle(edited("steering:\n  ratio: 15\n", "steering:\nsensors:\n"), "car.yaml")
    assert car.steering is None
    assert car.brakes is None
    assert car.source == "not stated"
    assert car.prior.grade_std == 0.08
    assert car.sensors.accel.noise_density > 0


def test_text_stays_text() -> None:
    """YAML 1.1 would read these as false, 8 and a date."""
    for name in ("no", "010", "2018-08-02"):
        assert parse_vehicle(edited("name: car", f"name: {name}"), "car.yaml").name == name


def test_a_vehicle_is_frozen() -> None:
    car = load_vehicle("suv")
    with pytest.raises(ValidationError, match="frozen"):
        car.mass = 1.0  # type: ignore[misc]
    assert hash(car) == hash(load_vehicle("suv"))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass: 1500 kg", "mass: -1500 kg", "car.yaml, line 2: mass: -1500 kg is outside 50 to 200000 kg"),
        ("mass: 1500 kg", "mass: 1.5 m", "car.yaml, line 2: mass: unit 'm' does not fit: this is in kg;"),
        ("mass: 1500 kg", "mas: 1500 kg", "car.yaml, line 2: mas: unknown key; did you mean 'mass'?"),
        ("mass: 1500 kg\n", "", "car.yaml: mass: is missing; add 'mass': Mass of the car as driven"),
        ("mass: 1500 kg", "mass:", "car.yaml, line 2: mass: is missing; add 'mass'"),
        ("mass: 1500 kg", "mass: 1e3\nmass: 2e3", "line 3: mass: given twice (first in line 2); keep one"),
        (
            "  cg_height: 0.55 m",
            "  cg_hight: 1",
            "line 7: geometry.cg_hight: unknown key; did you mean 'cg_h",
        ),
        ("  cg_height: 0.55 m\n", "", "car.yaml, line 4: geometry.cg_height: is missing; add 'cg_height'"),
        ("  cg_height: 0.55 m", "  cg_height: 55", "geometry.cg_height: 55 m is outside 0.1 to 4 m;"),
        ("  cg_to_rear_axle: 1.8 m", "  cg_to_rear_axle: -1.8 m", "geometry.cg_to_rear_axle: -1.8 m is out"),
        ("name: car", "name: car\nradius: 0.3", "line 2: radius: unknown key; it belongs under 'wheels'"),
        ("name: car", "name: [car]", "line 1: name: is not text; write"),
        ("name: car", 'name: "\\e[31m"', "line 1: name: holds characters that cannot be shown"),
        ("driven: front", "driven: back", "driveline.driven: not one of the choices; choose 'front', 'rear'"),
        ("gear_ratios: [4.0, 2.0]", "gear_ratios: 4.0", "gear_ratios: is not a list; write it in brackets"),
        ("gear_ratios: [4.0, 2.0]", "gear_ratios: [2.0, 4.0]", "driveline.gear_ratios: ratios do not fall"),
        ("gear_ratios: [4.0, 2.0]", "gear_ratios: [4.0, 2 m]", "driveline.gear_ratios[2]: unit 'm' does not"),
        ("  final_drive: 3.0\n", "", "driveline.final_drive: is missing; give the final drive's ratio"),
        (
            "  driven: front",
            "  driven: front\n  kind: in_wheel",
            "gear_ratios: in-wheel motors have no gearbox",
        ),
        ("  driven: front", "  driven: front\n  efficiency: 1.1", "efficiency: 1.1 is outside 0.1 to 1;"),
        ("ratio: 15", "ratio: 15:1", "steering.ratio: '15:1' is not a number; write it with a decimal point"),
        (
            "steering:\n  ratio: 15",
            "steering: 15",
            "steering: is a section, not a value; write its keys below",
        ),
        ("yaw_inertia: 2500 kg*m^2", "yaw_inertia: 25000", "yaw_inertia: 25000 kg*m^2 is 7.7 times mass·l_f"),
        ("inertia: 0.9}", "inertia: 0.9, dual_rear: perhaps}", "wheels.dual_rear: is neither true nor false"),
        ("name: car", "name: &a car\ndescription: *a", "line 1: a YAML alias (*name); write the value out"),
        ("name: car", "name: car\n? [a]\n: b", "line 2: a key is not a word"),
        (
            "name: car",
            "name: car: x",
            "car.yaml, line 1: not valid YAML (mapping values are not allowed here)",
        ),
        (
            "name: car",
            'name: "\\ud800"',
            "car.yaml, line 1: a character that does not exist; check the escapes",
        ),
        (
            "name: car",
            'name: car\n"\\ud800": 1',
            "line 2: a character that does not exist; check the escapes",
        ),
        ("name: car", 'name: "\\UFFFFFFFF"', "car.yaml: not valid YAML; check the escapes in quoted text"),
    ],
)
def test_a_mistake_gets_one_helpful_line(old: str, new: str, message: str) -> None:
    assert message in refusal(edited(old, new))


def test_more_mistakes_are_counted() -> None:
    text = GOOD.replace("mass: 1500 kg", "mass: -1").replace("cg_height: 0.55 m", "cg_height: 1 kg")
    assert refusal(text).endswith("(1 more to mend after it)")


def test_in_wheel_motors_have_no_engine() -> None:
    text = edited("  gear_ratios: [4.0, 2.0]\n", "  kind: in_wheel\n")
    assert "driveline.engine_inertia: in-wheel motors have no engine; add the rotor" in refusal(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "car.yaml: is empty"),
        ("# nothing\n", "car.yaml: is empty"),
        ("- a\n- b\n", "car.yaml: is not a list of 'key: value' lines"),
        ("a: 1\n---\nb: 2\n", "car.yaml, line 2: not valid YAML"),
        ("[" * 50_000, "car.yaml: nested too deep"),
        ("!!python/object/apply:os.system [echo]", "car.yaml: is not a list of 'key: value' lines"),
    ],
)
def test_what_is_no_vehicle_file_is_said_to_be_none(text: str, message: str) -> None:
    assert message in refusal(text)


def test_an_alias_bomb_is_refused_before_it_grows() -> None:
    levels = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    levels += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 30)]
    assert "a YAML alias" in refusal("\n".join(levels))


def test_a_stranger_s_key_is_cut_and_cannot_reach_the_terminal() -> None:
    message = refusal(edited("name: car", f'name: car\n"\\e[31m{"k" * 5000}": 1'))
    assert len(message) < 500


def test_names_and_paths(tmp_path: Path) -> None:
    file = tmp_path / "car.yaml"
    file.write_bytes(b"\xef\xbb\xbf" + GOOD.encode())
    assert load_vehicle(file) == load_vehicle(str(file)) == parse_vehicle(GOOD, "x")
    assert load_vehicle("family-car").name == "family-car"


def test_unknown_names_and_unreadable_files(tmp_path: Path) -> None:
    def message(name: str | Path) -> str:
        with pytest.raises(InputError) as caught:
            load_vehicle(name)
        return str(caught.value)

    everything = "compact-car, family-car, in-wheel-ev, suv, truck"
    assert message("family_car") == (
        "vehicle: 'family_car' is neither a preset vehicle nor a file; did you mean 'family-car'? "
        f"presets: {everything}; or give the path of a vehicle file"
    )
    assert f"presets: {everything}; or give" in message("zzz")
    assert message(tmp_path / "no.yaml").endswith(
        f"no.yaml: no such file; check the path; presets: {everything}"
    )
    assert message(tmp_path).endswith("is a folder; give a vehicle file")
    assert "no such file" in message("a/\0b")
    large = tmp_path / "large.yaml"
    large.write_text(GOOD + "#" * 1_000_001)
    assert message(large).endswith("is larger than 100 kB; is it a vehicle file?")
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00")
    assert "is not text in UTF-8" in message(binary)


def test_the_package_offers_what_it_says() -> None:
    for name in roadstate.vehicles.__all__:
        assert getattr(roadstate.vehicles, name) is not None
        assert name in dir(roadstate.vehicles)
    with pytest.raises(AttributeError, match="no attribute 'vehicle'"):
        roadstate.vehicles.vehicle  # noqa: B018


def vehicle_or_refusal(text: str) -> None:
    try:
        result: Vehicle | str = parse_vehicle(text, "car.yaml")
    except InputError as error:
        result = str(error)
    if isinstance(result, str):
        assert result.startswith("car.yaml")
        assert result.isprintable()
    else:
        assert result.mass >= 50


@settings(deadline=None)  # the first unit loads the unit library
@given(st.text())
def test_any_text_is_a_vehicle_or_refused(text: str) -> None:
    vehicle_or_refusal(text)


_SCALARS = st.sampled_from(
    [
        "",
        "~",
        "1500",
        "-3",
        "1.5 t",
        "55 cm",
        "nan",
        "true",
        "front",
        "x",
        "*a",
        "&a 3",
        "!!int z",
        "'",
        '"\\ud800"',
    ]
)
_KEYS = re.findall(r"(\w+):", GOOD)
_TREES = st.recursive(
    _SCALARS,
    lambda inner: (
        st.lists(inner, max_size=3).map(lambda v: f"[{', '.join(v)}]")
        | st.dictionaries(st.sampled_from(_KEYS), inner, max_size=3).map(
            lambda d: "{" + ", ".join(f"{k}: {v}" for k, v in d.items()) + "}"
        )
    ),
    max_leaves=6,
)


@settings(deadline=None)
@given(st.lists(st.tuples(st.sampled_from(_KEYS), _TREES), max_size=8))
def test_any_keys_with_any_values_are_a_vehicle_or_refused(lines: list[tuple[str, str]]) -> None:
    vehicle_or_refusal("\n".join(f"{k}: {v}" for k, v in lines))


@settings(deadline=None)
@given(st.integers(0, len(GOOD)), st.integers(0, 12), st.text(max_size=6))
def test_a_damaged_file_is_a_vehicle_or_refused(at: int, cut: int, put: str) -> None:
    vehicle_or_refusal(GOOD[:at] + put + GOOD[at + cut :])
