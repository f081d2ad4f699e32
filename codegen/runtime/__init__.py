"""Running generated solvers: `load` opens a generated package wherever it lies."""

from typing import TYPE_CHECKING

from ..deferred import deferred

if TYPE_CHECKING:
    from .loading import load, load_trajectory
    from .solver import Solver
    from .standalone.diagnosis import Diagnosis
    from .standalone.equilibrium import Equilibrium
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
    from .standalone.frame_motion import FrameMotion, PointMotion
    from .standalone.functionals import At, AtEvent, Final, Integral, LeastSquares
    from .standalone.jacobians import Jacobians
    from .standalone.linearization import Linearization
    from .standalone.motion_events import Event
    from .standalone.trajectory import Trajectory

_PLACES = {
    **dict.fromkeys(("load", "load_trajectory"), "loading"),
    **dict.fromkeys(("Solver",), "solver"),
    **dict.fromkeys(("Diagnosis",), "standalone.diagnosis"),
    **dict.fromkeys(("Equilibrium",), "standalone.equilibrium"),
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
    **dict.fromkeys(("FrameMotion", "PointMotion"), "standalone.frame_motion"),
    **dict.fromkeys(("At", "AtEvent", "Final", "Integral", "LeastSquares"), "standalone.functionals"),
    **dict.fromkeys(("Jacobians",), "standalone.jacobians"),
    **dict.fromkeys(("Linearization",), "standalone.linearization"),
    **dict.fromkeys(("Event",), "standalone.motion_events"),
    **dict.fromkeys(("Trajectory",), "standalone.trajectory"),
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
