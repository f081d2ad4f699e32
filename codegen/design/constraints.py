"""Bounds of functionals as constraints for SciPy's optimisers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..runtime.standalone.arrays import Array
from .evaluated_points import Point

At = Callable[[ArrayLike], Point]
"""A function that returns the evaluated point at an x."""


def bounds_of(count: int, lower: ArrayLike, upper: ArrayLike) -> tuple[Array, Array]:
    """Checked bounds (count,) of `count` functionals.

    Raises
    ------
    ValueError
    """
    try:
        low, high = (np.broadcast_to(np.asarray(b, float), (count,)).copy() for b in (lower, upper))
    except ValueError:
        raise ValueError(
            f"constraint: bounds are {lower!r} and {upper!r}, expected a number, or one for each of {count} functionals"
        ) from None
    if np.isnan([low, high]).any() or (low > high).any() or np.isinf([low, high]).all(axis=0).any():
        raise ValueError(
            f"constraint: bounds are {lower!r} and {upper!r}; lower must not be above upper, "
            "and one of them must be finite"
        )
    return low, high


Curvature = Callable[[ArrayLike, Array], Array]
"""A function of x and a direction that returns products (m, n) of the functionals' Hessians with the direction."""


def nonlinear(point: At, at: slice, low: Array, high: Array, curvature: Curvature) -> Any:
    """The constraint low <= functionals <= high, as a `scipy.optimize.NonlinearConstraint`."""
    from scipy.optimize import NonlinearConstraint

    found = NonlinearConstraint(
        lambda x: point(x).functionals[at].copy(), low, high, jac=lambda x: point(x).gradients[at].copy()
    )
    found.curvature = curvature
    return found


def with_exact_hessian(constraint: Any) -> Any:
    """A copy of a constraint of `nonlinear` that gives trust-constr its exact Hessian; other constraints stay unchanged."""
    from scipy.optimize import NonlinearConstraint
    from scipy.sparse.linalg import LinearOperator

    if not hasattr(constraint, "curvature"):
        return constraint

    def hessian(x: Array, weights: Array) -> Any:
        n = len(x)
        return LinearOperator((n, n), matvec=lambda v: weights @ constraint.curvature(x, np.ravel(v)), dtype=float)

    return NonlinearConstraint(constraint.fun, constraint.lb, constraint.ub, jac=constraint.jac, hess=hessian)


def dictionaries(point: At, at: slice, low: Array, high: Array) -> list[dict[str, Any]]:
    """low <= selected functionals <= high for SLSQP: dictionaries of functions that must be zero or must not be negative."""
    places = np.arange(at.start, at.stop)
    found = []
    for kind, chosen, sign, level in (
        ("eq", low == high, 1.0, low),
        ("ineq", (low != high) & np.isfinite(low), 1.0, low),
        ("ineq", (low != high) & np.isfinite(high), -1.0, high),
    ):
        if chosen.any():
            found.append(_dictionary(point, kind, places[chosen], sign, level[chosen]))
    return found


def _dictionary(point: At, kind: str, places: Any, sign: float, level: Array) -> dict[str, Any]:
    return {
        "type": kind,
        "fun": lambda x: sign * (point(x).functionals[places] - level),
        "jac": lambda x: sign * point(x).gradients[places],
    }


__all__ = ["bounds_of", "dictionaries", "nonlinear", "with_exact_hessian"]
