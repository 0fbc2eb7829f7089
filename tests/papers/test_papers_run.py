"""The runner of papers: what it drives, records, tells the estimators and makes of their errors."""

from __future__ import annotations

import math
from dataclasses import replace
from zlib import crc32

import numpy as np
import pytest
from tests.papers.fake_paper import LOST, PAPER, cell, drive, louder, mae

from roadstate.estimators import build
from roadstate.papers.base import MISMATCHED, PLANTS
from roadstate.papers.plants import drive_on, recordings, told
from roadstate.papers.run import Outcome, PaperResult, Spread, run_papers
from roadstate.papers.tables import lines, markdown, notes, papers_json
from roadstate.run import scan
from roadstate.sim.plant import multibody_plant
from roadstate.sim.run import drive as drive_car
from roadstate.sim.run import record
from roadstate.sim.sensors import sensor_preset, to_log

SEEDS = 3
CONDITION = PAPER.conditions[0]


@pytest.fixture(scope="module")
def result() -> PaperResult:
    """The fake paper on all plants."""
    [found] = run_papers([PAPER], seeds=SEEDS)
    return found


def outcome(result: PaperResult, plant: str, row: str) -> Outcome:
    """A cell by its row."""
    [found] = [o for o in result.cells[plant] if o.cell.row == row]
    return found


def by_hand(seed: int, estimator: str, plant: str) -> float:
    """One seed's error, without anything of the runner: drive, record, build, scan."""
    vehicle = CONDITION.vehicle
    of = CONDITION.matched(vehicle) if plant == "matched" else multibody_plant(vehicle)
    driven = drive_car(of, drive(vehicle), vehicle, rate=200.0)
    suite = sensor_preset("automotive") if plant == MISMATCHED else CONDITION.sensors
    plain = to_log(record(driven, suite, seed=seed))
    log = louder(plain, np.random.default_rng([seed, crc32(b"disturb")]))
    one = build(estimator, told(vehicle, plant, seed), log.available)
    return mae(scan(one, log), log)


@pytest.mark.parametrize("plant", PLANTS)
def test_means_and_deviations_are_those_of_the_seeds_one_by_one(result: PaperResult, plant: str) -> None:
    found = outcome(result, plant, "easy")
    for estimator, spread in (("debe", found.as_printed), ("kmbe", found.best)):
        values = [by_hand(seed, estimator, plant) for seed in range(SEEDS)]
        assert spread is not None
        assert spread.mean == pytest.approx(sum(values) / SEEDS, rel=1e-6)
        assert spread.std == pytest.approx(np.std(values, ddof=1), rel=1e-4)
        assert spread.lost == 0
        assert min(values) < max(values)  # the seeds do differ


def test_the_same_call_gives_the_same_numbers(result: PaperResult) -> None:
    [again] = run_papers([PAPER], plants=["matched", MISMATCHED], seeds=SEEDS)
    whole = papers_json([result])["fake"]
    del whole["full"]
    assert papers_json([again])["fake"] == whole


def test_json_has_the_promised_shape(result: PaperResult) -> None:
    found = papers_json([result])
    assert list(found) == ["fake"]
    assert tuple(found["fake"]) == PLANTS
    for plant in PLANTS:
        rows = found["fake"][plant]["tab. 1"]
        assert list(rows) == ["easy", "hard", "no figure", "lost", "steered"]
        assert rows["easy"]["MAE"]["paper"] == 1000.0
        assert rows["no figure"]["MAE"]["paper"] is None
        assert rows["no figure"]["MAE"]["ours_best"] == rows["easy"]["MAE"]["ours_best"]
        assert rows["hard"]["MAE"]["bound"] == pytest.approx(1e-3 * CONDITION.vehicle.mass)
        assert "bound" not in rows["easy"]["MAE"]
        for columns in rows.values():
            made = columns["MAE"]
            assert made["seeds"] == SEEDS
            assert {"paper", "ours_as_printed", "ours_best", "std", "std_as_printed", "unit"} < set(made)


def test_a_seed_that_diverges_is_counted(result: PaperResult) -> None:
    values = [by_hand(seed, "kmbe", "matched") for seed in range(SEEDS) if seed != LOST]
    found = outcome(result, "matched", "lost")
    assert found.best is not None
    assert found.best.lost == 1
    assert found.best.mean == pytest.approx(sum(values) / 2, rel=1e-6)
    assert not found.meets_paper  # although the mean of the others does
    [of] = lines(result.cells["matched"]).values()
    assert [line.met for line in of] == ["✓", "", "", "", "✓"]
    assert of[3].best_spread == f"{of[3].best.removesuffix(', 1 lost')} ± {found.best.std:.3f}, 1 lost"
    assert float(of[3].best.removesuffix(", 1 lost")) == pytest.approx(found.best.mean, rel=0.01)


def test_what_the_sensors_do_not_give_leaves_a_cell_empty_and_says_why(result: PaperResult) -> None:
    for plant in PLANTS:
        made = papers_json([result])["fake"][plant]["tab. 1"]["steered"]["MAE"]
        if plant == MISMATCHED:  # production cars do not measure the road wheels' angle
            assert made["ours_best"] is None
            assert made["ours_as_printed"] is None
            assert made["std"] is None
            assert made["reason"] == "no angle of the road wheels; measure it"
            assert "steered: no angle of the road wheels; measure it." in notes(result.cells[plant])
        else:
            assert made["ours_best"] > 0
            assert "reason" not in made


def test_a_drive_that_breaks_down_leaves_its_cells_empty(result: PaperResult) -> None:
    def impossible(vehicle: object) -> object:
        return replace(drive(CONDITION.vehicle), speed=math.nan)

    broken = replace(CONDITION, name="broken", manoeuvre=impossible)
    cells = (cell("easy", 1.0, "grade"), replace(cell("broken", 1.0, "grade"), condition="broken"))
    paper = replace(PAPER, conditions=(CONDITION, broken), cells=cells, figures=())
    [found] = run_papers([paper], plants=["matched"], seeds=2)
    easy, none = found.cells["matched"]
    assert easy.best is not None
    assert none.best is None
    assert "breaks down" in none.reason


def test_spread_of_nothing_finite_and_of_one() -> None:
    assert Spread.of([math.nan, math.inf]) == Spread(None, None, 2)
    assert Spread.of([2.0]) == Spread(2.0, None, 0)
    assert Spread.of([1.0, 3.0, math.nan]) == Spread(2.0, math.sqrt(2), 1)


def test_the_mismatched_vehicle_is_off_as_promised() -> None:
    true = CONDITION.vehicle
    assert all(told(true, plant, 3) is true for plant in PLANTS if plant != MISMATCHED)
    cars = [told(true, MISMATCHED, seed) for seed in range(40)]
    assert told(true, MISMATCHED, 7) == cars[7]
    ratios = {
        "mass": [c.mass / true.mass for c in cars],
        "yaw inertia": [c.yaw_inertia / true.yaw_inertia for c in cars],
        "height": [c.geometry.cg_height / true.geometry.cg_height for c in cars],
        "stiffness": [c.tires.cornering_stiffness_rear / true.tires.cornering_stiffness_rear for c in cars],
        "slip": [c.tires.slip_stiffness / true.tires.slip_stiffness for c in cars],
        "friction": [c.tires.friction / true.tires.friction for c in cars],
        "drag": [c.drag_area / true.drag_area for c in cars],
        "rolling": [c.rolling_resistance.coefficient / true.rolling_resistance.coefficient for c in cars],
        "pitch": [c.body.pitch_gradient / true.body.pitch_gradient for c in cars],
    }
    for name, values in ratios.items():
        off = np.asarray(values) - 1
        assert np.all((np.abs(off) >= 0.05) & (np.abs(off) <= 0.10)), name
        assert 10 < np.sum(off > 0) < 30, name
        assert len(set(values)) == len(cars), name
    shift = [(c.geometry.cg_to_front_axle - true.geometry.cg_to_front_axle) / true.wheelbase for c in cars]
    radius = [c.wheels.radius / true.wheels.radius - 1 for c in cars]
    assert 0.01 <= min(map(abs, shift)) <= max(map(abs, shift)) <= 0.02
    assert 0.003 <= min(map(abs, radius)) <= max(map(abs, radius)) <= 0.01
    assert all(c.wheelbase == pytest.approx(true.wheelbase) for c in cars)
    # and what the file says of how exact they are is true
    assert np.std(np.asarray(ratios["mass"]) - 1) == pytest.approx(cars[0].prior.mass_relative, rel=0.1)
    rolling = (np.asarray(ratios["rolling"]) - 1) * true.rolling_resistance.coefficient
    assert np.std(rolling) == pytest.approx(cars[0].prior.rolling_resistance_std, rel=0.1)
    assert np.std(radius) == pytest.approx(cars[0].sensors.wheel_speed.scale, rel=0.15)
    # one figure's sign says nothing of another's
    assert abs(np.corrcoef(np.sign(ratios["mass"] - np.ones(40)), np.sign(np.asarray(shift)))[0, 1]) < 0.5


def test_recordings_differ_in_their_noise_alone() -> None:
    driven = drive_on(CONDITION, matched=True)
    first, second = recordings(driven, CONDITION, "matched", 2)
    assert np.array_equal(first.time, second.time)
    assert first.available == second.available
    for name, values in first.references.items():
        np.testing.assert_array_equal(values, second[name])
    for name in ("wheel_speed_fl", "yaw_rate", "steer"):
        apart = first[name] - second[name]
        assert np.std(apart) > 0
    [production, _] = recordings(driven, CONDITION, MISMATCHED, 2)
    assert "steer" in first.available
    assert "steer" not in production.available


def test_progress_ends_where_it_said_it_would() -> None:
    told_of: list[tuple[int, int]] = []
    run_papers([PAPER], plants=["matched"], seeds=1, progress=lambda _, *at: told_of.append(at))
    counts = [done for done, _ in told_of]
    assert counts == sorted(counts)
    assert told_of[-1] == (5, 5)  # a recording, two methods with two settings each


def test_a_defect_ends_the_run() -> None:
    def broken(estimates: object, log: object) -> float:
        raise ZeroDivisionError("mine")

    paper = replace(PAPER, cells=(replace(PAPER.cells[0], measure=broken),), figures=())
    with pytest.raises(ZeroDivisionError, match="mine"):
        run_papers([paper], plants=["matched"], seeds=1)


def test_markdown_is_a_table_that_holds_the_numbers(result: PaperResult) -> None:
    text = markdown([result])
    assert "Fake <journal> | 2024" in text
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert {line.count("|") - line.count("\\|") for line in rows} == {rows[0].count("|")}
    [easy] = [line for line in rows if line.startswith("| easy |")]
    [of] = lines(result.cells["full"]).values()
    assert f" {of[0].best_spread} ✓ |" in easy
    assert "- full-mismatched: steered: no angle of the road wheels; measure it." in text
