"""The presets and examples are cars: self-consistent, plausible, and quick to load."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import pytest

from roadstate.vehicles import Vehicle, load_vehicle, presets

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted(str(p) for p in ROOT.glob("examples/*/vehicle*.yaml"))
NAMES = ["compact-car", "family-car", "in-wheel-ev", "suv", "truck"]


def test_presets_are_listed_with_what_they_are() -> None:
    listed = presets()
    assert list(listed) == NAMES
    truck = listed["truck"]
    assert (truck.name, truck.mass, truck.driven) == ("truck", 6900.0, "rear")
    assert all(s.description for s in listed.values())


@pytest.fixture(params=[*NAMES, *EXAMPLES], ids=lambda p: p.replace(f"{ROOT}/", ""))
def vehicle(request: pytest.FixtureRequest) -> Vehicle:
    return load_vehicle(request.param)


def test_both_examples_are_there() -> None:
    assert len(EXAMPLES) >= 2


def test_a_preset_says_where_its_figures_come_from(vehicle: Vehicle) -> None:
    assert "chosen" in vehicle.source.lower()


def test_it_understeers_mildly(vehicle: Vehicle) -> None:
    degrees_per_g = math.degrees(vehicle.understeer_gradient * 9.80665)
    assert 1.0 < degrees_per_g < 3.0


def test_its_inertia_fits_its_size(vehicle: Vehicle) -> None:
    geometry = vehicle.geometry
    dynamic_index = vehicle.yaw_inertia / (
        vehicle.mass * geometry.cg_to_front_axle * geometry.cg_to_rear_axle
    )
    if vehicle.name == "truck":  # as the paper prints it
        assert dynamic_index == pytest.approx(5757 / 24150)
    else:
        assert 0.85 < dynamic_index < 1.15


def test_its_brakes_reach_the_tires_limit_and_not_much_more(vehicle: Vehicle) -> None:
    if vehicle.brakes is None:
        pytest.skip("no brakes in the file")
    full = 8e5 if vehicle.name == "truck" else 100e5  # Pa: compressed air, brake fluid
    torque = 2 * full * (vehicle.brakes.torque_per_pressure_front + vehicle.brakes.torque_per_pressure_rear)
    assert 0.6 < torque / (vehicle.wheels.radius * vehicle.mass * 9.81) < 1.6


def test_top_gear_suits_the_road(vehicle: Vehicle) -> None:
    if not vehicle.driveline.total_ratios:
        pytest.skip("no gears in the file")
    engine_rpm = 27.8 / vehicle.wheels.radius * vehicle.driveline.total_ratios[-1] * 30 / math.pi
    assert 1500 < engine_rpm < 3200  # at 100 km/h


def test_the_truck_is_the_paper_s() -> None:
    truck = load_vehicle("truck")
    geometry = truck.geometry
    assert (truck.mass, truck.yaw_inertia) == (6900.0, 5757.0)
    assert (geometry.cg_to_front_axle, geometry.cg_to_rear_axle, geometry.cg_height) == (1.4, 2.5, 0.975)
    assert (geometry.track_front, geometry.track_rear) == (1.975, 1.975)
    assert truck.wheels.dual_rear


def test_loading_a_preset_or_example_stays_quick() -> None:
    """They are written in SI, so that the unit library (half a second) is not loaded for them."""
    code = (
        "import sys; from roadstate.vehicles import load_vehicle, presets; presets(); "
        f"[load_vehicle(p) for p in {EXAMPLES!r}]; "
        "print([m for m in ('pint', 'jax', 'pandas') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_importing_the_package_loads_nothing() -> None:
    code = "import sys, roadstate.vehicles; print('pydantic' in sys.modules, 'yaml' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False False"
