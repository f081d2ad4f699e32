"""Hessians of functionals with respect to an optimiser's variables, and their products with directions."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..runtime.standalone.arrays import Array
from ..runtime.standalone.motion.functionals import Functional
from .variables import Variables

KEPT = 8
"""Number of points whose Hessians are kept."""

WHOLE = 32
"""Largest number of variables for which the whole Hessian at a point is computed and kept."""


class Curvatures:
    """Hessians of functionals of a motion with respect to an optimiser's x.

    Parameters
    ----------
    functionals : list of functional
        The functionals of an objective; the list grows when a constraint is added to the objective.
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
        self._known: OrderedDict[bytes, Array] = OrderedDict()
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
        key, every = x.tobytes(), range(len(self._functionals))
        if len(self._known.get(key, ())) < len(every):  # constraints may have been added since
            # an optimiser with constraints needs the Hessians of all functionals at a point
            self._known[key] = self._computed(x, np.eye(n), every)
            while len(self._known) > KEPT:
                self._known.popitem(last=False)
        found: Array = direction @ self._known[key][list(which)]
        return found

    def _computed(self, x: Array, directions: Array, which: Sequence[int]) -> Array:
        """Products (len(which), r, n) of Hessians with directions (r, n)."""
        v = self._variables
        check_initial_state(v, x)
        wanted = [self._functionals[i] for i in which]
        self.motions += 1
        judged = self._solver.judge(
            self._span, wanted, **v.motion(x), wrt=v.names, hessian=directions * v.scale, **self._options
        )
        found: Array = judged.hessian_products * v.scale
        return found


def check_initial_state(variables: Variables, x: Array) -> None:
    """Refuses initial states with second derivatives that dq0 and du0 do not contain.

    Raises
    ------
    ValueError
    """
    solver, v = variables.solver, variables
    by_parameters = [place.at for place in v._places if place.of == "p"]
    by_state = v._q or v._u or any(place.of in ("q", "u") for place in v._places)
    if not by_parameters or not by_state:
        return
    if "initial_at_rest" in solver._manifest:
        raise ValueError(
            "hessp: the model's initial state is an equilibrium, and q, u or variables replace a part of it; use "
            "the model's initial state, or give q and u of all independent coordinates and speeds"
        )
    if not solver._has("initial_sensitivities"):
        return
    dp = np.zeros((len(by_parameters), solver.np))
    for row, at in enumerate(by_parameters):
        dp[row, at] = 1.0
    p = v.motion(x, derivatives=False)["p"]
    for of, slopes in solver._motions.initial_curvature(p, dp).items():
        names, independent = (
            (solver.coordinate_names, solver.independent_names) if of == "q"
            else (solver.speed_names, solver.independent_speed_names)
        )  # fmt: skip
        known = {*(v._q if of == "q" else v._u), *(names[place.at] for place in v._places if place.of == of)}
        for i, name in enumerate(names):
            if name in independent and name not in known and slopes[:, i].any():
                raise ValueError(
                    f"hessp: the initial value of {name} is a nonlinear formula of variables, but q, u or variables replace "
                    f"other initial values, which permits only linear formulas. Give {name} in {of}, or make it a variable"
                )


__all__ = ["Curvatures", "check_initial_state"]
