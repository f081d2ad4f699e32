"""Results of motions that were run for an optimiser."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..runtime.standalone.arrays import Array

Combine = Callable[[Array], tuple[float, ArrayLike]]
"""A function of the functionals' values (m,) that returns a number and its derivatives by these values (m,)."""


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """A motion that was run for an optimiser.

    Attributes
    ----------
    number : int
        Number of the motion, from 1.
    x : ndarray (n,)
        The point, as the optimiser sees it.
    value : float
        Value of the objective; infinite if the motion failed.
    functionals : ndarray (m,)
        Values of the functionals of the objective, then of the constraints; NaN if the motion failed.
    gradient_norm : float
        Largest entry of the gradient by x.
    seconds : float
        Time that the motion took.
    failure : str
        Reason of the failure, empty if there was none.
    """

    number: int
    x: Array
    value: float
    functionals: Array
    gradient_norm: float
    seconds: float
    failure: str


@dataclass(slots=True, eq=False)
class Point:
    """Results at an x: the value, its gradient by x (n,), the functionals (m,) and their gradients by x (m, n); or an
    error."""

    value: float
    gradient: Array
    functionals: Array
    gradients: Array
    error: Exception | None = None


__all__ = ["Combine", "Evaluation", "Point"]
