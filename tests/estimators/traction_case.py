"""A traction meter, sample by sample."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np

from roadstate.estimators.traction import Traction, TractionMeter, TractionState
from roadstate.vehicles import Vehicle

NAN = np.nan
ENGINE = ("engine_torque", "gear_ratio")
SPEEDS = ("engine_torque", "engine_speed")
DT = 0.01


def changed(vehicle: Vehicle, **driveline: Any) -> Vehicle:
    return vehicle.model_copy(update={"driveline": vehicle.driveline.model_copy(update=driveline)})


def take(
    meter: TractionMeter, state: TractionState, speed: float = 15.0, dt: float = DT, **sample: float
) -> tuple[TractionState, Traction]:
    arrays = {c: jnp.asarray(sample.get(c, NAN)) for c in meter.channels}
    return meter.read(state, arrays, jnp.asarray(speed), jnp.asarray(dt))


def once(meter: TractionMeter, speed: float = 15.0, **sample: float) -> Traction:
    return take(meter, meter.init(), speed, **sample)[1]
