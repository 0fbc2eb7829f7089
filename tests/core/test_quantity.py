"""A quantity takes numbers in SI and texts with units, and refuses everything else."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic_core import PydanticCustomError

from roadstate.core.quantity import Quantity

MASS = Quantity("kg", 50, 200e3)


@pytest.mark.parametrize(
    ("quantity", "written", "si"),
    [
        (MASS, 1500, 1500.0),
        (MASS, "1500", 1500.0),
        (MASS, "1500 kg", 1500.0),
        (MASS, " 1.5 t ", 1500.0),
        (MASS, "1.5t", 1500.0),
        (MASS, "1.5e3 kg", 1500.0),
        (MASS, "3306.934 lb", 1500.0),
        (Quantity("m", 0.1, 4), "55 cm", 0.55),
        (Quantity("m", 0.1, 4), "308 mm", 0.308),
        (Quantity("kg*m^2", 10, 5e6), "2500 kg m²", 2500.0),
        (Quantity("N*m/Pa", 0, 0.1), "20 N*m/bar", 2e-4),
        (Quantity("N*m/Pa", 0, 0.1), "12 Nm/bar", 1.2e-4),
        (Quantity("-", 0.1, 1), "93 %", 0.93),
        (Quantity("-", 1, 60), "15.3 -", 15.3),
        (Quantity("1/rad", 1, 100), "0.2 1/deg", 0.2 * 180 / math.pi),
        (Quantity("rad/(m/s^2)", -0.05, 0.05), "0.15 deg/(m/s^2)", math.radians(0.15)),
        (Quantity("m/s^2", 0, 20), "0.01 g", 0.0980665),
        (Quantity("rad/s", 0, 10), "0.5 deg/s", math.radians(0.5)),
        (Quantity("rad", 0, 1, is_slope=True), "4 %", math.atan(0.04)),
        (Quantity("rad", 0, 1, is_slope=True), "2 deg", math.radians(2)),
        (Quantity("rad", 0, 1, is_slope=True), 0.04, 0.04),
    ],
)
def test_it_keeps_si(quantity: Quantity, written: object, si: float) -> None:
    assert quantity.parse(written) == pytest.approx(si, rel=1e-6)


@pytest.mark.parametrize(
    ("quantity", "written", "message"),
    [
        (MASS, None, "has no value"),
        (MASS, "", "has no value"),
        (MASS, True, "is not a number"),
        (MASS, [1500], "is not a number"),
        (MASS, "heavy", "'heavy' is not a number"),
        (MASS, "nan", "'nan' is not a number"),
        (MASS, math.nan, "is not a finite number"),
        (MASS, "1e999 kg", "is not a finite number"),
        (MASS, 10**400, "is not a finite number"),
        (MASS, "1.5 m", "unit 'm' does not fit: this is in kg"),
        (MASS, "1500 zorkmid", "unit 'zorkmid' does not fit: this is in kg"),
        (MASS, "1500 kg*9^9^9^9^9", "unit 'kg*9^9^9^9^9' does not fit"),  # 9^9^… must not be worked out
        (MASS, "1500 kg*9^(9^9)", "unit 'kg*9^(9^9)' does not fit"),
        (MASS, "1500 kg*((9^9)^9)^9", "unit 'kg*((9^9)^9)^9' does not fit"),
        (MASS, "1,500 kg", "write it with a decimal point"),
        (MASS, "1_500", "write it with a decimal point"),
        (MASS, -1500, "-1500 kg is outside 50 to 200000 kg; it cannot be negative"),
        (MASS, 1.5, "a number without a unit is taken in kg"),
        (MASS, "1.5 kg", "1.5 kg is outside 50 to 200000 kg; check the figure and its unit"),
        (Quantity("-", 1, 60), "15.3:1", "write it with a decimal point"),
        (Quantity("-", 1, 60), "15 deg", "this is in plain numbers"),
        (Quantity("-", 0.1, 1), 1.1, "1.1 is outside 0.1 to 1; check the figure"),
    ],
)
def test_it_refuses(quantity: Quantity, written: object, message: str) -> None:
    with pytest.raises(PydanticCustomError) as caught:
        quantity.parse(written)
    assert message in str(caught.value)


@settings(deadline=None)  # the first unit loads the unit library
@given(st.floats(51, 199e3), st.sampled_from([("kg", 1.0), ("t", 1000.0), ("g0*kg*s^2/m", 9.80665)]))
def test_a_text_means_what_the_number_means(mass: float, unit: tuple[str, float]) -> None:
    name, scale = unit
    assert MASS.parse(f"{mass / scale!r} {name}") == pytest.approx(MASS.parse(mass), rel=1e-12)


@settings(deadline=None)  # the first unit loads the unit library
@given(st.text(max_size=120))
def test_any_text_is_a_number_in_range_or_refused(text: str) -> None:
    try:
        value = MASS.parse(text)
    except PydanticCustomError:
        return
    assert MASS.minimum <= value <= MASS.maximum
