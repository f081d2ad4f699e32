"""Hessian products of functionals by an optimiser's variables."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..runtime.standalone.arrays import Array
from ..runtime.standalone.motion.functionals import AtEvent, Functional
from .variables import Variables

KEPT = 8
"""Number of points whose Hessians are kept."""

WHOLE = 32
"""Largest number of variables for which the whole Hessian at a point is computed and kept."""


class Curvatures:
    """Hessians of functionals of a motion by an optimiser's x.

    Parameters
    ----------
    functionals : list of functional
        The list of an objective, to which constraints may be added later.
    options : dict
        Options of `Solver.judge`.

    Attributes
    ----------
    motions : int
        Number of motions that were run.
    """

    def __init__(
        self, solver: Any, variables: Variables, start: float, end: float, functionals: Sequence[Functional],
        options: dict[str, Any],
    ):  # fmt: skip
        self._solver, self._variables, self._span, self._functionals = solver, variables, (start, end), functionals
        self._options = {name: value for name, value in options.items() if name != "method"}
        self._known: OrderedDict[tuple[bytes, tuple[int, ...]], Array] = OrderedDict()
        self.motions = 0

    def products(self, x: ArrayLike, v: ArrayLike, which: Sequence[int]) -> Array:
        """Products (len(which), n) of Hessians of functionals with a direction v (n,).

        Raises
        ------
        ValueError
        SimulationError, AssemblyError, SingularJointError
            The motion fails.
        """
        x, direction, n = np.array(x, float), np.asarray(v, float), len(self._variables)
        if direction.shape != (n,) or not np.isfinite(direction).all():
            raise ValueError(f"hessp: the direction is {v!r}, expected {n} finite numbers")
        if n > WHOLE:
            return self._computed(x, direction[None], which)[:, 0]
        together = self._together(which)
        key = x.tobytes(), together
        if key not in self._known:
            self._known[key] = self._computed(x, np.eye(n), together)
            while len(self._known) > KEPT:
                self._known.popitem(last=False)
        found: Array = direction @ self._known[key][[together.index(i) for i in which]]
        return found

    def _together(self, which: Sequence[int]) -> tuple[int, ...]:
        """Functionals whose Hessians are computed at once, because an optimiser with constraints needs them all at a point."""
        every = range(len(self._functionals))
        return tuple(i for i in every if i in which or not isinstance(self._functionals[i], AtEvent))

    def _computed(self, x: Array, directions: Array, which: Sequence[int]) -> Array:
        """Products (len(which), r, n) of Hessians with directions (r, n)."""
        v = self._variables
        check_initial_state(v)
        wanted = [self._functionals[i] for i in which]
        self.motions += 1
        judged = self._solver.judge(
            self._span, wanted, **v.motion(x), wrt=v.names, hessian=directions * v.scale, **self._options
        )
        found: Array = judged.hessian_products * v.scale
        return found


def check_initial_state(variables: Variables) -> None:
    """Refuses initial states with second derivatives that dq0 and du0 do not contain.

    Raises
    ------
    ValueError
    """
    solver = variables.solver
    formulas = "initial_at_rest" in solver._manifest or solver._has("initial_sensitivities")
    by_parameters = any(place.of == "p" for place in variables._places)
    by_state = variables._q or variables._u or any(place.of in ("q", "u") for place in variables._places)
    if formulas and by_parameters and by_state:
        raise ValueError(
            "hessp: initial values of the model are formulas of parameters, and q, u or variables replace some of them; "
            "allowed are only the model's initial values, or a model whose initial values are numbers"
        )


__all__ = ["Curvatures"]
