"""Running generated solvers: `load` opens a generated package wherever it lies."""

from typing import TYPE_CHECKING

from ..deferred import deferred

if TYPE_CHECKING:
    from .loading import load, load_trajectory
    from .solver import Solver
    from .standalone.errors import (
        AssemblyError,
        CompileError,
        EquilibriumError,
        NoCompilerError,
        PackageError,
        SimulationError,
        SingularForceError,
        SingularJointError,
        SingularLoopError,
        SingularOutputError,
        TargetsDifferError,
    )
    from .standalone.motion.functionals import At, AtEvent, Final, Integral, LeastSquares
    from .standalone.state.derivatives import Jacobians
    from .standalone.state.frame_motion import FrameMotion, PointMotion
    from .standalone.statics.equilibrium import Equilibrium
    from .standalone.statics.linearization import Linearization
    from .standalone.trajectory.events import Event
    from .standalone.trajectory.trajectory import Trajectory
    from .standalone.trust.diagnosis import Diagnosis

_PLACES = {
    **dict.fromkeys(("load", "load_trajectory"), "loading"),
    **dict.fromkeys(("Solver",), "solver"),
    **dict.fromkeys(("Diagnosis",), "standalone.trust.diagnosis"),
    **dict.fromkeys(("Equilibrium",), "standalone.statics.equilibrium"),
    **dict.fromkeys(
        (
            "AssemblyError",
            "CompileError",
            "EquilibriumError",
            "NoCompilerError",
            "PackageError",
            "SimulationError",
            "SingularForceError",
            "SingularJointError",
            "SingularLoopError",
            "SingularOutputError",
            "TargetsDifferError",
        ),
        "standalone.errors",
    ),
    **dict.fromkeys(("FrameMotion", "PointMotion"), "standalone.state.frame_motion"),
    **dict.fromkeys(("At", "AtEvent", "Final", "Integral", "LeastSquares"), "standalone.motion.functionals"),
    **dict.fromkeys(("Jacobians",), "standalone.state.derivatives"),
    **dict.fromkeys(("Linearization",), "standalone.statics.linearization"),
    **dict.fromkeys(("Event",), "standalone.trajectory.events"),
    **dict.fromkeys(("Trajectory",), "standalone.trajectory.trajectory"),
}

# what only compiles needs neither solvers nor mpmath
__getattr__ = deferred(__name__, _PLACES)

__all__ = [
    "AssemblyError",
    "At",
    "AtEvent",
    "CompileError",
    "Diagnosis",
    "Equilibrium",
    "EquilibriumError",
    "Event",
    "Final",
    "FrameMotion",
    "Integral",
    "Jacobians",
    "LeastSquares",
    "Linearization",
    "NoCompilerError",
    "PackageError",
    "PointMotion",
    "SimulationError",
    "SingularForceError",
    "SingularJointError",
    "SingularLoopError",
    "SingularOutputError",
    "Solver",
    "TargetsDifferError",
    "Trajectory",
    "load",
    "load_trajectory",
]
