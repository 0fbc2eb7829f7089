"""Paths, scripts and speed plans: what is written is what is looked up."""

from __future__ import annotations

import numpy as np
import pytest

from roadstate.core import InputError
from roadstate.sim import SpeedPlan
from roadstate.sim.manoeuvres import KMH, Path, Script, manoeuvre
from roadstate.sim.manoeuvres.base import Setting
from roadstate.sim.manoeuvres.double_lane_change import gates
from roadstate.sim.manoeuvres.path import cosine_changes, rounded, straight, waves
from roadstate.sim.manoeuvres.script import CLOSED, HELD, OPEN
from roadstate.sim.plant.base import AUTOMATIC, Controls
from roadstate.vehicles import load_vehicle

PATHS = {
    "cosine": cosine_changes([(20.0, 30.0, 3.5), (75.0, 25.0, -3.5)], d=0.5),
    "rounded": rounded([(35.0, 0.0), (65.0, 3.5), (90.0, 3.5), (115.0, 0.0)], 18.0),
    "waves": waves(60.0, 30.0, 6, 1.4),
}


@pytest.mark.parametrize("name", sorted(PATHS))
def test_slope_and_curvature_are_derivatives(name: str) -> None:
    path = PATHS[name]
    s = np.arange(1.0, 260.0, 0.25) + 0.01
    here, ahead, behind = (path.at(s + h) for h in (0.0, 0.25, -0.25))
    slope = (np.asarray(ahead.d) - np.asarray(behind.d)) / 0.5
    bend = (np.asarray(ahead.slope) - np.asarray(behind.slope)) / 0.5
    assert np.asarray(here.slope) == pytest.approx(slope, abs=2.5e-3)  # a cosine's ends
    # a half cosine's curvature jumps at its ends
    assert np.quantile(np.abs(np.asarray(here.curvature) - bend), 0.97) < 1e-3


def test_cosine_change_is_half_a_cosine() -> None:
    path = cosine_changes([(20.0, 30.0, 3.5)])
    s = np.array([0.0, 20.0, 27.5, 35.0, 50.0, 1e4])
    expected = 3.5 * (1 - np.cos(np.pi * np.clip((s - 20) / 30, 0, 1))) / 2
    assert np.asarray(path.at(s).d) == pytest.approx(expected, abs=1e-4)
    assert float(path.at(20.25).curvature) == pytest.approx(3.5 / 2 * (np.pi / 30) ** 2, rel=1e-3)


def test_rounded_corner_keeps_its_promises() -> None:
    slope, width = 3.5 / 30, 18.0
    path = PATHS["rounded"]
    s = np.linspace(0, 150, 3001)
    assert np.abs(np.asarray(path.at(s).curvature)).max() <= 2 * (3.5 / 25) / width * 1.001
    assert float(path.at(35.0).d) == pytest.approx(slope * width * (0.125 - 1 / (2 * np.pi**2)), abs=1e-4)
    for place, offset in ((10.0, 0.0), (50.0, 1.75), (77.5, 3.5), (102.5, 1.75), (200.0, 0.0)):
        assert float(path.at(place).d) == pytest.approx(offset, abs=1e-4)


def test_slalom_passes_the_gates_on_changing_sides() -> None:
    d = np.asarray(PATHS["waves"].at(60.0 + 30.0 * np.arange(6)).d)
    assert d == pytest.approx(1.4 * (-1.0) ** np.arange(6), abs=2e-3)
    assert float(PATHS["waves"].at(0.0).d) == pytest.approx(0.0, abs=1e-6)
    assert float(PATHS["waves"].at(300.0).d) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("speed", [20 * KMH, 48 * KMH, 85 * KMH])
def test_gates_ask_for_no_more_than_the_road_gives_unless_the_gates_do(speed: float) -> None:
    setting = Setting(load_vehicle("family-car"), speed, 0.8)
    path = gates((15.0, 30.0, 25.0, 25.0, 30.0), 3.5, 50.0, setting)
    s = np.linspace(0, 250, 2001)
    wanted = np.abs(np.asarray(path.at(s).curvature)).max() * speed**2
    assert wanted < 0.86 * 0.8 * 9.81 or speed > 80 * KMH  # there the gates ask for more
    # lane 1.1 b + 0.25 wide: the car may be 0.05 b + 0.125 m off its middle
    at_exit, at_entry = (float(path.at(x).d) for x in (65.0, 95.0))
    assert at_exit < 0.21
    assert at_entry > 3.5 - 0.21


def test_straight_path_is_where_it_is_put() -> None:
    assert np.asarray(straight(1.5).at(np.array([-5.0, 0.0, 1e4])).d) == pytest.approx(1.5)
    assert isinstance(straight(), Path)


def test_plan_between_and_beyond_its_knots() -> None:
    plan = SpeedPlan((0.0, 2.0, 6.0), (10.0, 10.0, 2.0))
    speed, rise = plan.at(np.array([0.0, 1.0, 3.0, 6.0, 9.0]))
    assert speed == pytest.approx([10, 10, 8, 2, 2])
    assert rise == pytest.approx([0, 0, -2, -2, 0])
    for time, speeds in (
        ((0.0,), (1.0,)),
        ((1.0, 2.0), (1.0, 1.0)),
        ((0.0, 0.0), (1.0, 1.0)),
        ((0.0, 1.0), (1.0, -1.0)),
    ):
        with pytest.raises(InputError, match="speed plan"):
            SpeedPlan(time, speeds)


def test_script_says_what_was_written_when_it_was() -> None:
    plan = SpeedPlan((0.0, 4.0), (5.0, 9.0))
    script = Script.write(
        plan,
        steering_wheel=lambda t: 0.1 * t,
        throttle=0.3,
        gear=lambda t: np.where(t < 2.0, float(AUTOMATIC), 3.0),
        steer_from=1.0,
        pedals_from=2.0,
        hold_pedals_from=3.0,
    )
    assert script.duration == pytest.approx(4.0)
    early, late = script.at(0.5), script.at(3.505)
    assert [float(v) for v in (early.speed, early.accel)] == pytest.approx([5.5, 1.0])
    assert (float(early.steering), float(early.pedals)) == (CLOSED, CLOSED)
    assert (float(late.steering), float(late.pedals)) == (OPEN, HELD)
    assert float(script.at(2.5).pedals) == OPEN
    assert float(late.steering_wheel) == pytest.approx(0.3505)
    assert (float(early.gear), float(late.gear)) == (AUTOMATIC, 3.0)
    assert float(script.at(1e6).speed) == pytest.approx(9.0)


def test_impossible_paths_and_scripts_are_refused() -> None:
    with pytest.raises(InputError, match="overlap"):
        cosine_changes([(0.0, 30.0, 1.0), (20.0, 30.0, -1.0)])
    with pytest.raises(InputError, match="two corners"):
        rounded([(0.0, 0.0)], 5.0)
    with pytest.raises(InputError, match="longest"):
        Script.write(SpeedPlan.constant(10.0, 1e6))
    with pytest.raises(InputError, match="not finite"):
        Script.write(SpeedPlan.constant(10.0, 1.0), throttle=np.nan)
    chosen = manoeuvre("slalom").prepare(load_vehicle("family-car"))
    with pytest.raises(InputError, match="controls of a drive"):
        chosen.replayed(Controls.make(), 0.01)
