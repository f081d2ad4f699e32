"""Runs generated solvers: `load` opens a generated package in any folder."""

from typing import TYPE_CHECKING

from ..deferred import deferred

if TYPE_CHECKING:
    from .loading import load as load
    from .loading import load_trajectory as load_trajectory
    from .solver import Solver as Solver
    from .standalone.errors import AssemblyError as AssemblyError
    from .standalone.errors import CompileError as CompileError
    from .standalone.errors import EquilibriumError as EquilibriumError
    from .standalone.errors import NoCompilerError as NoCompilerError
    from .standalone.errors import PackageError as PackageError
    from .standalone.errors import SimulationError as SimulationError
    from .standalone.errors import SingularForceError as SingularForceError
    from .standalone.errors import SingularJointError as SingularJointError
    from .standalone.errors import SingularLoopError as SingularLoopError
    from .standalone.errors import SingularOutputError as SingularOutputError
    from .standalone.errors import TargetsDifferError as TargetsDifferError
    from .standalone.motion.controllers import Sample as Sample
    from .standalone.motion.functionals import At as At
    from .standalone.motion.functionals import AtEvent as AtEvent
    from .standalone.motion.functionals import Final as Final
    from .standalone.motion.functionals import Integral as Integral
    from .standalone.motion.functionals import LeastSquares as LeastSquares
    from .standalone.motion.ode import Ode as Ode
    from .standalone.state.derivatives import Jacobians as Jacobians
    from .standalone.state.frame_motion import FrameMotion as FrameMotion
    from .standalone.state.frame_motion import PointMotion as PointMotion
    from .standalone.statics.equilibrium import Equilibrium as Equilibrium
    from .standalone.statics.linearization import Linearization as Linearization
    from .standalone.trajectory.events import Event as Event
    from .standalone.trajectory.trajectory import Trajectory as Trajectory
    from .standalone.trust.diagnosis import Diagnosis as Diagnosis

_NAMES = {
    "loading": ("load", "load_trajectory"),
    "solver": ("Solver",),
    "standalone.errors": ("AssemblyError", "CompileError", "EquilibriumError", "NoCompilerError", "PackageError",
        "SimulationError", "SingularForceError", "SingularJointError", "SingularLoopError", "SingularOutputError",
        "TargetsDifferError"),
    "standalone.motion.controllers": ("Sample",),
    "standalone.motion.functionals": ("At", "AtEvent", "Final", "Integral", "LeastSquares"),
    "standalone.motion.ode": ("Ode",),
    "standalone.state.derivatives": ("Jacobians",),
    "standalone.state.frame_motion": ("FrameMotion", "PointMotion"),
    "standalone.statics.equilibrium": ("Equilibrium",),
    "standalone.statics.linearization": ("Linearization",),
    "standalone.trajectory.events": ("Event",),
    "standalone.trajectory.trajectory": ("Trajectory",),
    "standalone.trust.diagnosis": ("Diagnosis",),
}  # fmt: skip
"""The exported names by module."""

_PLACES = {name: module for module, names in _NAMES.items() for name in names}

# commands that only compile need neither solvers nor mpmath
__getattr__ = deferred(__name__, _PLACES)

if not TYPE_CHECKING:  # type checkers read the imports above instead
    __all__ = [*sorted(_PLACES)]
