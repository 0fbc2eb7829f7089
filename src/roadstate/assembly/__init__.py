"""From a vehicle model to a state-space model, by name: which states, which parameters, which sensors."""

from roadstate.assembly.assembled import AssembledModel
from roadstate.assembly.build import assemble
from roadstate.assembly.rows import Grouping

__all__ = ["AssembledModel", "Grouping", "assemble"]
