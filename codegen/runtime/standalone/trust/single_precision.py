"""Solvers of packages in single precision: iterative methods and linear algebra in Python use double precision.

Such a package evaluates its functions in the scalar type with which it was generated. Closed loops, equilibria and eigenvalues
would have only half the digits. The methods for these therefore compute with the package's NumPy module, which has the same
statements, and round the results.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable
from typing import Any

import numpy as np

from ..arrays import dtype_of
from ..calls.package import Package
from ..calls.results import places, put
from ..files.manifest import read_manifest
from .diagnosis import Diagnosis

IN_DOUBLE = (
    "assemble", "assemble_sensitivities", "assemble_gradients", "initial_state", "initial_sensitivities", "condition",
    "equilibrium", "linearize", "ode", "diagnose", "in_precision",
)  # fmt: skip
"""Methods that compute in double precision for every package."""

IN_DOUBLE_WITH_LOOPS = (
    "mass_matrix", "mass_matrix_sensitivities", "inverse_dynamics", "inverse_dynamics_sensitivities", "bias_force",
    "bias_force_sensitivities",
)  # fmt: skip
"""Methods that combine functions in Python for mechanisms with loops, and then compute in double precision."""


def rounded(value: Any, dtype: Any) -> Any:
    """A result with its arrays in the scalar type; objects, such as equilibria, remain in double precision."""
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return value.astype(dtype)
    if type(value) in (tuple, list):
        return type(value)(rounded(x, dtype) for x in value)
    return value


def placed(found: Any, out: Any, dtype: Any) -> Any:
    """Copies a value, or a value and its derivative, to the caller's arrays of the scalar type."""
    single = isinstance(found, np.ndarray)
    results = [found] if single else [*found]
    shapes = [x.shape for x in results]
    taken = put(results, places([out] if single else out, ["value", "derivative"][: len(results)], shapes, dtype))
    return taken[0] if single else tuple(taken)


def of_unit(found: Diagnosis, dtype: Any) -> Diagnosis:
    """A diagnosis for code in another scalar type, whose rounding errors are proportional to its unit of rounding."""
    unit = float(np.finfo(dtype).eps) / 2.0
    more = unit / found.unit
    return dataclasses.replace(
        found, udot_error=found.udot_error * more, argument_error=found.argument_error * more,
        dudot_error=found.dudot_error * more, unit=unit,
    )  # fmt: skip


def check_tolerance(
    called: Callable[..., Any], name: str, given: tuple[Any, ...], named: dict[str, Any], dtype: Any
) -> None:
    """Raises an error for a tolerance below the resolution of the scalar type; default tolerances are for doubles."""
    try:
        bound = inspect.signature(called).bind(*given, **named).arguments
    except TypeError:  # calling the method raises an error with a better message
        return
    wanted, least = bound.get("tolerance"), 10.0 * float(np.finfo(dtype).eps)
    if isinstance(wanted, (int, float)) and wanted < least:
        raise ValueError(
            f"{name}: tolerance is {wanted:g}, but the package was generated with --scalar {np.dtype(dtype)}, whose results are "
            f"rounded to {np.finfo(dtype).eps:.1e} of their size; use {least:.1e} or more, or generate with --scalar float64"
        )


class InDouble:
    """Methods of a solver that compute in double precision.

    Parameters
    ----------
    solver : Package
        A solver in another scalar type.
    """

    def __init__(self, solver: Package):
        self.solver, self.dtype = solver, dtype_of(solver._manifest)

    def put_in_place(self) -> None:
        """Replaces methods of the solver by those that compute in double precision."""
        for name in (*IN_DOUBLE, *(IN_DOUBLE_WITH_LOOPS if self.solver.closure_names else ())):
            if callable(getattr(type(self.solver), name, None)):
                self.solver.__dict__[name] = self._member(name)

    def _member(self, name: str) -> Callable[..., Any]:
        @functools.wraps(getattr(self.solver, name))
        def call(*given: Any, out: Any = None, **named: Any) -> Any:
            called = getattr(self.double(), name)
            check_tolerance(called, name, given, named, self.dtype)
            found = called(*given, **named)
            if isinstance(found, Diagnosis):
                return of_unit(found, self.dtype)
            found = rounded(found, self.dtype)
            return found if out is None else placed(found, out, self.dtype)

        return call

    @functools.cached_property
    def _double(self) -> Package:
        double = object.__new__(type(self.solver))
        double.__dict__["_read"] = lambda: without_scalar(read_manifest(self.solver.folder))
        Package.__init__(double, self.solver.folder, "numpy")
        return double

    def double(self) -> Package:
        """The solver in double precision on NumPy, with the same partition."""
        double, number = self._double, self.solver._opened.number
        if double._opened.number != number:
            double._use(double._open(number))
        double.bad_states = self.solver.bad_states
        return double


def without_scalar(manifest: dict[str, Any]) -> dict[str, Any]:
    """The manifest as if the package had been generated in double precision."""
    found = {n: x for n, x in manifest.items() if n != "scalar"}
    return found | {"others": [without_scalar(x) for x in found["others"]]} if "others" in found else found
