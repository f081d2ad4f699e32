"""Values of functionals of a motion as a function of parameters, for libraries that differentiate functions."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

FIXED = ("wrt", "p", "dq0", "du0")
"""Options of `Solver.judge` that belong to the variables."""


class JudgedMotion:
    """Values and gradients of functionals by the values of parameters.

    Attributes
    ----------
    names : tuple of str
        The parameters, in the order of the function's argument.
    count : int
        Number of functionals.
    """

    def __init__(
        self, solver: Any, t: Any, functionals: Any, wrt: str | Sequence[str], options: Mapping[str, Any]
    ):  # fmt: skip
        if not hasattr(solver, "judge"):
            raise TypeError(f"expected a solver with judge, not {type(solver).__name__}")
        self.solver, self.t = solver, t
        self.functionals = list(functionals) if isinstance(functionals, (list, tuple)) else [functionals]
        self.names = (wrt,) if isinstance(wrt, str) else tuple(wrt)
        self.count, self.options = len(self.functionals), dict(options)
        known = list(solver.parameter_names)
        for name in self.names:
            if name not in known:
                near = difflib.get_close_matches(str(name), known, 1)
                hint = f"; did you mean {near[0]!r}?" if near else ""
                raise ValueError(
                    f"wrt: {name!r} is not a parameter of {solver.name}; allowed are {', '.join(known)}{hint}"
                )
        if not self.names:
            raise ValueError(f"wrt is empty; name at least one parameter of {', '.join(known)}")
        for name in FIXED:
            if name in options:
                raise TypeError(
                    f"judge: {name} is not an option here; parameters in wrt are the argument of the function"
                )

    def check(self, shape: tuple[int, ...], kind: str) -> None:
        """Raises if an argument does not hold a number for each parameter."""
        if shape != (len(self.names),):
            raise ValueError(
                f"judge of {self.solver.name}: x has shape {shape}, expected ({len(self.names)},): {', '.join(self.names)}"
            )
        if kind != "float64":
            raise TypeError(f"judge of {self.solver.name}: x has type {kind}, expected float64")

    def values(self, x: Any) -> Any:
        """Values (m,)."""
        return self._run(x, ()).values

    def both(self, x: Any) -> tuple[Any, Any]:
        """Values (m,) and gradients (m, k)."""
        found = self._run(x, self.names)
        return found.values, found.gradients

    def _run(self, x: Any, wrt: Sequence[str]) -> Any:
        p = dict(zip(self.names, np.asarray(x, float).tolist(), strict=True))
        return self.solver.judge(self.t, self.functionals, p=p, wrt=wrt, **self.options)

    def no_second(self) -> str:
        return f"judge of {self.solver.name}: no second derivatives; differentiate once"
