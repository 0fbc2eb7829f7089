"""The groups of figures, in the table's order."""

from benchmarks.accuracy.groups.base import Group
from benchmarks.accuracy.groups.coverage import Coverage
from benchmarks.accuracy.groups.forces import Forces
from benchmarks.accuracy.groups.friction import Friction, FrictionOnBus
from benchmarks.accuracy.groups.grade import Grade
from benchmarks.accuracy.groups.joint_road import JointRoad
from benchmarks.accuracy.groups.mass import Mass
from benchmarks.accuracy.groups.sideslip import Sideslip

GROUPS: dict[str, type[Group]] = {
    g.name: g for g in (Grade, Friction, FrictionOnBus, JointRoad, Forces, Sideslip, Mass, Coverage)
}
"""By name."""
