"""`Solver` with all sections, for packages of this version; a package carries those that it uses, see `sections`."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from .long_texts import LongTexts
from .standalone.assembly.loops import Loops
from .standalone.assembly.partitions import Partitions
from .standalone.assembly.redundancy import Redundancy
from .standalone.calls.package import Package
from .standalone.motion.functional_gradients import FunctionalGradients
from .standalone.motion.prescribed_branches import PrescribedBranches
from .standalone.state.driving_forces import DrivingForces
from .standalone.state.dynamics import Dynamics
from .standalone.state.energies import Energies
from .standalone.state.frames import Frames
from .standalone.state.loop_forces import LoopForces
from .standalone.state.outputs import Outputs
from .standalone.state.reactions import Reactions
from .standalone.state.tree_forces import TreeForces
from .standalone.state.weighted_gradients import WeightedGradients
from .standalone.statics.statics import Statics
from .standalone.trust.diagnosing import Diagnosing
from .standalone.trust.precision import Precision, extended
from .standalone.trust.single_precision import SinglePrecision

if TYPE_CHECKING:
    from ..model import Model


class Solver(
    Statics,
    Diagnosing,
    Dynamics,
    WeightedGradients,
    Energies,
    Outputs,
    TreeForces,
    PrescribedBranches,
    FunctionalGradients,
    DrivingForces,
    Reactions,
    Frames,
    Loops,
    Redundancy,
    Partitions,
    Precision,
    SinglePrecision,
):
    __doc__ = Package.__doc__

    def __init__(self, folder: str | os.PathLike[str], target: str | None = None):
        super().__init__(folder, target)
        if self.closure_names:  # some members of mechanisms with loops are others
            self.__class__ = LoopSolver

    def in_precision(self, digits: int = 40, model: Model | str | os.PathLike[str] | None = None) -> Any:
        return extended(self, digits, None if model is None else LongTexts(model, self._manifest, digits))

    in_precision.__doc__ = (Precision.in_precision.__doc__ or "").replace(
        "        Returns",
        """        model : Model or path, optional
            What the package was generated from: numbers that were computed from it are computed in these digits too, from the
            doubles that the model file is read as.

        Returns""",
    )


class LoopSolver(LoopForces, Solver):
    __doc__ = Package.__doc__


__all__ = ["LoopSolver", "Solver"]
