"""A speed in another unit than it is said to be, told by the wheels."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from recordings import recording

from roadstate.core import WHEELS, InputError, Recording, Signal
from roadstate.io.mapping import DEFAULT_MAPPING, Mapping

RADIUS = 0.31
TIME = np.arange(0.0, 60.0, 0.1)
KMH, MPH = 3.6, 2.236936


def drive(*, factor: float = 1.0, unit: str | None = None, radius: float = RADIUS) -> dict[str, Any]:
    """A minute between standstill and 20 m/s, the speed in m/s times ``factor``."""
    speed = np.clip(20.0 * np.sin(TIME / 15.0), 0.0, None)
    random = np.random.default_rng(0)
    wheels = {f"wheel_speed_{w}": speed / radius + 0.1 * random.normal(size=len(TIME)) for w in WHEELS}
    return {"speed": (factor * speed + 0.05 * random.normal(size=len(TIME)), unit), **wheels}


def refusal(raw: Recording, content: dict[str, Any] | None = None, radius: float = RADIUS) -> str:
    with pytest.raises(InputError) as caught:
        Mapping.model_validate(content or {}).apply(raw, wheel_radius=radius)
    return str(caught.value)


def accepted(radius: float = RADIUS, **signals: Any) -> bool:
    out = DEFAULT_MAPPING.apply(recording(TIME, **signals), wheel_radius=radius)
    return set(signals) == set(out.signals)


def test_a_speed_in_kmh_is_refused_in_one_line_and_mended_by_it() -> None:
    raw = recording(TIME, **drive(factor=KMH))
    assert refusal(raw) == (
        "drive.csv:speed as speed: is 3.6 times that of the wheels (of radius 0.31 m); is speed in km/h "
        "or wheel_speed_fl in m/s? Set that 'unit:' in the mapping"
    )
    mended = Mapping.model_validate({"channels": {"speed": {"unit": "km/h"}}}).apply(raw, wheel_radius=RADIUS)
    assert mended["speed"].values.max() == pytest.approx(20.0, abs=0.2)
    assert refusal(recording(TIME, **drive(factor=KMH, radius=0.5)), radius=0.5).endswith(
        "is speed in km/h? Set 'unit: km/h' in the mapping"
    )


@pytest.mark.parametrize(
    ("factor", "said", "meant"),
    [(MPH, None, "mph"), (1.0, "km/h", "m/s"), (1.0, "mph", "m/s"), (KMH, "m/s", "km/h")],
)
@pytest.mark.parametrize("off", [0.9, 1.0, 1.1])
def test_other_wrong_units_and_a_radius_that_is_a_little_off(
    factor: float, said: str | None, meant: str, off: float
) -> None:
    raw = recording(TIME, **drive(factor=factor, unit=said, radius=off * RADIUS))
    assert f"is speed in {meant}" in refusal(raw)


def test_wheel_speeds_along_the_road_taken_for_rotation_speeds() -> None:
    assert "wheel_speed_fl in m/s" in refusal(recording(TIME, **drive(radius=1.0)))
    rpm = {n: v if n == "speed" else v * 30 / np.pi / 3 for n, v in drive().items()}
    rpm["speed"] = (rpm["speed"][0] / 3, None)  # so slow that no limit is passed
    assert "is wheel_speed_fl in rpm? Set 'unit: rpm' in the mapping" in refusal(recording(TIME, **rpm))


@pytest.mark.parametrize("off", [0.7, 0.9, 1.0, 1.1, 1.4])
def test_a_radius_that_is_off_is_no_unit(off: float) -> None:
    assert accepted(**drive(radius=off * RADIUS))


def test_a_log_that_hardly_moves_says_nothing() -> None:
    slow = {n: v / 25 for n, v in drive().items() if n != "speed"}
    assert accepted(speed=drive(factor=KMH)["speed"][0] / 25, **slow)


def test_spinning_and_locked_wheels_are_no_unit() -> None:
    """A driven axle that spins for most of the drive, then all wheels, at slips that change."""
    signals = drive()
    for wheel in ("fl", "fr"):
        signals[f"wheel_speed_{wheel}"] = signals[f"wheel_speed_{wheel}"] * MPH
    assert accepted(**signals)
    for slip in (np.linspace(0.0, 1.0, len(TIME)), np.linspace(1.0, 3.5, len(TIME))):
        turned = {n: v * slip for n, v in drive().items() if n != "speed"}
        assert accepted(speed=drive()["speed"], **turned)


def test_a_speed_that_is_slower_than_the_wheels_is_compared_where_both_are_known() -> None:
    signals = drive(factor=KMH)
    values = signals.pop("speed")[0][::10]
    raw = recording(TIME, **signals, speed=Signal(TIME[::10], values, None, "gps:speed"))
    assert "is speed in km/h" in refusal(raw)


def test_without_a_radius_nothing_is_compared() -> None:
    assert "speed" in DEFAULT_MAPPING.apply(recording(TIME, **drive(factor=KMH))).signals
