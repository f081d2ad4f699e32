"""`Solver` of packages of this version, which may know the model that they were generated from."""

from __future__ import annotations

from typing import Any

from .extended_modules import ExtendedModules
from .standalone import solver


class Solver(solver.Solver):
    __doc__ = solver.Solver.__doc__

    def _extended_modules(self, model: Any, digits: int) -> ExtendedModules:
        return ExtendedModules(model, self._manifest, digits)
