"""Models in sympy: their equations of motion, and the statements that a solver computes.

Sympy is imported when one of these names is first read. No other step from a model to a solver imports it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..deferred import deferred

if TYPE_CHECKING:
    from ..model.sympy_output import to_sympy
    from .errors import SymbolicError, TooLargeError
    from .motion import Equations, equations
    from .recursion import Recursion, statements

__all__ = ["Equations", "Recursion", "SymbolicError", "TooLargeError", "equations", "statements", "to_sympy"]

_PLACES = {
    "Equations": "motion", "equations": "motion", "SymbolicError": "errors", "TooLargeError": "errors",
    "Recursion": "recursion", "statements": "recursion",
    "to_sympy": ".model.sympy_output",
}  # fmt: skip

__getattr__ = deferred(__name__, _PLACES)
