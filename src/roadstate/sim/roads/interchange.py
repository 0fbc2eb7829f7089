"""The interchange ramp of paper 002 as a road."""

from __future__ import annotations

import numpy as np

from roadstate.sim.roads.centreline import Bend, make_road
from roadstate.sim.roads.friction import FrictionMap, uniform
from roadstate.sim.roads.grade import interchange_ramp
from roadstate.sim.roads.road import Road

_LOOP = (
    Bend(150.0),
    Bend(60.0, 0.0, 1 / 90),
    Bend(300.0, 1 / 90),
    Bend(60.0, 1 / 90, 0.0),
    Bend(80.0),
    Bend(60.0, 0.0, -1 / 120),
    Bend(150.0, -1 / 120),
    Bend(60.0, -1 / 120, 0.0),
    Bend(380.0),
)


def interchange_road(friction: FrictionMap | None = None, *, curved: bool = False) -> Road:
    """The ramp of paper 002 (Luo et al., J. Vibroengineering 2024): §4.1, 4.2 straight; §4.3 curved.

    The grades are those of :func:`roadstate.sim.roads.grade.interchange_ramp`. The paper does not print the
    plan of the curved ramp; the one here is chosen: a loop to the left of 90 m radius with clothoids of 60 m
    between 150 m and 570 m, and a counter-bend of 120 m radius.

    Args:
        friction: by place; default 0.85 everywhere, which the paper does not print either.
        curved: whether with the bends.
    """
    profile = interchange_ramp()
    bends = _LOOP if curved else (Bend(float(sum(b.length for b in _LOOP))),)
    return make_road(
        bends,
        height=profile.over_plan,
        friction=friction if friction is not None else uniform(0.85),
        pose=(0.0, 0.0, float(np.deg2rad(55.0))),
    )
