"""What a person should know of a result, though it is no sensor's fault."""

from __future__ import annotations

import numpy as np

from roadstate.core import Estimates
from roadstate.core.constants import GRAVITY
from roadstate.estimators.soft_ground import FAR

_FAR = 0.3  # by which a mass that was learnt differs from the file's, as a share of that,
_SURE = 2.0  # and of its own 1σ, before anybody is told


def remarks(estimates: Estimates, mass: float | None, accel_bias: float | None) -> list[str]:
    """One sentence each.

    Args:
        estimates: of one estimator.
        mass: that it was told, kg; ``None`` where nobody knows.
        accel_bias: 1σ of the accelerometer's bias that it was told, m/s²; likewise.
    """
    found = []
    if mass is not None:
        found.append(_of_mass(estimates, mass))
    if accel_bias is not None:
        found.append(_of_bias(estimates, accel_bias))
    return [one for one in found if one is not None]


def _of_mass(estimates: Estimates, mass: float) -> str | None:
    learnt, std = _last(estimates, "mass")
    apart = learnt - mass
    if not abs(apart) >= max(_FAR * mass, _SURE * std):
        return None
    much = f"{100 * abs(apart) / mass:.0f} % {'more' if apart > 0 else 'less'}"
    why = "a load, a trailer" if apart > 0 else "an unladen car"
    return (
        f"mass: {learnt:.0f} kg in the end, {much} than the vehicle file's {mass:.0f} kg: {why}, or a"
        " torque in another unit than the mapping says"
    )


def _of_bias(estimates: Estimates, usual: float) -> str | None:
    learnt, _ = _last(estimates, "accel_x_bias")
    if not abs(learnt) >= FAR[1] * usual > 0:
        return None
    # torques that explain more than the accelerometer reads leave it reading too little
    ground = ", or ground that holds back more (snow, gravel: raise prior.rolling_resistance_std)"
    return (
        f"accel_x_bias: {learnt:.2f} m/s^2 in the end, the vehicle file's 1 sigma is {usual:.2g}: an"
        f" accelerometer that is tilted by {100 * abs(learnt) / GRAVITY:.0f} %{ground if learnt < 0 else ''};"
        " raise sensors.accel.bias if it is"
    )


def _last(estimates: Estimates, name: str) -> tuple[float, float]:
    """The last value that there is, and its 1σ; NaN where there is none."""
    values = estimates.values.get(name)
    if values is None or not np.isfinite(values).any():
        return np.nan, np.nan
    last = int(np.flatnonzero(np.isfinite(values))[-1])
    return float(values[last]), float(estimates.std[name][last])
