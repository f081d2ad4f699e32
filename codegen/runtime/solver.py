"""`Solver` of packages of this version, which may know the model that they were generated from."""

from __future__ import annotations

from typing import Any

from .long_texts import LongTexts
from .standalone import solver


class Solver(solver.Solver):
    __doc__ = solver.Solver.__doc__

    def _long_texts(self, model: Any, digits: int) -> LongTexts:
        return LongTexts(model, self._manifest, digits)
