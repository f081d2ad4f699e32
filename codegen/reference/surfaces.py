"""Functions that vanish at the position of a point, with their derivatives, for conditions on points."""

from __future__ import annotations

from dataclasses import dataclass

from ..model.surfaces import COORDINATES, SurfaceFunction
from .pairs import Pair, Pairs


@dataclass(slots=True)
class SurfaceAt:
    """A function of a point's position, evaluated at a position ``(3, 1)``.

    Attributes
    ----------
    value : Pair
        (1, 1).
    gradient : Pair
        (3, 1).
    hessian : Pair
        (3, 3).
    """

    value: Pair
    gradient: Pair
    hessian: Pair


def surface_at(pairs: Pairs, function: SurfaceFunction, place: Pair) -> SurfaceAt:
    """A function, its gradient and its second derivatives."""
    there = at(pairs, place)
    xx, yy, zz, xy, xz, yz = (there.expression(e) for e in function.hessian)
    return SurfaceAt(
        there.matrix([[there.expression(function.value)]]),
        there.vector(function.gradient),
        there.matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
    )


def at(pairs: Pairs, place: Pair) -> Pairs:
    """Pairs whose expressions may contain the coordinates of a point, which is at `place`."""
    known = {name: place[i, 0] for i, name in enumerate(COORDINATES)}
    return Pairs(pairs.arithmetic, pairs.k, {**pairs.environment, **known})
