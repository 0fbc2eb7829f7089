"""An engine that does not turn as the gears do: its clutch or its converter slips."""

from __future__ import annotations

import jax.numpy as jnp
import pytest
from tests.estimators.traction_case import ENGINE, changed, take

from roadstate.estimators.traction import TractionMeter
from roadstate.vehicles import Vehicle


@pytest.mark.parametrize(
    ("speed", "share", "more", "slips"),
    [
        (1.0, 0.0, 84.0, True),  # a clutch that bites
        (0.0, 0.0, 84.0, True),
        (0.0, 0.0, 0.0, False),  # an engine that has stopped
        (15.0, 0.0, 84.0, True),  # the pedal is down
        (15.0, 1.0, 0.0, False),
        (3.0, 1.0, 0.0, False),
        (15.0, 1.06, 0.0, False),  # as nearly as two sensors agree
        (15.0, 1.3, 0.0, True),  # a converter
        (-2.0, 1.0, 0.0, False),
    ],
)
def test_an_engine_that_does_not_turn_as_the_gears_do_is_not_in_mesh(
    vehicle: Vehicle, speed: float, share: float, more: float, slips: bool
) -> None:
    """Its speed is a share of that of the gears, and so many rad/s more."""
    meter, gear = TractionMeter(vehicle, (*ENGINE, "engine_speed")), 3.62 if speed < 10 else 1.28
    assert meter.source == "gear"
    total = gear * vehicle.driveline.final_drive
    engine = share * total * abs(speed) / vehicle.wheels.radius + more
    state = meter.init()._replace(since_shift=jnp.asarray(10.0), ratio=jnp.asarray(total))
    _, traction = take(meter, state, speed, engine_torque=20.0, gear_ratio=gear, engine_speed=engine)
    assert bool(traction.is_shifting) is slips


def test_what_an_engine_tells_counts_a_while_after_its_clutch_has_closed(vehicle: Vehicle) -> None:
    """Its inertia has just begun to weigh, and low passes still know of the time before."""
    meter = TractionMeter(vehicle, (*ENGINE, "engine_speed"))
    total = 3.62 * vehicle.driveline.final_drive
    turning = total * 3.0 / vehicle.wheels.radius
    state = meter.init()._replace(since_shift=jnp.asarray(10.0), ratio=jnp.asarray(total))
    told = []
    for i in range(100):
        engine = turning + (40.0 if i < 10 else 0.0)
        state, traction = take(meter, state, 3.0, engine_torque=20.0, gear_ratio=3.62, engine_speed=engine)
        told.append(bool(traction.is_shifting))
    assert told.index(False) == pytest.approx(10 + 70, abs=1)
    assert not any(told[told.index(False) :])


@pytest.mark.parametrize(("turning", "slips"), [(0.0, True), (90.0, True), (110.0, False), (400.0, False)])
def test_gears_that_turn_more_slowly_than_an_engine_idles_slip(
    vehicle: Vehicle, turning: float, slips: bool
) -> None:
    """So they do where an engine's speed has been silent; a car of one gear has nothing that slips."""
    total = 3.62 * vehicle.driveline.final_drive
    one = changed(vehicle, gear_ratios=(3.62,))
    for car, channels in ((vehicle, ENGINE), (vehicle, (*ENGINE, "engine_speed")), (one, ENGINE)):
        meter = TractionMeter(car, channels)
        state = meter.init()._replace(since_shift=jnp.asarray(10.0), ratio=jnp.asarray(total))
        _, traction = take(
            meter, state, turning / total * vehicle.wheels.radius, engine_torque=20.0, gear_ratio=3.62
        )
        assert bool(traction.is_shifting) is (slips and car is vehicle)
