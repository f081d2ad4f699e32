"""ordernm: from a model of a multibody system to a solver with exact design sensitivities.

>>> import ordernm
>>> model = ordernm.load_model("examples/double_pendulum.yaml")
>>> ordernm.generate(model, "generated/double_pendulum")
>>> solver = ordernm.load("generated/double_pendulum")
>>> udot, dudot = solver.sensitivities(*solver.initial, dp=[1.0, 0.0])
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .deferred import deferred
from .version import __version__

if TYPE_CHECKING:
    from .generation import generate
    from .importing import Imported, from_mujoco, from_pinocchio, import_model
    from .model import Model, ModelBuilder, ModelError, load_model, parse_model
    from .reporting import report
    from .runtime import Solver, Trajectory, load, load_trajectory
    from .runtime.design_sweep import Sweep, sweep
    from .runtime.fitting import Fit, fit
    from .runtime.load_cases import LoadCases, load_cases
    from .runtime.many_motions import Motions, simulate_many
    from .runtime.objective import Objective, objective
    from .runtime.optimizing import optimize
    from .runtime.variables import Variable
    from .summary import Report

__all__ = [
    "Fit", "Imported", "LoadCases", "Model", "ModelBuilder", "ModelError", "Motions", "Objective", "Report", "Solver",
    "Sweep", "Trajectory", "Variable", "__version__", "fit", "from_mujoco", "from_pinocchio", "generate", "import_model",
    "load", "load_cases", "load_model", "load_trajectory", "objective", "optimize", "parse_model", "report",
    "simulate_many", "sweep",
]  # fmt: skip

_PLACES = {
    "generate": "generation", "Report": "summary",
    "Imported": "importing", "from_mujoco": "importing", "from_pinocchio": "importing", "import_model": "importing",
    "Model": "model", "ModelBuilder": "model", "ModelError": "model", "load_model": "model", "parse_model": "model",
    "Solver": "runtime", "Trajectory": "runtime", "load": "runtime", "load_trajectory": "runtime",
    "Fit": "runtime.fitting", "fit": "runtime.fitting", "LoadCases": "runtime.load_cases", "load_cases": "runtime.load_cases",
    "Motions": "runtime.many_motions", "simulate_many": "runtime.many_motions", "Objective": "runtime.objective",
    "objective": "runtime.objective", "optimize": "runtime.optimizing", "report": "reporting",
    "Sweep": "runtime.design_sweep", "sweep": "runtime.design_sweep", "Variable": "runtime.variables",
}  # fmt: skip


# loading a solver needs neither sympy nor the model format
__getattr__ = deferred(__name__, _PLACES)


def __dir__() -> list[str]:
    # completion shows them before they are imported
    return sorted({*globals(), *__all__})
