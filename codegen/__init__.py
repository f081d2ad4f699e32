"""ordernm: from a model of a multibody system to a solver with exact design sensitivities.

>>> import ordernm
>>> model = ordernm.load_model("examples/double_pendulum.yaml")
>>> report = ordernm.generate(model, "generated/double_pendulum", compile=False)
>>> solver = ordernm.load("generated/double_pendulum")
>>> udot, dudot = solver.sensitivities(*solver.initial, dp={"length_1": 1.0})
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .deferred import deferred
from .version import __version__

if TYPE_CHECKING:
    from .design.fitting import Fit, fit
    from .design.load_cases import LoadCases, load_cases
    from .design.many_motions import Motions, simulate_many
    from .design.objective import Objective, objective
    from .design.optimizing import optimize
    from .design.sweep import Sweep, sweep
    from .design.variables import Variable
    from .exporting.fmu.export import ExportedFMU, export_fmu
    from .exporting.plain_c import ExportedC, export_c
    from .generation import generate
    from .importing import Imported, from_mujoco, from_pinocchio, from_sympy, import_model
    from .model import Model, ModelBuilder, ModelError, load_model, parse_model
    from .reporting import report
    from .runtime import Solver, Trajectory, load, load_trajectory
    from .summary import Report

__all__ = [
    "ExportedC", "ExportedFMU", "Fit", "Imported", "LoadCases", "Model", "ModelBuilder", "ModelError", "Motions",
    "Objective", "Report", "Solver", "Sweep", "Trajectory", "Variable", "__version__", "export_c", "export_fmu", "fit",
    "from_mujoco", "from_pinocchio", "from_sympy", "generate", "import_model", "load", "load_cases", "load_model",
    "load_trajectory", "objective", "optimize", "parse_model", "report", "simulate_many", "sweep",
]  # fmt: skip

_PLACES = {
    "generate": "generation", "Report": "summary", "ExportedC": "exporting.plain_c", "export_c": "exporting.plain_c",
    "ExportedFMU": "exporting.fmu.export", "export_fmu": "exporting.fmu.export",
    "Imported": "importing", "from_mujoco": "importing", "from_pinocchio": "importing", "from_sympy": "importing",
    "import_model": "importing",
    "Model": "model", "ModelBuilder": "model", "ModelError": "model", "load_model": "model", "parse_model": "model",
    "Solver": "runtime", "Trajectory": "runtime", "load": "runtime", "load_trajectory": "runtime",
    "Fit": "design.fitting", "fit": "design.fitting", "LoadCases": "design.load_cases", "load_cases": "design.load_cases",
    "Motions": "design.many_motions", "simulate_many": "design.many_motions", "Objective": "design.objective",
    "objective": "design.objective", "optimize": "design.optimizing", "report": "reporting",
    "Sweep": "design.sweep", "sweep": "design.sweep", "Variable": "design.variables",
}  # fmt: skip

_MODULES = {"casadi", "jax", "reference", "runtime", "symbolic", "torch"}
"""Public modules, which ``import ordernm.NAME`` imports."""

# loading a solver needs neither sympy nor the model format
__getattr__ = deferred(__name__, _PLACES)


def __dir__() -> list[str]:
    # completion shows public names only, also before they are imported
    return sorted({*__all__, *(_MODULES & globals().keys())})
