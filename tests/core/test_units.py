"""Unit texts: every alias, round trips, and refusals of what strangers' files may hold."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadstate.core import InputError
from roadstate.core.units import _ALIASES, convert, is_same_dimension, parse_unit, to_channel_unit

# what each text must be in SI, worked out by hand: (scale, offset)
DEGREE = np.pi / 180
EXPECTED = {
    "dimensionless": (1, 0),
    "percent": (0.01, 0),
    "degree": (DEGREE, 0),
    "degree/second": (DEGREE, 0),
    "degree_Celsius": (1, 273.15),
    "standard_gravity": (9.80665, 0),
    "millistandard_gravity": (9.80665e-3, 0),
    "revolution/minute": (2 * np.pi / 60, 0),
    "revolution/second": (2 * np.pi, 0),
    "kilorevolution/second": (2000 * np.pi, 0),
    "newton*meter": (1, 0),
    "kilometer/hour": (1 / 3.6, 0),
    "meter/second": (1, 0),
    "meter/second**2": (1, 0),
    "second": (1, 0),
    "millisecond": (1e-3, 0),
    "microsecond": (1e-6, 0),
    "pound": (0.45359237, 0),
    "metric_ton": (1000, 0),
    "kilogram*meter**2": (1, 0),
}


@pytest.mark.parametrize("alias", _ALIASES)
def test_every_alias_has_its_value(alias: str) -> None:
    unit = parse_unit(alias)
    assert (unit.scale, unit.offset) == pytest.approx(EXPECTED[_ALIASES[alias]], rel=1e-12)


@pytest.mark.parametrize(
    ("text", "target", "scale"),
    [
        ("m/s2", "m/s^2", 1),
        ("m/s²", "m/s^2", 1),
        ("m s-2", "m/s^2", 1),
        ("mm/s^2", "m/s^2", 1e-3),
        ("°/s", "rad/s", DEGREE),
        ("°/s²", "rad/s^2", DEGREE),
        ("deg/s", "rad/s", DEGREE),
        ("mrad", "rad", 1e-3),
        ("kNm", "N*m", 1000),
        ("N·m", "N*m", 1),
        ("ft*lbf", "N*m", 1.3558179483314),
        ("mph", "m/s", 0.44704),
        ("kn", "m/s", 1852 / 3600),
        ("mi/h", "m/s", 0.44704),
        ("bar", "Pa", 1e5),
        ("kPa", "Pa", 1000),
        ("MPa", "Pa", 1e6),
        ("psi", "Pa", 6894.757293168),
        ("RPM", "rad/s", 2 * np.pi / 60),
        ("kHz", "Hz", 1000),
        ("kg·m²", "kg*m^2", 1),
        ("kgm²", "kg*m^2", 1),
        ("t", "kg", 1000),
        ("µs", "s", 1e-6),
        ("[km/h]", "m/s", 1 / 3.6),
        (" km/h ", "m/s", 1 / 3.6),
        ("m/s^2/Hz^0.5", "m/s^1.5", 1),
        ("hp", "N*m/s", 745.6998715823),
    ],
)
def test_units_seen_in_logs(text: str, target: str, scale: float) -> None:
    assert convert(1.0, text, target) == pytest.approx(scale, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "value", "kelvin"),
    [("degC", 20, 293.15), ("°C", -40, 233.15), ("degF", -40, 233.15), ("degF", 212, 373.15), ("K", 5, 5)],
)
def test_temperatures_are_affine(text: str, value: float, kelvin: float) -> None:
    assert convert(value, text, "K") == pytest.approx(kelvin, abs=1e-9)
    assert convert(kelvin, "K", text) == pytest.approx(value, abs=1e-9)


@pytest.mark.parametrize("text", ["Grad", "grad", "GRAD"])
def test_german_degrees_are_degrees(text: str) -> None:
    assert convert(180.0, text, "rad") == pytest.approx(np.pi, rel=1e-12)
    assert convert(180.0, f"{text}/s", "rad/s") == pytest.approx(np.pi, rel=1e-12)
    assert convert(200.0, "gon", "rad") == pytest.approx(np.pi, rel=1e-12)


@pytest.mark.parametrize("text", ["1/s", "s^-1", "1/sec", "1/ms", "count/s"])
def test_a_rotation_speed_says_what_it_counts(text: str) -> None:
    with pytest.raises(InputError, match=r"counts no angle: revolutions or radians\?; .*rev/s .* or rad/s"):
        convert(1.0, text, "rad/s")
    assert convert(2.0, "1/min", "rad/s") == pytest.approx(2 * 2 * np.pi / 60)


def test_a_dimension_does_not_depend_on_how_it_is_written() -> None:
    texts = ["N*m", "m*N", "kg*m^2/s^2", "m^2/s^2*kg", "ft*lbf", "lbf*ft", "J"]
    assert len({parse_unit(t).dimension for t in texts}) == 1
    assert is_same_dimension("1/s", "deg/s")
    assert not is_same_dimension("km/h", "rad/s")


def test_an_array_that_needs_no_change_comes_back_itself() -> None:
    values = np.array([1.0, np.nan])
    assert convert(values, "m/s", "m/s") is values
    assert convert(values, "m/s2", "m/s^2") is values


@given(
    st.floats(-1e9, 1e9),
    st.sampled_from(
        [
            ("km/h", "mph"),
            ("rpm", "deg/s"),
            ("degF", "degC"),
            ("bar", "psi"),
            ("g", "m/s2"),
            ("%", "-"),
            ("lbf*ft", "Nm"),
        ]
    ),
)
def test_round_trips(value: float, units: tuple[str, str]) -> None:
    there = convert(value, *units)
    assert float(convert(there, *units[::-1])) == pytest.approx(value, rel=1e-12, abs=1e-9)


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=5))
def test_missing_stays_missing(values: list[float]) -> None:
    array = np.array(values, dtype=float)
    out = convert(array, "km/h", "m/s")
    np.testing.assert_array_equal(np.isnan(out), np.isnan(array))


@pytest.mark.parametrize(
    ("value", "unit", "angle"),
    [
        (100, "%", np.pi / 4),
        (5, "pct", np.arctan(0.05)),
        (5, "percent", np.arctan(0.05)),
        (0.05, "-", np.arctan(0.05)),
        (0.05, "1", np.arctan(0.05)),
        (0.05, "m/m", np.arctan(0.05)),
        (0.05, "dimensionless", np.arctan(0.05)),
        (50, "permille", np.arctan(0.05)),
        (50, "mm/m", np.arctan(0.05)),
        (5, "deg", 5 * DEGREE),
        (5, "°", 5 * DEGREE),
        (0.05, "rad", 0.05),
    ],
)
def test_a_slope_is_a_ratio_or_an_angle(value: float, unit: str, angle: float) -> None:
    slope = to_channel_unit(np.array([value]), unit, "rad", is_slope=True)
    np.testing.assert_allclose(slope, angle, rtol=1e-12)


def test_only_a_slope_reads_a_ratio_as_rise_over_run() -> None:
    assert to_channel_unit(np.array([100.0]), "%", "-") == pytest.approx(1.0)
    with pytest.raises(InputError, match="'km/h' cannot be converted to 'rad'"):
        to_channel_unit(np.array([1.0]), "km/h", "rad", is_slope=True)


HOSTILE = [
    "m**9**9**9",
    "m^9^9^9",
    "9**9**9**9",
    "(9**9)**(9**9)",
    "m**(9**9)",
    "m**99999999",
    "m^(-99999)",
    "((m**9)**9)**9",
    "(Ym**9)**9",
    "(ym**9)**9",
    "m" * 10_000,
    "(" * 5_000 + "m" + ")" * 5_000,
    "m*" * 5_000 + "m",
    "__import__",
    "__import__('os').system('true')",
    "registry._units",
    "().__class__",
    "lambda: 0",
    "1e999",
    "1e9*m",
    "3*m",
    "10",
    "nan",
    "inf",
    "m/0",
    "m;s",
    "m\x00s",
    "km/h\x1b[31m",
    "m'",
    'm"',
    "{m}",
    "☃",
    "٣m",
    "*",
    "/",
    "^",
    "**",
    "()",
    "m/",
    "/s",
    "m--s",
    "quatsch",
    "dB",
    "dBm",
    "Np",
    "octave",
    "decade",
]


@pytest.mark.parametrize("text", HOSTILE, ids=lambda t: t.encode("unicode_escape").decode()[:20])
def test_no_unit_is_refused_in_one_quick_line(text: str) -> None:
    parse_unit("km/h")  # loads the library
    start = time.perf_counter()
    with pytest.raises(InputError, match="unknown unit") as refusal:
        parse_unit(text)
    assert time.perf_counter() - start < 1.0
    message = str(refusal.value)
    assert message.isprintable()
    assert len(message) < 200
    assert "km/h" in message  # shows how to write one


@given(st.text(st.sampled_from("ms°%g/*^()-0123456789.kN []"), max_size=14))
def test_any_text_is_a_finite_unit_or_refused(text: str) -> None:
    try:
        unit = parse_unit(text)
    except InputError:
        return
    assert np.isfinite([unit.scale, unit.offset]).all()
    assert unit.scale != 0


def test_converting_between_dimensions_is_refused() -> None:
    with pytest.raises(
        InputError, match="unit 'km/h' cannot be converted to 'rad/s'; give the signal's true"
    ):
        convert(1.0, "km/h", "rad/s")
