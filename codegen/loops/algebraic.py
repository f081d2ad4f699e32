"""Loop conditions given as equations: couplings of coordinates, and points on surfaces."""

from __future__ import annotations

import numpy as np

from ..model.expressions import functions_for
from ..model.surfaces import COORDINATES, SurfaceFunction
from ..model.vectors import Array
from ..records import dataclass

LEAST_GRADIENT = 1e-200
"""Number added to the squared norm of a gradient, which prevents a division by zero where the gradient vanishes."""

ON_ARRAYS = functions_for(np)
"""The functions of the expression grammar, evaluated on arrays."""


@dataclass(frozen=True, slots=True)
class Coupled:
    """A coupling of coordinates: ``sum of factor q - offset = 0``.

    Attributes
    ----------
    bodies : list of int
        Bodies whose joints have these coordinates. The model file expresses the first one's coordinate by the others.
    speeds, coordinates : (n,) array
        Indices of the speeds in u and of the coordinates in q.
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
        residual: Array = q[:, self.coordinates] @ self.factors - self.offset
        return residual


@dataclass(frozen=True, slots=True)
class Surfaced:
    """A condition on a point: functions of its position in the start face that must be zero.

    Attributes
    ----------
    functions : tuple of SurfaceFunction
        One for each condition.
    parameters : dict of str to float64
        Values as `numpy.float64`: an invalid operation gives nan and raises nothing.
    """

    functions: tuple[SurfaceFunction, ...]
    parameters: dict[str, np.float64]

    @np.errstate(all="ignore")
    def at(self, place: Array) -> tuple[Array, Array]:
        """Signed distances in m of points ``(S, 3)`` from the surfaces, and the normals there, in the start face.

        Returns
        -------
        distance : (S, m) array
            To first order: each function divided by the norm of its gradient; 1 where this is not finite.
        normal : (S, m, 3) array
            Unit vectors along the gradients; zero where a gradient vanishes or is not finite.
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
