"""Functions of a solver in CasADi, with exact first and second derivatives. CasADi itself is the extra `casadi`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..deferred import deferred

if TYPE_CHECKING:
    from .exporting import ExportedCasadi, export_casadi
    from .functions import function, ode, step
    from .optimal_control import Collocation, collocation
    from .optimum import NotSolvedError, Optimum

__all__ = [
    "Collocation",
    "ExportedCasadi",
    "NotSolvedError",
    "Optimum",
    "collocation",
    "export_casadi",
    "function",
    "ode",
    "step",
]

_PLACES = {
    "collocation": "optimal_control", "Collocation": "optimal_control", "Optimum": "optimum", "NotSolvedError": "optimum",
    "ExportedCasadi": "exporting", "export_casadi": "exporting", "function": "functions", "ode": "functions",
    "step": "functions",
}  # fmt: skip

__getattr__ = deferred(__name__, _PLACES)
