"""Models in sympy: their equations of motion, and the statements that are computed.

Sympy is imported when one of these names is first read, and by nothing else of ordernm on the way from a model to a solver.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..deferred import deferred

if TYPE_CHECKING:
    from .errors import SymbolicError, TooLargeError
    from .motion import Equations, equations

__all__ = ["Equations", "SymbolicError", "TooLargeError", "equations"]

_PLACES = {
    "Equations": "motion", "equations": "motion", "SymbolicError": "errors", "TooLargeError": "errors",
}  # fmt: skip

__getattr__ = deferred(__name__, _PLACES)
