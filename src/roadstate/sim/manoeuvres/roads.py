"""Roads that several manoeuvres share."""

from __future__ import annotations

from roadstate.sim.roads.centreline import Bend, make_road
from roadstate.sim.roads.friction import FrictionMap, uniform
from roadstate.sim.roads.road import Road


def plain(friction: FrictionMap | float, length: float = 2000.0) -> Road:
    """Straight, level, even.

    Args:
        friction: by place, or one.
        length: m.
    """
    chosen = friction if isinstance(friction, FrictionMap) else uniform(friction)
    return make_road([Bend(length)], friction=chosen)
