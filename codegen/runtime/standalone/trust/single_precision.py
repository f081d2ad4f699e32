"""Solvers of packages in single precision: what iterates, or solves equations in Python, does so in double precision.

Such a package evaluates its functions in the scalar type that it was generated with. A loop that is closed by Newton's method,
a state of rest or an eigenvalue would come out with half the digits; so these members compute with the NumPy module of the
package, which has the same statements, and round what they return.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable
from typing import Any

import numpy as np

from ..arrays import dtype_of
from ..calls.package import Package
from ..calls.targets import Opened
from .diagnosis import Diagnosis

IN_DOUBLE = (
    "assemble", "assemble_sensitivities", "assemble_gradients", "initial_state", "initial_sensitivities", "condition",
    "equilibrium", "linearize", "diagnose", "in_precision",
)  # fmt: skip
"""Members that compute in double precision."""

IN_DOUBLE_WITH_LOOPS = (
    "mass_matrix", "mass_matrix_sensitivities", "inverse_dynamics", "inverse_dynamics_sensitivities", "bias_force",
    "bias_force_sensitivities",
)  # fmt: skip
"""Those of mechanisms with loops too, which Python makes of other functions."""

MOTIONS = ("simulate", "judge", "state_rates", "state_rate_sensitivities")
"""What there is in double precision only."""


def rounded(value: Any, dtype: Any) -> Any:
    """A result with its arrays in the scalar type; objects, such as states of rest, stay in double precision."""
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return value.astype(dtype)
    if type(value) in (tuple, list):
        return type(value)(rounded(x, dtype) for x in value)
    return value


def of_unit(found: Diagnosis, dtype: Any) -> Diagnosis:
    """A diagnosis as the code is in another scalar type: rounding errors are proportional to its unit."""
    unit = float(np.finfo(dtype).eps) / 2.0
    more = unit / found.unit
    return dataclasses.replace(
        found, udot_error=found.udot_error * more, argument_error=found.argument_error * more,
        dudot_error=found.dudot_error * more, unit=unit,
    )  # fmt: skip


def check_tolerance(
    called: Callable[..., Any], name: str, given: tuple[Any, ...], named: dict[str, Any], dtype: Any
) -> None:
    """Refuse a tolerance below what the scalar type resolves; one that is left out is that of double precision."""
    try:
        bound = inspect.signature(called).bind(*given, **named).arguments
    except TypeError:  # which the call itself says better
        return
    wanted, least = bound.get("tolerance"), 10.0 * float(np.finfo(dtype).eps)
    if isinstance(wanted, (int, float)) and wanted < least:
        raise ValueError(
            f"{name}: tolerance is {wanted:g}, but the package was generated with --scalar {np.dtype(dtype)}, whose results are "
            f"rounded to {np.finfo(dtype).eps:.1e} of their size; ask for {least:.1e} or more, or generate with --scalar float64"
        )


class SinglePrecision(Package):
    """Members that compute in double precision, of solvers in another scalar type."""

    _is_double = False
    _double: SinglePrecision | None = None

    def _read(self) -> dict[str, Any]:
        found = super()._read()
        return without_scalar(found) if self._is_double else found

    def _use(self, opened: Opened) -> None:
        super()._use(opened)
        if "scalar" not in self._manifest:
            return
        for name in (*IN_DOUBLE, *(IN_DOUBLE_WITH_LOOPS if self.closure_names else ())):
            if name not in self.__dict__ and callable(getattr(type(self), name, None)):
                self.__dict__[name] = self._member(name)

    def _member(self, name: str) -> Callable[..., Any]:
        dtype = dtype_of(self._manifest)

        def call(*given: Any, **named: Any) -> Any:
            called = getattr(self._in_double(), name)
            check_tolerance(called, name, given, named, dtype)
            found = called(*given, **named)
            return of_unit(found, dtype) if isinstance(found, Diagnosis) else rounded(found, dtype)

        call.__name__, call.__doc__ = name, getattr(type(self), name).__doc__
        return call

    def _in_double(self) -> SinglePrecision:
        """This solver in double precision on NumPy, with the same partition."""
        double = self._double
        if double is None:
            double = object.__new__(type(self))
            double._is_double = True
            Package.__init__(double, self.folder, "numpy")
            self._double = double
        if double._opened.number != self._opened.number:
            double._use(double._open(self._opened.number))
        double.bad_states = self.bad_states
        return double

    def _why_not(self, name: str) -> str:
        if name not in MOTIONS or "scalar" not in self._manifest:
            return super()._why_not(name)
        return (
            f"{self.name} was generated with --scalar {self._manifest['scalar']}: it evaluates functions and their derivatives; "
            f"motions are integrated in double precision, which needs a package of --scalar float64"
        )


def without_scalar(manifest: dict[str, Any]) -> dict[str, Any]:
    """A manifest as of a package in double precision."""
    found = {n: x for n, x in manifest.items() if n != "scalar"}
    return found | {"others": [without_scalar(x) for x in found["others"]]} if "others" in found else found


__all__ = ["SinglePrecision"]
