"""Paper 000's asphalt with production sensors and a vehicle file that is off: honest, if not exact."""

from __future__ import annotations

import numpy as np

from roadstate.core import reference
from roadstate.papers.base import MISMATCHED
from roadstate.papers.plants import drive_on, recordings, told
from roadstate.papers.two_stage import PAPER
from roadstate.run import scan

_SEEDS, _SETTLED = 2, 3.0


def test_production_sensors_leave_an_interval_that_holds_the_truth() -> None:
    """And no wheel speed, gyroscope or moment draws the friction to zero: that was 67 %."""
    condition = next(c for c in PAPER.conditions if c.name == "asphalt")
    driven = drive_on(condition, matched=False)
    for seed, log in enumerate(recordings(driven, condition, MISMATCHED, _SEEDS)):
        car = told(condition.vehicle, MISMATCHED, seed)
        found = scan(PAPER.methods["aukf"].best(car, log.available), log)
        late = log.time - log.time[0] >= _SETTLED
        for axle in ("front", "rear"):
            name = f"friction_peak_{axle}"
            truth = reference(name, log.channels)
            assert truth is not None
            error = np.abs(found.values[name] - truth)[late]
            assert np.mean(error / truth[late]) < 0.45, (axle, seed)
            inside = (found.values[f"{name}_lower"] <= truth) & (truth <= found.values[f"{name}_upper"])
            assert np.mean(inside[late]) > 0.9, (axle, seed)
