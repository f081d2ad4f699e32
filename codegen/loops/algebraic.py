"""Conditions given as equations: couplings of coordinates, and points on surfaces."""

from __future__ import annotations

import numpy as np

from ..model.expressions import functions_for
from ..model.surfaces import COORDINATES, SurfaceFunction
from ..model.vectors import Array
from ..records import dataclass

LEAST_GRADIENT = 1e-200
"""Added to the squared length of a gradient, so that a vanishing gradient causes no division by zero."""

ON_ARRAYS = functions_for(np)
"""The functions of the grammar, evaluated on arrays."""


@dataclass(frozen=True, slots=True)
class Coupled:
    """A coupling of coordinates: ``sum of factor q - offset = 0``.

    Attributes
    ----------
    bodies : list of int
        Whose joints' coordinates they are, that which the file gives by the others first.
    speeds, coordinates : (n,) array
        Their rates, and where they stand in q.
    factors : (n,) array
    offset : float
    """

    bodies: list[int]
    speeds: Array
    coordinates: Array
    factors: Array
    offset: float

    def open(self, q: Array) -> Array:
        """Residuals ``(S,)`` of the coupling at coordinates ``(S, nq + 1)``."""
        missed: Array = q[:, self.coordinates] @ self.factors - self.offset
        return missed


@dataclass(frozen=True, slots=True)
class Surfaced:
    """A condition on a point: functions of its position in the start face that are zero.

    Attributes
    ----------
    functions : tuple of SurfaceFunction
        One a condition.
    parameters : dict of str to float64
        Numpy's, so that nothing is raised where there is no value.
    """

    functions: tuple[SurfaceFunction, ...]
    parameters: dict[str, np.float64]

    @np.errstate(all="ignore")
    def at(self, place: Array) -> tuple[Array, Array]:
        """Distances of points ``(S, 3)`` in the start face from the surfaces, m, and the normals there.

        Returns
        -------
        distance : (S, m) array
            To first order: the functions over the size of their gradients; 1 where they have no value.
        normal : (S, m, 3) array
            The gradients in unit length; zero where they vanish or have no value.
        """
        values = {**self.parameters, **dict(zip(COORDINATES, place.T, strict=True))}
        distance, normal = np.empty((len(place), len(self.functions))), np.empty((len(place), len(self.functions), 3))
        for i, f in enumerate(self.functions):
            for column, e in zip(normal[:, i].T, f.gradient, strict=True):
                column[:] = e.evaluate(values, ON_ARRAYS)
            size = np.sqrt(np.sum(normal[:, i] ** 2, axis=-1) + LEAST_GRADIENT)
            normal[:, i] /= size[:, None]
            distance[:, i] = f.value.evaluate(values, ON_ARRAYS) / size
        known = np.isfinite(distance) & np.isfinite(normal).all(axis=-1)
        return np.where(known, distance, 1.0), np.where(known[..., None], normal, 0.0)
