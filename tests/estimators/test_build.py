"""What :func:`roadstate.estimators.build` is given by mistake."""

from __future__ import annotations

from typing import Any

import pytest

from roadstate.core import InputError
from roadstate.estimators import build
from roadstate.vehicles import Vehicle


def test_a_misspelt_channel_is_no_missing_one(vehicle: Vehicle) -> None:
    with pytest.raises(InputError, match="'sped' is not a canonical channel; did you mean 'speed'"):
        build("joint", vehicle, {"sped", "accel_x"})


def test_a_vehicle_is_not_its_name() -> None:
    name: Any = "family-car"
    with pytest.raises(InputError, match=r"load_vehicle\('family-car'\)"):
        build("joint", name, {"speed", "accel_x"})


def test_channels_that_it_does_not_use_are_passed_over(vehicle: Vehicle) -> None:
    assert build("kmbe", vehicle, {"speed", "accel_x", "ref_grade", "latitude"}).name == "kmbe"
