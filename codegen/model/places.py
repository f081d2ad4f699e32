"""Points and frames fixed in bodies."""

from __future__ import annotations

from dataclasses import dataclass

from .axes import Vector
from .expressions import Expression

GROUND = -1
"""Index of the ground in `Body.parent` and `Point.body`."""


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """A point fixed in a body (or the ground), in body axes, m."""

    name: str
    body: int
    at: Vector


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """One side of a loop joint: a frame fixed in a body (or the ground).

    Attributes
    ----------
    body : int
        Index into `Model.bodies`, or `GROUND`.
    at : Vector
        Origin in the body frame, m.
    rotation : tuple of (Vector, Expression)
        See `Joint`.
    """

    body: int
    at: Vector
    rotation: tuple[tuple[Vector, Expression], ...] = ()
