"""Outputs of a model as expressions of sympy."""

from __future__ import annotations

from collections.abc import Mapping

import sympy

from .errors import SymbolicError
from .polynomials import UndecidedError
from .system import SymbolicEngine


class Outputs(dict[str, sympy.Expr]):
    """Expressions by the names of outputs; access to one without a single formula raises `SymbolicError`.

    Attributes
    ----------
    refused : dict of str to str
        Outputs that are left out, with the reason.
    """

    def __init__(self, known: Mapping[str, sympy.Expr] | None = None, refused: Mapping[str, str] | None = None) -> None:
        super().__init__(known or {})
        self.refused = dict(refused or {})

    def __missing__(self, name: str) -> sympy.Expr:
        if name in self.refused:
            raise SymbolicError(f"output {name}: {self.refused[name]}")
        raise SymbolicError(f"there is no output {name!r}; outputs are {', '.join([*self, *self.refused]) or 'none'}")

    @staticmethod
    def of(engine: SymbolicEngine) -> Outputs:
        """The outputs of the model of an engine."""
        found = Outputs()
        for output in engine.model.outputs:
            try:
                found[output.name] = engine.output(output).expression
            except UndecidedError as error:
                found.refused[output.name] = f"it has different formulas in different states ({error})"
        return found
