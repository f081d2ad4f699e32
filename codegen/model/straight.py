"""Lines of constant direction between two points.

No joint that carries a point rotates, and the joints that carry only one of the points slide along one direction.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Final

from .axes import Vector, coordinate_axis, signed_base
from .entries import ZERO
from .expressions import Expression
from .forces import ForceElement
from .grammar import Number, Tree
from .members import Body
from .places import GROUND, Face, Point

_ROUNDING: Final = 2.0**-50
"""Relative difference up to which two coordinates (m) count as equal, such as 0.1 + 0.2 and 0.3."""


def signed_length(
    bodies: Sequence[Body], prescribed: Collection[str], element: ForceElement
) -> tuple[Tree, tuple[Number, Number, Number]] | None:
    """Signed length and direction of the line between the ends of a force element, if the direction is constant; otherwise None.

    The length is zero when the ends coincide, and changes its sign when the ends pass each other. The direction is an
    axis of the ground frame, or three numbers, not normalised.

    Parameters
    ----------
    bodies : sequence of Body
        Bodies of a model without loops.
    prescribed : collection of str
        Names of prescribed coordinates.
    element : ForceElement
    """
    ends = [end for end in element.ends if isinstance(end, Point) and not isinstance(end, Face)]
    if len(ends) != 2 or len(element.ends) != 2:
        return None
    places = [_place(bodies, prescribed, end) for end in ends]
    if places[0] is None or places[1] is None:
        return None
    (a, slides), (b, others) = places[0], places[1]
    moving = [(name, slides[name], -1) for name in slides if name not in others]
    moving += [(name, others[name], 1) for name in others if name not in slides]
    direction = _direction(moving[0][1]) if moving else None
    if direction is None:
        return None
    unit = [float(v) / math.hypot(*direction) for v in direction]
    apart = [ZERO if _is_same(x, y) else y - x for x, y in zip(a, b, strict=True)]
    length: Expression = sum((x * e for x, e in zip(apart, unit, strict=True)), ZERO)
    for name, axis, sign in moving:
        if not _are_parallel(axis, unit, 1.0):
            return None
        q = Expression(("name", f"q.{name}"))
        along = sign * sum(float(x.value) * e for x, e in zip(axis, unit, strict=True))
        length = length + q if along > 0 else length - q
    return (length.tree, direction) if _are_parallel(apart, unit, _size(a) + _size(b)) else None


def _place(
    bodies: Sequence[Body], prescribed: Collection[str], point: Point
) -> tuple[list[Expression], dict[str, Vector]] | None:
    """Position of a point at zero coordinates, and the axes of the prismatic joints that carry it; None if a joint may rotate."""
    found: list[Expression] = [*point.at]
    slides: dict[str, Vector] = {}
    k = point.body
    while k != GROUND:
        body = bodies[k]
        joint = body.joint
        if joint.rotation or joint.type not in ("prismatic", "fixed") or body.name in prescribed:
            return None
        found = [a + b for a, b in zip(joint.at, found, strict=True)]
        if joint.type == "prismatic":
            (slides[body.name],) = joint.axes
        k = body.parent
    return found, slides


def _direction(axis: Vector) -> tuple[Number, Number, Number] | None:
    """The numerical components of an axis as the file writes them; an axis along one of the ground's becomes a base
    vector."""
    if not all(a.is_number for a in axis):
        return None
    base = coordinate_axis(axis)
    x, y, z = axis if base is None else signed_base(base[0])
    return x.value, y.value, z.value


def _are_parallel(vector: Sequence[Expression], unit: Sequence[float], size: float) -> bool:
    """Whether a vector is parallel to a direction, up to rounding of numbers of a given size."""
    if all(x.is_number for x in vector):
        values = [float(x.value) for x in vector]
        along = sum(x * e for x, e in zip(values, unit, strict=True))
        size = max(size, math.hypot(*values))
        return all(abs(x - along * e) <= _ROUNDING * size for x, e in zip(values, unit, strict=True))
    return all(x is ZERO or e == 1 for x, e in zip(vector, unit, strict=True))


def _is_same(a: Expression, b: Expression) -> bool:
    """Whether two coordinates are equal up to rounding."""
    if not (a.is_number and b.is_number):
        return b - a is ZERO
    return bool(abs(b.value - a.value) <= _ROUNDING * max(abs(a.value), abs(b.value)))


def _size(place: Sequence[Expression]) -> float:
    return max(abs(float(x.value)) for x in place if x.is_number) if any(x.is_number for x in place) else 0.0
