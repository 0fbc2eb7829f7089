"""Plant files, mismatch on purpose, tires to measure, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from roadstate.core import InputError
from roadstate.sim.plant import PlantFigures, load_plant_figures, multibody_plant
from roadstate.sim.plant.mismatch import mismatched
from roadstate.sim.plant.tire_figures import plant_tire
from roadstate.tires.mf_build import PASSENGER
from roadstate.vehicles import load_vehicle

_CAR = load_vehicle("family-car")


def test_a_plant_file(tmp_path: Path) -> None:
    path = tmp_path / "plant.yaml"
    path.write_text("front:\n  ride_frequency: 1.1 Hz\nsteering:\n  caster: 5 deg\n")
    figures = load_plant_figures(path)
    assert figures.front.ride_frequency == 1.1
    assert figures.steering.caster == pytest.approx(np.deg2rad(5))
    soft, usual = multibody_plant(_CAR, figures), multibody_plant(_CAR)
    assert float(soft.suspension.stiffness[0]) < float(usual.suspension.stiffness[0])
    assert float(soft.suspension.stiffness[2]) == float(usual.suspension.stiffness[2])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("front:\n  ride: 1 Hz\n", "line 2.*ride"),
        ("front:\n  ride_frequency: 1 kg\n", "line 2.*ride_frequency"),
        ("front: [1, 2]\n", "front"),
        ("{", "plant.yaml"),
    ],
)
def test_a_bad_plant_file(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "plant.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        load_plant_figures(path)
    assert "\n" not in str(caught.value)


def test_no_plant_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        load_plant_figures(tmp_path / "none.yaml")


def test_wheels_that_outweigh_their_car() -> None:
    with pytest.raises(InputError, match="yaw_inertia"):
        multibody_plant(_CAR, PlantFigures.model_validate({"rear": {"unsprung_mass": "400 kg"}}))


def test_mismatch_on_purpose() -> None:
    other = mismatched(
        _CAR, mass=10, yaw_inertia=-5, cg_forward=2, cg_height=3, radius=-1, cornering_stiffness=20
    )
    assert other.mass == pytest.approx(1.1 * _CAR.mass)
    assert other.yaw_inertia == pytest.approx(0.95 * _CAR.yaw_inertia)
    assert other.geometry.cg_to_front_axle == pytest.approx(
        _CAR.geometry.cg_to_front_axle - 0.02 * _CAR.wheelbase
    )
    assert other.wheelbase == pytest.approx(_CAR.wheelbase)
    plant = multibody_plant(other)
    assert float(plant.chassis.mass) == pytest.approx(1.1 * _CAR.mass)
    rear = other.static_axle_loads[1] / 2
    assert float(plant.tires.model.stiffnesses(rear)[1]) / rear == pytest.approx(
        1.2 * _CAR.tires.cornering_stiffness_rear
    )
    assert mismatched(_CAR) == _CAR
    for bad in ({"mass": 95.0}, {"mass": float("nan")}, {"cg_forward": 60.0}):
        with pytest.raises(InputError):
            mismatched(_CAR, **bad)


def test_a_tire_as_measured_and_the_two_ways_of_friction() -> None:
    measured = plant_tire(_CAR, PASSENGER)
    assert float(measured.coefficients["FNOMIN"]) == 4000
    kept, follows = plant_tire(_CAR), plant_tire(_CAR, stiffness_follows_friction=True)
    small = 1e-4
    for tire, ratio in ((kept, 1.0), (follows, 0.5)):
        forces = [float(tire.forces(0.0, small, 4000.0, mu, 20.0).F_y) for mu in (0.4, 0.8)]
        assert forces[0] / forces[1] == pytest.approx(ratio, rel=1e-3)
    peak = [
        float(np.max(kept.forces(0.0, np.linspace(0, 1, 2000), 3900.0, mu, 20.0).F_y)) for mu in (0.4, 0.8)
    ]
    assert peak[1] / peak[0] == pytest.approx(2, rel=0.02)


def test_lateral_force_builds_up_over_the_relaxation_length() -> None:
    tire = plant_tire(_CAR)
    mean = _CAR.mass * 9.80665 / 4
    assert float(tire.relaxation_lengths(mean).lateral) == pytest.approx(_CAR.tires.relaxation_length)
    assert float(tire.relaxation_lengths(1.2 * mean).lateral) > float(tire.relaxation_lengths(mean).lateral)
