"""What can be learned: where figures stand, how they move, and what is refused before any filter runs."""

from __future__ import annotations

import numpy as np
import pytest

from roadstate.calibration.parameters import GROUPS, moved, number_at, select, with_certainty
from roadstate.core import InputError
from roadstate.vehicles import Vehicle, load_vehicle, presets


@pytest.mark.parametrize("group", GROUPS)
@pytest.mark.parametrize("name", presets())
def test_every_group_has_figures_in_every_preset(group: str, name: str) -> None:
    vehicle = load_vehicle(name)
    found = select(vehicle, [group], tune=False)
    assert found.parameters or found.refused
    for parameter in found.parameters:
        assert number_at(vehicle, parameter.path) == parameter.start
        assert parameter.std > 0
        lower, upper = parameter.limits()
        assert lower <= 0 <= upper


def test_moving_by_the_prior_standard_deviation(car: Vehicle) -> None:
    (mass,) = select(car, ["mass"], tune=False).parameters
    assert mass.value(1.0) == pytest.approx(car.mass * np.exp(car.prior.mass_relative))
    assert mass.value_std(0.0, 1.0) == pytest.approx(car.mass * car.prior.mass_relative)
    rolling = select(car, ["rolling"], tune=False).parameters[0]
    assert rolling.value(1.0) == car.rolling_resistance.coefficient + car.prior.rolling_resistance_std


def test_limits_are_where_the_file_refuses(car: Vehicle) -> None:
    for parameter in select(car, list(GROUPS), tune=True).parameters:
        for end, bound in zip(parameter.limits(), (parameter.minimum, parameter.maximum), strict=True):
            if np.isfinite(end):
                assert parameter.value(end) == pytest.approx(bound)


def test_wheelbase_stays(car: Vehicle) -> None:
    parameters = select(car, ["geometry"], tune=False).parameters
    other = moved(car, parameters, np.array([0.0, 1.0]))
    assert other.geometry.cg_to_front_axle > car.geometry.cg_to_front_axle
    assert other.wheelbase == pytest.approx(car.wheelbase)


def test_filter_is_told_that_learned_figures_are_exact(car: Vehicle) -> None:
    parameters = select(car, ["mass", "aero"], tune=False).parameters
    certain = with_certainty(car, parameters, np.array([True, False]))
    assert certain.prior.mass_relative < 0.05 * car.prior.mass_relative
    assert certain.prior.drag_relative == car.prior.drag_relative


def test_noise_levels_are_found_by_walking_the_file(car: Vehicle) -> None:
    names = {p.name for p in select(car, (), tune=True).parameters}
    assert {"sensors.accel.noise_density", "sensors.speed.noise", "prior.grade_std"} <= names
    assert "sensors.accel.bias" not in names  # a drive has a single case of it


def test_refusals(car: Vehicle) -> None:
    with pytest.raises(InputError, match=r"no group of parameters is called 'mas'.*did you mean 'mass'"):
        select(car, ["mas"], tune=False)
    with pytest.raises(InputError, match="nothing to learn"):
        select(car, [], tune=False)
    without = car.model_copy(update={"brakes": None})
    assert "no section 'brakes'" in select(without, ["brakes"], tune=False).refused["brakes"]
    exact = car.model_copy(update={"prior": car.prior.model_copy(update={"mass_relative": 0.0})})
    assert "holds it for exact" in select(exact, ["mass"], tune=False).refused["mass"]
