"""Results of motions that were run for an optimiser."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..runtime.standalone.arrays import Array

Combine = Callable[[Array], tuple[float, ArrayLike]]
"""A function of the functionals' values (m,) that returns a number and its derivatives (m,) with respect to them."""


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
        Largest magnitude of an entry of the gradient with respect to x.
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
    """Results at an x: the value, the functionals (m,), and their gradients (n,) and (m, n) with respect to x; or an
    error."""

    value: float
    gradient: Array
    functionals: Array
    gradients: Array
    error: Exception | None = None


__all__ = ["Combine", "Evaluation", "Point"]
