"""Plants: cars to be driven on a road, from the reference multibody to the planar models of the papers."""

from __future__ import annotations

from roadstate.sim.plant.base import AUTOMATIC, NEUTRAL, REVERSE, Controls, Plant, Road, RoadPoint, Truth
from roadstate.sim.plant.build import multibody_plant
from roadstate.sim.plant.figures import PlantFigures, load_plant_figures
from roadstate.sim.plant.multibody import MultibodyPlant

__all__ = [
    "AUTOMATIC",
    "NEUTRAL",
    "REVERSE",
    "Controls",
    "MultibodyPlant",
    "Plant",
    "PlantFigures",
    "Road",
    "RoadPoint",
    "Truth",
    "load_plant_figures",
    "multibody_plant",
]
