"""`Solver` with all sections, for packages of this version; a package carries those that it uses, see `sections`."""

from __future__ import annotations

from .standalone.diagnosing import Diagnosing
from .standalone.dynamics import Dynamics
from .standalone.energies import Energies
from .standalone.judging import Judging
from .standalone.loops import Loops
from .standalone.outputs import Outputs
from .standalone.package import Package
from .standalone.partitions import Partitions
from .standalone.reactions import Reactions
from .standalone.redundancy import Redundancy
from .standalone.statics import Statics
from .standalone.tree_forces import TreeForces
from .standalone.weighted_gradients import WeightedGradients


class Solver(
    Statics,
    Diagnosing,
    Dynamics,
    WeightedGradients,
    Energies,
    Outputs,
    TreeForces,
    Judging,
    Reactions,
    Loops,
    Redundancy,
    Partitions,
):
    __doc__ = Package.__doc__


__all__ = ["Solver"]
