"""`Solver` for packages of this version; its `in_precision` accepts the package's model."""

from __future__ import annotations

from typing import Any

from .extended_modules import ExtendedModules
from .standalone import solver


class Solver(solver.Solver):
    __doc__ = solver.Solver.__doc__

    def _extended_modules(self, model: Any, digits: int) -> ExtendedModules:
        return ExtendedModules(model, self._manifest, digits)
