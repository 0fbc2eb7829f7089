"""The accuracy benchmark: its measures against hand-made estimates, and figures of a drive that must hold."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.accuracy import faults, measures, table
from benchmarks.accuracy.grade_bound import MASS_OFF, least_mass_error, least_rmse
from benchmarks.accuracy.groups import GROUPS
from benchmarks.accuracy.groups.base import SATELLITE, Runs
from benchmarks.accuracy.groups.friction import LARGE, MEDIUM, SMALL, seen, summed_up
from benchmarks.accuracy.groups.mass import Mass
from benchmarks.accuracy.run import run, without
from benchmarks.accuracy.scenarios import QUICK, SCENARIOS, LeftTheRoad, few, logs
from benchmarks.accuracy.scenarios import SATELLITE as RECEIVED
from benchmarks.accuracy.score import Goal, Score

from roadstate.core import WHEELS, Estimates, InputError, Log, Validity
from roadstate.run import scan
from roadstate.vehicles import load_vehicle

_T = 200


def _log(share: float | np.ndarray = 0.5, friction: float | np.ndarray = 0.8) -> Log:
    """Two seconds on which each wheel, under 4 kN, uses a share of the friction, along the car."""
    friction = np.broadcast_to(np.asarray(friction, float), (_T,))
    force = np.broadcast_to(np.asarray(share, float), (_T,)) * friction * 4000.0
    channels: dict[str, np.ndarray] = {"ref_grade": np.full(_T, 0.02), "ref_velocity_x": np.full(_T, 10.0)}
    for w in WHEELS:
        channels |= {
            f"ref_force_x_{w}": force,
            f"ref_force_y_{w}": np.zeros(_T),
            f"ref_load_{w}": np.full(_T, 4000.0),
            f"ref_friction_{w}": friction.copy(),
        }
    return Log(np.arange(_T) / 100, channels)


def _said(
    log: Log, values: Mapping[str, float | np.ndarray], std: Mapping[str, float] | None = None
) -> Estimates:
    every = {name: np.broadcast_to(np.asarray(v, float), (len(log),)).copy() for name, v in values.items()}
    spreads = {name: np.full(len(log), v) for name, v in (std or {}).items()}
    return Estimates(log.time, every, spreads, np.zeros(len(log), np.int8))


def test_share_is_that_of_the_friction() -> None:
    """Of wheels pushed along and across at once, by Pythagoras; a heavier wheel counts for more."""
    log = _log(0.6)
    across = {f"ref_force_y_{w}": log[f"ref_force_x_{w}"] * 4 / 3 for w in WHEELS}
    np.testing.assert_allclose(measures.share_used(log.with_channels(across), "front"), 1.0)
    light = log.with_channels({"ref_load_fl": np.full(_T, 1000.0), "ref_force_x_fl": np.full(_T, 0.0)})
    np.testing.assert_allclose(measures.share_used(light, "front"), 0.6 * 4000 / 5000)
    np.testing.assert_allclose(measures.share_used(light, "rear"), 0.6)


def test_classes_part_all_samples() -> None:
    """Each share lies in one class, edges in the upper one."""
    share = np.array([0.0, 0.39, 0.4, 0.69, 0.7, 1.3])
    inside = np.array([measures.in_class(share, name) for name in measures.CLASSES])
    assert (inside.sum(axis=0) == 1).all()
    assert inside[list(measures.CLASSES).index("≥ 0.7")].tolist() == [False] * 4 + [True] * 2
    assert inside[list(measures.CLASSES).index("0.4–0.7")].tolist() == [False] * 2 + [True] * 2 + [False] * 2


def test_excitation_adds_up() -> None:
    """Half a second of it counts, in two goes as well, and never a sample that does not use enough."""
    time = np.arange(200) / 100
    share = np.where((time >= 0.3) & (time < 0.6) | (time >= 1.0), 0.8, 0.1)
    mask = measures.after_excitation(share, time)
    assert time[mask][0] == pytest.approx(1.19)
    assert mask.sum() == np.sum(time >= 1.19 - 1e-9)


def test_grade_error_is_of_the_slope() -> None:
    """In per cent of slope, from the settling time on."""
    log = _log()
    late = np.where(log.time < 1.0, 0.5, np.arctan(np.tan(0.02) + 0.003))
    assert measures.rmse(_said(log, {"grade": late}), log, "grade", settle=1.0) == pytest.approx(0.3)
    assert measures.rmse(_said(log, {"grade": late}), log, "grade") > 10
    assert np.isnan(measures.rmse(_said(log, {"speed": 1.0}), log, "grade"))


def test_coverage_counts_what_is_inside() -> None:
    """±1.96 σ, or bounds where there are any; not a number is outside."""
    log = _log()
    speed = np.where(log.time < 0.5, 10.0 + 1.95, 10.0 + 1.97)
    assert measures.covered(_said(log, {"speed": speed}, {"speed": 1.0}), log, "speed") == (50, 200)
    bounds = {"friction_peak": 0.5, "friction_peak_lower": 0.3, "friction_peak_upper": 0.9}
    assert measures.covered(_said(log, bounds), log, "friction_peak") == (200, 200)
    bounds["friction_peak_upper"] = np.where(log.time < 1.0, 0.79, np.nan)
    assert measures.covered(_said(log, bounds), log, "friction_peak") == (0, 200)
    assert measures.covered(_said(log, {"altitude": 1.0}, {"altitude": 1.0}), log, "altitude") is None


def _joint(when: float, first: float = 0.8, then: float = 0.2) -> Log:
    return _log(friction=np.where(np.arange(_T) / 100 < when, first, then))


@pytest.mark.parametrize(("first", "then"), [(0.8, 0.2), (0.2, 0.8)])
def test_a_change_is_timed_from_the_crossing(first: float, then: float) -> None:
    """A short excursion does not count, nor where the estimate is there already."""
    log, quantity = _joint(0.7, first, then), "friction_peak_front"

    def time(on_new: np.ndarray) -> float:
        said = _said(log, {quantity: np.where(on_new, 0.39 if then < first else 0.41, first)})
        return measures.half_way_time(said, log, quantity)

    assert time(log.time >= 1.0) == pytest.approx(0.3)
    assert time((log.time >= 1.0) | ((log.time >= 0.8) & (log.time < 0.88))) == pytest.approx(0.3)
    assert time((log.time >= 1.0) | ((log.time >= 0.8) & (log.time < 0.92))) == pytest.approx(0.1)
    assert np.isnan(time(log.time < 0))
    assert np.isnan(time(log.time >= 0.0))
    assert np.isnan(time(log.time >= 1.95))  # too late to have stayed


def test_friction_is_taken_by_class() -> None:
    """Errors of the class's samples only; bounds as shares."""
    share = np.where(np.arange(_T) < 50, 0.9, np.where(np.arange(_T) < 150, 0.5, 0.1))
    log = _log(share, 0.5)
    peak = np.where(share > 0.7, 0.55, 0.4)
    said = _said(
        log,
        {
            "friction_peak_front": peak,
            "friction_peak_front_lower": np.where(np.arange(_T) < 100, 0.3, 0.45),
            "friction_peak_front_upper": np.where(np.arange(_T) < 75, 0.6, 0.48),
        },
    )
    found = seen(said, log, "front")
    assert summed_up("median", found[LARGE, "median"]) == pytest.approx(10)
    assert summed_up("median", found[MEDIUM, "median"]) == pytest.approx(20)
    assert summed_up("in 5–95 %", found[MEDIUM, "in 5–95 %"]) == pytest.approx(25)
    assert summed_up("lower ≤ truth", found[SMALL, "lower ≤ truth"]) == pytest.approx(100)
    assert seen(said, log, "rear") == {}
    assert summed_up("p90", np.array([1.0, np.nan])) == np.inf


def _score(**vehicles: float) -> Score:
    seeds = {name: np.array([value]) for name, value in vehicles.items()}
    return Score("grade", "a", "joint", "%", Goal.at_most(1), vehicles, seeds, {"one": 0.5})


def test_verdicts() -> None:
    """Met by all, on average, or not; what is not a number never is."""
    assert _score(one=0.9, two=1.0).verdict == "met"
    assert _score(one=0.2, two=1.1).verdict == "met*"
    assert _score(one=0.2, two=1.1).worst == ("two", 1.1)
    assert _score(one=0.2, two=1.9).verdict == "missed"
    assert _score(one=0.2, two=float("nan")).verdict == "missed"
    assert Goal(92, 98).is_met(92)
    assert not Goal(92, 98).is_met(99)
    assert Goal(92, 98).badness(99) > Goal(92, 98).badness(93)


def test_mass_is_judged_at_the_end() -> None:
    """Against the plant's, beside what the file says."""
    vehicle, log, mass = load_vehicle("family-car"), _log(), Mass()
    told = vehicle.model_copy(update={"mass": vehicle.mass * 1.08})
    learnt = np.linspace(1.08, 1.02, _T) * vehicle.mass
    mass.add(Runs(vehicle, "urban", SATELLITE, "joint", [log], [told], [_said(log, {"mass": learnt})]))
    estimated, as_told = mass.scores()
    assert estimated.value == pytest.approx(2)
    assert as_told.value == pytest.approx(8)


def test_page_is_narrow_and_json_is_plain() -> None:
    """At most 120 characters, wide tables cut; numbers that are none as null."""
    many = [_score(one=0.9, two=float("nan"))]
    many += [
        Score("grade", "a" * 30, f"some-estimator-{i}", "%", None, {"one": 1.0}, {"one": np.ones(2)})
        for i in range(9)
    ]
    page = table.markdown({"grade": "Grade"}, many, ["none"], preamble="# Accuracy", subject="joint")
    assert max(map(len, page.splitlines())) <= 120
    assert "missed" in page
    told = json.loads(json.dumps(table.as_json({}, many, []), allow_nan=False))
    assert told["scores"][0]["value"] is None
    assert told["scores"][1]["value"] == 1.0


def test_faults_are_told_from_the_clean_drive() -> None:
    """Onset, validity that the clean run does not have, and what counts as trouble."""
    time = np.arange(6000, 9000) / 100
    truth = {"ref_grade": np.zeros(len(time)), "accel_x": np.ones(len(time))}
    truth |= {f"ref_friction_{w}": np.full(len(time), 0.8) for w in WHEELS}
    log = Log(time, truth)
    broken = log.with_channels({"accel_x": np.where(time >= 64.5, np.nan, 1.0)})
    assert faults.first_difference(log, log) is None
    assert faults.first_difference(log, broken) == pytest.approx(64.5)
    fine = _said(log, {"grade": 0.0, "friction_peak": 0.7, "friction_peak_lower": 0.5})
    assert faults.trouble(fine, fine, log) == ""
    assert faults.trouble(_said(log, {"grade": np.where(time < 70, 1.0, 0.0)}), fine, log) == ""
    assert faults.trouble(_said(log, {"grade": np.where(time > 80, 0.06, 0.0)}), fine, log) == "grade"
    assert faults.trouble(_said(log, {"grade": np.where(time < 65, np.nan, 0.0)}), fine, log) == "nan"
    high = _said(log, {"grade": 0.0, "friction_peak": 0.95, "friction_peak_lower": 0.9})
    assert faults.trouble(high, fine, log) == "friction"
    assert faults.flag_time(fine, fine, 64.5) is None
    fine.validity[(time >= 65.0) & (time < 66.0)] = Validity.SENSOR_MISSING
    clean = _said(log, {"grade": 0.0})
    assert faults.flag_time(fine, clean, 64.5) == pytest.approx(0.5)
    clean.validity[:] = fine.validity
    assert faults.flag_time(fine, clean, 64.5) is None


def test_a_cell_tells_the_worst_of_all_drives() -> None:
    soon = faults.Outcome("suv", 0, "joint", "speed", "sign", True, "", 0.3)
    late, lost = replace(soon, seed=1, flagged_s=1.4), replace(soon, survived=False, why="grade")
    hidden = replace(soon, flagged_s=None, tellable=False)
    assert [faults.words(some) for some in ([], [soon], [soon, late], [soon, late, lost], [hidden])] == [
        *("", "ok 0.3 s", "ok late", "GRADE 1/3 0.3 s", "ok hidden")
    ]


def test_logs_are_kept_and_found_again(tmp_path: Path) -> None:
    """From the cache come the same bits; each seed has its own sensors and its own file, off by 5 to 10 %."""
    drive = "double-lane-change-85-0.8"
    first = logs("family-car", drive, 2, tmp_path)
    again = logs("family-car", drive, 2, tmp_path)
    true = load_vehicle("family-car")
    for (log, car), (same, same_car) in zip(first, again, strict=True):
        assert car == same_car
        assert 0.05 <= abs(car.mass / true.mass - 1) <= 0.1
        assert set(log.channels) == set(same.channels)
        for name, values in log.channels.items():
            np.testing.assert_array_equal(values, same[name])
    assert not np.array_equal(first[0][0]["accel_y"], first[1][0]["accel_y"])
    np.testing.assert_array_equal(first[0][0]["ref_velocity_y"], first[1][0]["ref_velocity_y"])
    with pytest.raises(LeftTheRoad, match="off its path"):
        logs("in-wheel-ev", "double-lane-change-85-0.4", 1)
    with pytest.raises(InputError, match="did you mean"):
        logs("family-car", "circel", 1)


def test_every_drive_of_a_group_is_there() -> None:
    """And is measured by some group; what takes long gets a fifth of the seeds, and three at least."""
    asked = {drive for group in GROUPS.values() for drive, _ in group.drives}
    assert asked == set(SCENARIOS)
    assert set(QUICK) < asked
    assert [few(seeds) for seeds in (1, 3, 4, 15, 16, 50)] == [1, 3, 3, 3, 4, 10]


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One cache for the drives of this module."""
    return tmp_path_factory.mktemp("logs")


def test_grade_of_one_drive(kept: Path) -> None:
    """TFOBE is near its figure, above the bound, and the smoothing hook gets what the receiver tells."""
    told = []

    def smooth(estimator: object, log: Log) -> Estimates:
        told.append((estimator, log))
        return scan(estimator, log)  # type: ignore[arg-type]

    drive = "straight-constant-speed"
    found = run(
        ["family-car"], ["tfobe"], 2, only=["grade", "coverage"], drives=[drive], cache=kept, smooth=smooth
    )
    by_what = {score.what: score for score in found.scores}
    bus = by_what["constant speed, bus"]
    assert bus.bound is not None
    assert 0.1 < bus.bound < bus.value < 0.6
    assert by_what["constant speed, bus, over bound"].value == pytest.approx(bus.value / bus.bound)
    assert by_what["grade"].value > 90  # per cent covered
    assert len(told) == 2
    assert all("vertical_speed" in log for _, log in told)
    smoothed, causal = by_what["constant speed, smoothed"], by_what["constant speed, satellite"]
    assert smoothed.value == pytest.approx(causal.value)  # nothing was smoothed


def test_the_receiver_lowers_the_bound(kept: Path) -> None:
    """And without constant errors there would be next to none left."""
    log, _ = logs("family-car", "straight-constant-speed", 2, kept)[0]
    car = load_vehicle("family-car")
    alone = least_rmse(without(log, RECEIVED), car, settle=5.0)
    assert least_rmse(log, car, settle=5.0) < 0.5 * alone
    assert 0 < least_mass_error(log, car) < 100 * MASS_OFF * np.sqrt(2 / np.pi)
    heavy = car.model_copy(update={"mass": 2 * car.mass})  # the same torque errors move it half as much
    doubled = log.with_channels(
        {name: 2 * values for name, values in log.references.items() if name.startswith("ref_force")}
    )
    assert least_rmse(without(doubled, RECEIVED), heavy, settle=5.0) < 0.8 * alone


def test_friction_of_one_drive(kept: Path) -> None:
    """No figure lies below its bound, lower bounds hold, estimators that are not judged get few seeds."""
    names = ["joint", "friction-ukf", "tfobe"]
    found = run(
        ["family-car"], names, 4, subject="joint", only=["friction", "forces"],
        drives=["double-lane-change-85-0.8"], by_drive=True, cache=kept,
    )  # fmt: skip
    by_key = {(score.what, score.estimator): score for score in found.scores}
    told = {score.estimator for score in found.scores if score.group == "friction"}
    assert told == {"joint", "friction-ukf"}  # the third gives no friction
    with_bounds = [score for score in found.scores if score.bound is not None]
    assert len(with_bounds) > 20
    # four seeds scatter by a third
    assert all(0 < score.bound < 1.3 * score.value for score in with_bounds if score.bound is not None)
    assert {"force_x_rear", "force_y_front"} <= {score.what for score in with_bounds}
    assert by_key["car 0.4–0.7: in 5–95 %", "joint"].bound is None
    assert by_key["car < 0.4: lower ≤ truth", "friction-ukf"].value > 95
    error = by_key["car ≥ 0.7: median", "friction-ukf"]
    assert error.value < 40
    assert len(error.seeds["family-car"]) == 3
    assert len(by_key["car ≥ 0.7: median", "joint"].seeds["family-car"]) == 4
    signed = by_key["double-lane-change-85-0.8, car ≥ 0.7: too high by", "friction-ukf"]
    assert abs(signed.value) <= error.value * 1.01
    with pytest.raises(InputError, match="nothing is measured there"):
        run(["family-car"], ["tfobe"], 1, only=["grade"], drives=["circle"])


def test_what_is_left_out_is_named() -> None:
    """A car that leaves the road has no figures, and a note."""
    found = run(["in-wheel-ev"], ["friction-ukf"], 1, drives=["double-lane-change-85-0.4"])
    assert found.scores == []
    assert len(found.notes) == 1
    assert "leaves the road" in found.notes[0]
