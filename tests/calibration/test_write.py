"""The new vehicle file: what it keeps, what it changes, and that it can be read."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from calibration_case import with_mass

from roadstate.calibration import Calibration, Learned, learned_yaml
from roadstate.calibration.parameters import moved, select
from roadstate.vehicles import Vehicle, parse_vehicle, presets, vehicle_text

FREE, SHARE = 0.5, 0.4  # change and 1σ in the priors' standard deviations


def found(car: Vehicle, groups: list[str], log: str = "drive") -> Calibration:
    parameters = select(car, groups, tune=False).parameters
    learned = tuple(Learned(p, p.value(FREE), p.value_std(FREE, SHARE), SHARE * p.std) for p in parameters)
    return Calibration(
        vehicle=moved(car, parameters, [FREE] * len(parameters)),  # type: ignore[arg-type]
        estimator="joint",
        learned=learned,
        refused={},
        logs={log: 100},
        uses_prior=True,
        evaluations=3,
        converged=True,
    )


@pytest.mark.parametrize("name", presets())
def test_only_what_was_learned_changes(name: str) -> None:
    old = parse_vehicle(vehicle_text(name), name)
    calibration = found(old, ["mass", "aero", "geometry"])
    new = parse_vehicle(learned_yaml(vehicle_text(name), name, calibration), "new")
    assert new.mass == pytest.approx(calibration.vehicle.mass, rel=1e-3)
    assert new.aerodynamics.drag_coefficient == pytest.approx(
        calibration.vehicle.aerodynamics.drag_coefficient, rel=1e-2
    )
    assert new.wheelbase == pytest.approx(old.wheelbase, rel=1e-3)
    assert new.prior.mass_relative == pytest.approx(SHARE * old.prior.mass_relative, rel=0.01)
    assert "mass" in new.source
    for kept in ("name", "yaw_inertia", "driveline", "tires", "sensors", "wheels"):
        assert getattr(new, kept) == getattr(old, kept)


def test_keys_keep_their_order_and_learned_ones_say_so(car: Vehicle) -> None:
    before = vehicle_text("family-car")
    text = learned_yaml(before, "family-car", found(car, ["mass", "inertia"]))
    keys = [key for key in yaml.safe_load(text) if key != "prior"]
    assert keys == list(yaml.safe_load(before))
    assert "# ± " in next(line for line in text.splitlines() if line.startswith("yaw_inertia"))
    assert next(line for line in text.splitlines() if line.startswith("mass:")).endswith("# learned")


def test_stiffness_uncertainty_waits_for_all_stiffnesses(car: Vehicle) -> None:
    before = vehicle_text("family-car")
    tire = parse_vehicle(learned_yaml(before, "old", found(car, ["tire"])), "new")
    both = parse_vehicle(learned_yaml(before, "old", found(car, ["tire", "slip"])), "new")
    assert tire.prior.stiffness_relative == car.prior.stiffness_relative
    assert both.prior.stiffness_relative == pytest.approx(SHARE * car.prior.stiffness_relative, rel=0.01)


def test_source_says_what_the_road_was_taken_for(car: Vehicle) -> None:
    guessed = found(car, ["tire"])
    told = Calibration(**{**vars(guessed), "road_friction": 0.85})
    guessed_text, told_text = (learned_yaml(vehicle_text("suv"), "suv", one) for one in (guessed, told))
    assert "road friction" not in parse_vehicle(guessed_text, "new").source
    assert "estimator joint, road friction 0.85)" in parse_vehicle(told_text, "new").source


def test_uncertainty_has_a_floor(car: Vehicle) -> None:
    calibration = found(car, ["mass"])
    (mass,) = calibration.learned
    sure = Learned(mass.parameter, mass.value, 1e-6, 1e-9)
    exact = Calibration(**{**vars(calibration), "learned": (sure,)})
    assert parse_vehicle(learned_yaml(vehicle_text("suv"), "suv", exact), "new").prior.mass_relative == 0.005


@pytest.mark.parametrize("name", ["a: b\n- c", "x # y", "\u202e\x00mass: 1", "'\"", "n" * 9000])
def test_hostile_log_names_stay_text(car: Vehicle, name: str) -> None:
    text = learned_yaml(vehicle_text("family-car"), "family-car", found(car, ["mass"], name))
    assert parse_vehicle(text, "new").yaw_inertia == car.yaw_inertia


def test_new_file_is_an_old_file(car: Vehicle, tmp_path: Path) -> None:
    once = learned_yaml(vehicle_text("family-car"), "family-car", found(car, ["mass"]))
    twice = learned_yaml(once, "once", found(with_mass(car, 1.1), ["aero"]))
    assert parse_vehicle(twice, "twice").mass == parse_vehicle(once, "once").mass
