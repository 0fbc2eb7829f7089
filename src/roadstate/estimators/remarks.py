"""What a person should know of a result, though it is no sensor's fault."""

from __future__ import annotations

import numpy as np

from roadstate.core import Estimates

_FAR = 0.3  # by which a mass that was learnt differs from the file's, as a share of that,
_SURE = 2.0  # and of its own 1σ, before anybody is told


def remarks(estimates: Estimates, mass: float) -> list[str]:
    """One sentence each.

    Args:
        estimates: of one estimator.
        mass: that it was told, kg.
    """
    learnt = estimates.values.get("mass")
    if learnt is None or not np.isfinite(learnt).any():
        return []
    last = int(np.flatnonzero(np.isfinite(learnt))[-1])
    apart = float(learnt[last]) - mass
    if abs(apart) < max(_FAR * mass, _SURE * float(estimates.std["mass"][last])):
        return []
    much = f"{100 * abs(apart) / mass:.0f} % {'more' if apart > 0 else 'less'}"
    why = "a load, a trailer" if apart > 0 else "an unladen car"
    return [
        f"mass: {learnt[last]:.0f} kg in the end, {much} than the vehicle file's {mass:.0f} kg: {why}, or a"
        " torque in another unit than the mapping says"
    ]
