"""Every manoeuvre, found by discovery, set up for every vehicle and driven by a simple car."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import equinox as eqx
import jax
import numpy as np
import pytest
from tests.sim.simple_car import SimpleCar

from roadstate.core import InputError
from roadstate.core.constants import GRAVITY
from roadstate.sim.manoeuvres import KMH, Manoeuvre, all_manoeuvres, manoeuvre
from roadstate.sim.manoeuvres.script import CLOSED, OPEN
from roadstate.sim.run import Drive, drive
from roadstate.vehicles import load_vehicle, presets

CAR = load_vehicle("family-car")
PLANT = SimpleCar.of(CAR)
ASKED = {
    "straight-constant-speed", "straight-variable-speed", "curve-variable-speed", "acceleration-lane-changes",
    "ice-lane-change", "double-lane-change", "iso-3888-1", "iso-3888-2", "joint-road-acceleration",
    "split-road", "split-road-braking", "step-steer", "sine-with-dwell", "constant-radius", "slalom",
    "coast-down", "hill-start", "low-excitation-cruise", "urban-drive",
}  # fmt: skip
CLOSED_LOOP = sorted(ASKED - {"joint-road-acceleration", "step-steer", "sine-with-dwell", "coast-down"})


@cache
def run(name: str, **setting: float) -> tuple[Manoeuvre, Drive]:
    chosen = manoeuvre(name).prepare(CAR, **setting)
    return chosen, drive(PLANT, chosen, CAR)


def aside(chosen: Manoeuvre, driven: Drive) -> np.ndarray:
    """How far the car is from its path while the driver steers, m."""
    place = driven.truth.road
    steers = np.asarray(chosen.script.table)[: len(driven.time), 6] == CLOSED
    return (place[:, 1] - np.asarray(chosen.path.at(place[:, 0]).d))[steers]


def too_fast(chosen: Manoeuvre, driven: Drive) -> np.ndarray:
    """Speed over the plan's while the driver has the pedals, m/s."""
    script = np.asarray(chosen.script.table)[: len(driven.time)]
    return (driven.truth.velocity[:, 0] - script[:, 0])[script[:, 7] == CLOSED]


def test_all_that_were_asked_for_are_found() -> None:
    assert set(all_manoeuvres()) >= ASKED
    for name, kind in all_manoeuvres().items():
        assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", name)
        assert 10 < len(kind.summary) < 110
        assert kind.source


@pytest.mark.parametrize("vehicle", sorted(presets()))
def test_every_manoeuvre_can_be_set_up_for_every_vehicle(vehicle: str) -> None:
    car = load_vehicle(vehicle)
    for name, kind in all_manoeuvres().items():
        if name == "urban-drive" and vehicle != "truck":
            continue  # the same for all of them, and long
        chosen = kind.prepare(car)
        assert chosen.name == name
        assert 1.0 < chosen.duration <= 1300.0
        table = np.asarray(chosen.script.table)
        assert np.isfinite(table).all()
        assert (table[:, 0] >= 0).all()
        assert table[0, 0] == pytest.approx(chosen.speed)
        assert (table[:, 3:5] >= 0).all()
        assert (table[:, 3:5] <= 1).all()


@pytest.mark.parametrize("name", CLOSED_LOOP)
def test_driver_keeps_path_and_speed(name: str) -> None:
    chosen, driven = run(name)
    assert np.abs(aside(chosen, driven)).max() < (0.55 if name == "iso-3888-2" else 0.3)
    if name not in ("split-road-braking", "acceleration-lane-changes"):
        assert np.abs(too_fast(chosen, driven)).max() < 1.0
        assert np.sqrt(np.mean(too_fast(chosen, driven) ** 2)) < 0.35
    assert driven.truth.road[-1, 0] > 60.0


@pytest.mark.parametrize("speed", [10 * KMH, 30 * KMH, 85 * KMH])
def test_double_lane_change_at_any_speed(speed: float) -> None:
    chosen, driven = run("double-lane-change", speed=speed)
    place = driven.truth.road
    assert np.abs(aside(chosen, driven)).max() < 0.4
    assert place[:, 1].max() == pytest.approx(3.5, abs=0.3)
    # l₀ = 2 v, then 15 + 30 m to the middle of the second lane's entry
    there = np.interp(2 * speed + 15 + 30 + 12.5, place[:, 0], place[:, 1])
    assert there == pytest.approx(3.5, abs=0.25)
    assert np.abs(np.interp([2 * speed, 2 * speed + 125], place[:, 0], place[:, 1])).max() < 0.25


@pytest.mark.parametrize("wrong", [0.7, 1.4])
@pytest.mark.parametrize("speed", [30 * KMH, 85 * KMH])
def test_driver_has_margin_for_a_car_he_does_not_know(wrong: float, speed: float) -> None:
    chosen = manoeuvre("double-lane-change").prepare(CAR, speed=speed)
    steering = CAR.steering.model_copy(update={"ratio": CAR.steering.ratio * wrong})
    driven = drive(PLANT, chosen, CAR.model_copy(update={"steering": steering}))
    assert np.abs(aside(chosen, driven)).max() < 1.0
    assert np.abs(aside(chosen, driven)[-50:]).max() < 0.15


def test_a_mirrored_path_is_driven_mirrored() -> None:
    chosen = manoeuvre("double-lane-change").prepare(CAR)
    other = replace(chosen, path=eqx.tree_at(lambda p: p.table, chosen.path, -chosen.path.table))
    a, b = (drive(PLANT, m, CAR) for m in (chosen, other))
    assert a.truth.road[:, 1] == pytest.approx(-b.truth.road[:, 1], abs=1e-9)
    assert np.asarray(a.controls.steering_wheel) == pytest.approx(
        -np.asarray(b.controls.steering_wheel), abs=1e-9
    )


def test_replay_moves_the_controls_as_they_were_and_goes_the_same_way() -> None:
    chosen, driven = run("slalom")
    # row k holds what was in force before it; the driver's decision at k stands in row k + 1
    again = chosen.replayed(jax.tree.map(lambda a: a[1:], driven.controls), 0.01)
    assert again.name == "slalom-open-loop"
    assert (np.asarray(again.script.table)[:, 6:] == OPEN).all()
    second = drive(PLANT, again, CAR)
    assert second.truth.road == pytest.approx(driven.truth.road, abs=1e-6)
    assert np.asarray(second.controls.throttle) == pytest.approx(
        np.asarray(driven.controls.throttle), abs=1e-9
    )


def test_joint_road_is_the_papers() -> None:
    chosen, driven = run("joint-road-acceleration")
    friction = np.asarray(chosen.road.at([10.0, 24.8, 25.2, 90.0], 0.0).friction)
    assert friction == pytest.approx([0.2, 0.2, 0.8, 0.8])
    assert chosen.speed == pytest.approx(30 / 3.6)
    assert (np.asarray(driven.controls.throttle)[1:] == 0.5).all()
    assert (np.asarray(driven.controls.steering_wheel) == 0).all()


@pytest.mark.parametrize("name", ["split-road", "split-road-braking"])
def test_split_roads_are_slippery_on_the_left(name: str) -> None:
    chosen = manoeuvre(name).prepare(CAR)
    assert np.asarray(chosen.road.at(50.0, [0.7, -0.7]).friction) == pytest.approx([0.2, 0.8])


def test_step_steer_turns_at_its_rate_and_holds() -> None:
    _, driven = run("step-steer")
    wheel = np.asarray(driven.controls.steering_wheel)
    assert np.abs(np.diff(wheel)).max() == pytest.approx(0.06, rel=0.01)
    assert np.ptp(wheel[300:]) == 0.0
    settled = driven.truth.angular_rate[-1, 2] * driven.truth.velocity[-1, 0]
    assert settled == pytest.approx(4.0, rel=0.12)
    throttle = np.asarray(driven.controls.throttle)
    assert np.ptp(throttle[202:]) == 0.0


def test_sine_with_dwell_has_its_shape() -> None:
    _, driven = run("sine-with-dwell")
    wheel, time = np.asarray(driven.controls.steering_wheel)[1:], driven.time[:-1]
    amplitude = wheel.max()
    assert wheel.min() == pytest.approx(-amplitude, rel=1e-3)
    assert np.sum(wheel < -0.995 * amplitude) * 0.01 == pytest.approx(0.5 + 0.045, abs=0.03)
    begin, end = time[np.flatnonzero(wheel)[[0, -1]]]
    assert begin == pytest.approx(2.01, abs=0.011)
    assert end == pytest.approx(2.0 + 1 / 0.7 + 0.5, abs=0.011)
    assert (np.asarray(driven.controls.throttle)[210:] == 0).all()


def test_iso_3888_2_lets_the_pedals_go() -> None:
    chosen, driven = run("iso-3888-2")
    there = np.searchsorted(driven.truth.road[:, 0], 2 * chosen.speed + 2.5)
    assert (np.asarray(driven.controls.throttle)[there + 5 :] == 0).all()


def test_constant_radius_rises_to_its_lateral_acceleration() -> None:
    _, driven = run("constant-radius")
    late = driven.time > driven.time[-1] - 3.0
    across = (driven.truth.velocity[:, 0] * driven.truth.angular_rate[:, 2])[late]
    assert across == pytest.approx(0.8 * 0.85 * GRAVITY, rel=0.08)
    assert np.asarray(driven.manoeuvre.road.at(driven.truth.road[late, 0], 0.0).curvature) == pytest.approx(
        0.01
    )


def test_hill_start_does_not_roll_back() -> None:
    chosen, driven = run("hill-start")
    s = driven.truth.road[:, 0]
    assert float(chosen.road.at(60.0, 0.0).dz_ds) == pytest.approx(0.12, abs=1e-6)
    assert s[driven.time < 4.0] == pytest.approx(50.0, abs=1e-9)
    assert np.diff(s).min() >= -1e-9
    assert driven.truth.velocity[-1, 0] == pytest.approx(30 / 3.6, abs=0.3)


def test_urban_drive_stops_and_starts_again() -> None:
    chosen, driven = run("urban-drive")
    assert chosen.duration == pytest.approx(1200.0, abs=60.0)
    stands = driven.truth.velocity[:, 0] < 0.05
    stops = np.sum(np.diff(stands.astype(int)) == 1)
    assert 10 <= stops <= 40
    # 45 % of the friction in the sharpest bend
    fastest = np.sqrt(0.45 * 0.85 * GRAVITY * 40.0)
    assert driven.truth.velocity[:, 0].max() == pytest.approx(fastest, rel=0.05)
    across = np.abs(driven.truth.velocity[:, 0] * driven.truth.angular_rate[:, 2])
    assert 1.5 < across.max() < 0.5 * 0.85 * GRAVITY
    assert np.ptp(np.rad2deg(driven.truth.grade)) > 2.0


def test_slippery_town_is_driven_slowly() -> None:
    chosen = manoeuvre("urban-drive").prepare(CAR, friction=0.15)
    assert np.asarray(chosen.script.table)[:, 0].max() ** 2 / 40.0 <= 0.46 * 0.15 * GRAVITY


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: manoeuvre("double-lane-chnge"), "did you mean 'double-lane-change'"),
        (lambda: manoeuvre("slalom").prepare(CAR, speed=0.0), "2 to 360 km/h"),
        (lambda: manoeuvre("slalom").prepare(CAR, speed=np.nan), "2 to 360 km/h"),
        (lambda: manoeuvre("slalom").prepare(CAR, friction=0.0), "0.02 to 3"),
        (lambda: drive(PLANT, manoeuvre("slalom").prepare(CAR), CAR, rate=150.0), "multiple of 100"),
    ],
)
def test_what_cannot_be_is_refused(make: object, what: str) -> None:
    with pytest.raises(InputError, match=what):
        make()  # type: ignore[operator]
