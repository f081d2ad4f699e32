"""`Solver` of packages of this version, which may know the model that they were generated from."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from .long_texts import LongTexts
from .standalone import solver
from .standalone.trust.precision import extended

if TYPE_CHECKING:
    from ..model import Model


class Solver(solver.Solver):
    __doc__ = solver.Solver.__doc__

    def in_precision(self, digits: int = 40, model: Model | str | os.PathLike[str] | None = None) -> Any:
        """This solver in more digits; see `standalone.solver.Solver.in_precision`.

        Parameters
        ----------
        digits : int
            Decimal digits of results, at least 16.
        model : Model or path, optional
            What the package was generated from: numbers that were computed from it are computed in these digits too, from the
            doubles that the model file is read as.

        Returns
        -------
        Solver
            With ``digits``, and ``mp``, mpmath's functions in these digits.

        Raises
        ------
        ImportError
            mpmath is not installed.
        """
        return extended(self, digits, None if model is None else LongTexts(model, self._manifest, digits))
