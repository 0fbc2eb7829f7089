"""Plant files, mismatch on purpose, tires to measure, and what is refused."""

from __future__ import annotations

from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest
from tests.sim.plant.conftest import Plane

from roadstate.core import InputError
from roadstate.sim.plant import Controls, PlantFigures, load_plant_figures, multibody_plant
from roadstate.sim.plant.figures import TireFigures
from roadstate.sim.plant.mismatch import mismatched
from roadstate.sim.plant.tire_figures import TRUCK, plant_tire
from roadstate.tires.mf_build import PASSENGER, load_tir
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
    assert float(plant_tire(other).stiffnesses(rear)[1]) / rear == pytest.approx(
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


def without_relaxation(path: Path, extra: str = "") -> Path:
    """The passenger tire without what relaxation lengths come from."""
    dropped = ("PTX", "PTY", "LONGITUDINAL_STIFFNESS", "LATERAL_STIFFNESS")
    lines = [a for a in PASSENGER.read_text().splitlines() if not a.strip().startswith(dropped)]
    path.write_text("\n".join(lines) + f"\n[STRUCTURAL]\n{extra}\n")
    return path


def test_a_property_file_without_relaxation_lengths(tmp_path: Path) -> None:
    mean = _CAR.mass * 9.80665 / 4
    plain = _CAR.model_copy(
        update={"tires": _CAR.tires.model_construct(**_CAR.tires.model_dump(exclude={"relaxation_length"}))}
    )
    path = without_relaxation(tmp_path / "t.tir")
    tire = plant_tire(plain, path)
    radius = float(tire.coefficients["UNLOADED_RADIUS"])
    lengths = tire.relaxation_lengths(mean)
    assert float(lengths.lateral) == pytest.approx(1.3 * radius)
    assert float(lengths.longitudinal) == pytest.approx(0.65 * radius)
    # like the stiffness they come from, they grow less than the load does
    grown = float(tire.relaxation_lengths(1.5 * mean).lateral / lengths.lateral)
    assert grown == pytest.approx(float(tire.stiffnesses(1.5 * mean)[1] / tire.stiffnesses(mean)[1]))
    # a length that somebody gave goes first, and a carcass' stiffness before both
    given = plant_tire(plain, path, figures=TireFigures(relaxation_length=0.5))
    assert float(given.relaxation_lengths(mean).lateral) == pytest.approx(0.5)
    assert "relaxation_length" in _CAR.tires.model_fields_set
    by_car = plant_tire(_CAR, path)
    assert float(by_car.relaxation_lengths(mean).lateral) == pytest.approx(_CAR.tires.relaxation_length)
    stiff = plant_tire(plain, without_relaxation(tmp_path / "s.tir", "LATERAL_STIFFNESS = 150000"))
    lateral = float(stiff.stiffnesses(mean)[1]) / 150e3
    assert float(stiff.relaxation_lengths(mean).lateral) == pytest.approx(lateral)
    assert float(stiff.relaxation_lengths(mean).longitudinal) == pytest.approx(0.65 * radius)
    plant = multibody_plant(plain, tir=path)
    assert np.isfinite(np.asarray(plant.tires.low_speed_damping)).all()


@pytest.mark.parametrize("path", [PASSENGER, TRUCK], ids=["passenger", "truck"])
def test_no_slip_and_no_camber_takes_more_than_the_road_has(path: Path) -> None:
    """On μ = 0.1, where unbounded camber thrust alone exceeds it; the slip stiffness stays."""
    bounded, free = (load_tir(path, symmetric=True, bounded=b) for b in (True, False))
    nominal = float(bounded.coefficients["FNOMIN"])
    slips = np.concatenate([-np.geomspace(1, 1e-4, 9), [0], np.geomspace(1e-4, 3, 10)])
    angles = np.linspace(-1.5, 1.5, 21)
    cambers = np.linspace(-0.35, 0.35, 9)
    loads = nominal * np.array([0.05, 0.3, 1.0, 1.8])
    kappa, alpha, camber, load = np.meshgrid(slips, angles, cambers, loads, indexing="ij")
    used = {}
    for tire in (bounded, free):
        force = tire.forces(kappa, alpha, load, 0.1, 20.0, camber=camber)
        peaks = np.maximum(*(np.asarray(p) for p in tire.peak_friction(load, 0.1, camber=camber)))
        used[tire.bounded] = np.hypot(force.F_x, force.F_y) / load / peaks
        if tire.bounded:
            upright = np.abs(camber) < 1e-9
            assert (np.hypot(force.F_x, force.F_y) / load)[upright & (load == nominal)].max() <= 0.1
    assert used[True].max() <= 1 + 1e-9
    assert used[True].max() > 0.99
    if path == PASSENGER:
        assert used[False].max() > 1.3
    small = 1e-5
    for tire in (bounded, free):
        at = tire.forces(small * np.eye(2)[0], small * np.eye(2)[1], nominal, 0.1, 20.0)
        along, across = tire.stiffnesses(nominal)
        assert float(at.F_x[0]) == pytest.approx(small * float(along), rel=1e-2)
        assert float(at.F_y[1]) == pytest.approx(small * float(across), rel=1e-2)


def test_a_bounded_tire_is_the_free_one_below_its_peaks() -> None:
    bounded, free = (load_tir(PASSENGER, symmetric=True, bounded=b) for b in (True, False))
    angles = np.linspace(-0.5, 0.5, 101)
    here, there = (np.asarray(t.forces(0.0, angles, 4000.0, 0.8, 20.0).F_y) for t in (bounded, free))
    inside = np.abs(there) < 0.97 * 0.8 * 4000
    assert 20 < inside.sum() < 101
    np.testing.assert_array_equal(here[inside], there[inside])
    np.testing.assert_allclose(here, there, rtol=0.008)  # what the peak itself loses


def test_lateral_force_builds_up_over_the_relaxation_length() -> None:
    tire = plant_tire(_CAR)
    mean = _CAR.mass * 9.80665 / 4
    assert float(tire.relaxation_lengths(mean).lateral) == pytest.approx(_CAR.tires.relaxation_length)
    assert float(tire.relaxation_lengths(1.2 * mean).lateral) > float(tire.relaxation_lengths(mean).lateral)


def test_motors_in_the_wheels_have_no_engine_speed() -> None:
    """A zero would be an engine that stands."""
    road = Plane()
    told = eqx.filter_jit(lambda plant: plant.truth(road, plant.init(road, 10.0), Controls.make()))
    for name, has_none in (("in-wheel-ev", True), ("family-car", False)):
        truth = told(multibody_plant(load_vehicle(name)))
        assert np.isnan(truth.engine_speed) == has_none
        assert np.isfinite(truth.engine_torque)
        assert np.isfinite(truth.wheel_speed).all()


def test_a_car_whose_brakes_do_nothing() -> None:
    assert _CAR.brakes is not None
    none = {"torque_per_pressure_front": 0.0, "torque_per_pressure_rear": 0.0}
    even = dict.fromkeys(none, _CAR.brakes.torque_per_pressure_front)
    plants = [
        multibody_plant(_CAR.model_copy(update={"brakes": _CAR.brakes.model_copy(update=gains)}))
        for gains in (none, even)
    ]
    for leaf in jax.tree.leaves(plants[0]):
        assert np.isfinite(leaf).all()
    # how they would make it pitch is as for brakes that share evenly
    np.testing.assert_array_equal(plants[0].chassis.carrier_turn, plants[1].chassis.carrier_turn)
