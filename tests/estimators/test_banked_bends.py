"""Bends as roads have them: banked towards their inside."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import SATELLITE, on_plant
from benchmarks.banked_bends import FRICTION, ROADS, Bends
from benchmarks.by_bus import driven

from roadstate.core import WHEELS, Log, reference
from roadstate.core.constants import GRAVITY
from roadstate.estimators import build
from roadstate.estimators.banked import pressed
from roadstate.run import scan
from roadstate.vehicles import Vehicle

GENTLE = ROADS["80 km/h, 200 m, 7 %, run-off in the spiral"]
TRACK = ROADS["90 km/h, 120 m, 16 %, run-off in the spiral"]
SUDDEN = ROADS["the same, steered within .5 s"]
SLOW = ROADS["54 km/h, 180 m, 25 %, made for 77 km/h"]
LEANING = ROADS["29 km/h, straight, leaning by 20 %"]


@pytest.fixture(scope="module")
def gentle() -> tuple[Log, Vehicle]:
    """Bends whose bank comes with their curvature."""
    return on_plant("family-car", GENTLE.scenario(), 1)[0]


@pytest.fixture(scope="module")
def sudden() -> tuple[Log, Vehicle]:
    """Bends steered into within half a second, where two thirds of the run-off have gone by."""
    return on_plant("suv", SUDDEN.scenario(), 1)[0]


def test_a_track_s_bend_presses_tires_on() -> None:
    """By 7 % of the weight; without it they seemed to use .015 more of the friction, and held in 79 %."""
    apart, held = [], []
    for log, said in driven("family-car", TRACK.scenario(), 4):
        later = log.time - log.time[0] > 5.0
        presses = sum(log[f"ref_load_{w}"] for w in WHEELS)[later]
        assert np.max(presses) > 1.06 * np.min(presses)
        off = (said.values["friction_used"] - reference("friction_used", log.channels))[later]
        apart.append(np.mean(off))
        held.append(np.mean(np.abs(off) < 1.96 * said.std["friction_used"][later]))
    assert abs(np.mean(apart)) < 0.008
    assert np.mean(held) > 0.86


@pytest.mark.parametrize("drive", [SLOW, LEANING], ids=["slow", "leaning"])
def test_a_car_that_a_road_holds_askew_has_no_faulty_sensor(drive: Bends) -> None:
    """What weighs on the lateral accelerometer there is no turn, and looks like a turn to the other side."""
    for log, said in driven("family-car", drive.scenario(), 2):
        assert not said.metadata.get("faults")
        later = log.time - log.time[0] > 5.0
        off = (said.values["bank"] - log["ref_bank"])[later]
        # the accelerometer's own offset is most of it
        assert np.sqrt(np.mean(off**2)) < 0.04
        assert np.std(off) < 0.015


@pytest.mark.parametrize("wrong", ["steering_wheel", "yaw_rate"])
def test_a_wrong_sign_is_found_on_a_banked_track(wrong: str) -> None:
    """A car that seems to turn otherwise than it is steered and pushed may slide, but not for long."""
    (log, car), *_ = on_plant("family-car", SLOW.scenario(), 2)
    log = without(log, SATELLITE)
    log = log.with_channels({wrong: -log[wrong]})
    found = scan(build("joint", car, log.available), log).metadata["faults"]
    assert any(fault["fault"].startswith(f"{wrong}: wrong sign") for fault in found)


@pytest.mark.parametrize("slope", [0.0, -0.2])
@pytest.mark.parametrize(("radius", "bank"), [(100.0, -0.25), (-100.0, 0.25), (100.0, 0.1), (1e9, -0.4)])
def test_a_road_that_leans_presses_the_car(radius: float, bank: float, slope: float) -> None:
    """Of gravity and the centrifugal force, what is square to the road; and how that errs, by differences."""
    speed, unsure = 20.0, (0.004, 0.01)
    lateral = speed**2 / radius / GRAVITY
    # what may be the body's roll counts less, and errs by the rest
    counts = bank**4 / (bank**4 + 0.08**4)

    def square(uphill: float, left: float) -> float:
        return float(np.sqrt(1 - uphill**2 - left**2) - lateral * left)

    leans = [[GRAVITY * sine, GRAVITY * sure] for sine, sure in zip((slope, bank), unsure, strict=True)]
    share, std = np.asarray(pressed(*(jnp.asarray(x) for x in (speed, speed / radius, *leans))))
    rest = lateral * bank * (1 - counts)
    assert 1 + share == pytest.approx(square(slope, bank) + rest, rel=1e-12)
    ups = (square(slope + unsure[0], bank) - square(slope - unsure[0], bank)) / 2
    sides = (square(slope, bank + unsure[1]) - square(slope, bank - unsure[1])) / 2
    assert std == pytest.approx(np.hypot(np.hypot(ups, sides), rest), rel=0.1)


@pytest.mark.usefixtures("optimised")
def test_a_dry_road_that_banks_is_no_slippery_one(gentle: tuple[Log, Vehicle]) -> None:
    """What the bank takes of the lateral acceleration could pass for a slide of saturated tires."""
    log, car = gentle
    joint = build("joint", car, log.available)
    values = scan(joint, log).values
    late = log.time > 2
    assert np.ptp(log["ref_bank"]) > 1.9 * GENTLE.bank
    assert np.nanmax(values["friction_used"]) < 0.35
    assert (values["friction_peak_upper"][late] > FRICTION).all()
    assert (values["friction_peak_lower"] < FRICTION).all()
    assert np.sqrt(np.mean((values["velocity_y"] - log["ref_velocity_y"])[late] ** 2)) < 0.08
    assert np.sqrt(np.mean((values["bank"] - log["ref_bank"])[late] ** 2)) < 0.02
    # the roll rate tells how the bank changes
    assert (values["friction_peak"] > 0.5).all()
    turned = scan(joint, Log(log.time, {**log.channels, "roll_rate": -log["roll_rate"]}))
    faults = [fault["fault"] for fault in turned.metadata["faults"]]
    assert any(fault.startswith("roll_rate: it and accel_y contradict") for fault in faults)
    assert (turned.values["friction_peak_upper"][late] > FRICTION).mean() > 0.95


@pytest.mark.usefixtures("optimised")
def test_nor_without_a_roll_rate(gentle: tuple[Log, Vehicle]) -> None:
    log, car = gentle
    log = without(log, ("roll_rate",))
    values = scan(build("joint", car, log.available), log).values
    assert (values["friction_peak_upper"][log.time > 2] > FRICTION).all()
    assert (values["friction_peak_lower"] < FRICTION).all()
    assert (values["friction_peak"] > 0.5).all()


@pytest.mark.parametrize("known", [True, False], ids=["roll rate", "no roll rate"])
@pytest.mark.usefixtures("optimised")
def test_a_bank_that_comes_before_its_bend_is_no_ice(known: bool, sudden: tuple[Log, Vehicle]) -> None:
    log, car = sudden
    log = log if known else without(log, ("roll_rate",))
    values = scan(build("joint", car, log.available), log).values
    late = log.time > 2
    assert (values["friction_peak_upper"][late] > FRICTION).all()
    assert (values["friction_peak_lower"] < FRICTION).all()
    # a bank that has just come does not pass for a slide
    assert np.abs(values["velocity_y"] - log["ref_velocity_y"])[late].max() < 0.2
