"""Roads: place, height, slopes, unevenness and friction at any point. Names are imported when first used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from roadstate.lazy import lazily

if TYPE_CHECKING:
    from roadstate.sim.roads.centreline import Bend, half_cosine, make_road
    from roadstate.sim.roads.files import json_schema, load_road, parse_road, read_road, save_road
    from roadstate.sim.roads.friction import FrictionMap, chessboard, joint, patches, split, uniform
    from roadstate.sim.roads.grade import GradeProfile, interchange_ramp
    from roadstate.sim.roads.interchange import interchange_road
    from roadstate.sim.roads.opencrg import read_opencrg
    from roadstate.sim.roads.road import Road, RoadPoint
    from roadstate.sim.roads.roughness import rough_surface
    from roadstate.sim.roads.spec import RoadSpec

_HOME = {
    "Bend": "centreline",
    "FrictionMap": "friction",
    "GradeProfile": "grade",
    "Road": "road",
    "RoadPoint": "road",
    "RoadSpec": "spec",
    "chessboard": "friction",
    "half_cosine": "centreline",
    "interchange_ramp": "grade",
    "interchange_road": "interchange",
    "joint": "friction",
    "json_schema": "files",
    "load_road": "files",
    "make_road": "centreline",
    "parse_road": "files",
    "patches": "friction",
    "read_opencrg": "opencrg",
    "read_road": "files",
    "rough_surface": "roughness",
    "save_road": "files",
    "split": "friction",
    "uniform": "friction",
}

__all__ = [
    "Bend",
    "FrictionMap",
    "GradeProfile",
    "Road",
    "RoadPoint",
    "RoadSpec",
    "chessboard",
    "half_cosine",
    "interchange_ramp",
    "interchange_road",
    "joint",
    "json_schema",
    "load_road",
    "make_road",
    "parse_road",
    "patches",
    "read_opencrg",
    "read_road",
    "rough_surface",
    "save_road",
    "split",
    "uniform",
]

__getattr__ = lazily(__name__, _HOME)
