"""Lines between points that keep one direction: those of bodies that only slide, all along the same axis of the ground."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, Protocol

from .axes import Vector, coordinate_axis
from .entries import ZERO
from .expressions import Expression
from .forces import ForceElement
from .grammar import Tree
from .places import GROUND, Face, Point


class Carried(Protocol):
    """What is asked of a body: see `model.Body`."""

    @property
    def name(self) -> str: ...
    @property
    def parent(self) -> int: ...
    @property
    def joint(self) -> Any: ...


def signed_length(bodies: Sequence[Carried], prescribed: Collection[str], element: ForceElement) -> Tree | None:
    """The one component of the line between the ends of a force element that is not zero in all states, if there is but one.

    Where it is zero, the ends coincide, and the line turns over.

    Parameters
    ----------
    bodies : sequence of Body
        Of a model without loops.
    prescribed : collection of str
        Coordinates that are prescribed.
    element : ForceElement
    """
    ends = [end for end in element.ends if isinstance(end, Point) and not isinstance(end, Face)]
    if len(ends) != 2 or len(element.ends) != 2:
        return None
    places = [_place(bodies, prescribed, end) for end in ends]
    if places[0] is None or places[1] is None:
        return None
    moving = [e for a, b in zip(places[0], places[1], strict=True) if (e := b - a) is not ZERO]
    if len(moving) != 1 or not any(n.startswith("q.") for n in moving[0].names):
        return None
    return moving[0].tree


def _place(bodies: Sequence[Carried], prescribed: Collection[str], point: Point) -> Vector | None:
    """Where a point is whose body is carried by slides along the ground's axes; None where something may turn."""
    found = [*point.at]
    k = point.body
    while k != GROUND:
        body = bodies[k]
        joint = body.joint
        if joint.rotation or joint.type not in ("prismatic", "fixed") or body.name in prescribed:
            return None
        found = [a + b for a, b in zip(joint.at, found, strict=True)]
        if joint.type == "prismatic":
            along = coordinate_axis(_only(joint.axes))
            if along is None:
                return None
            i, sign = along
            q = Expression(("name", f"q.{body.name}"))
            found[i] = found[i] + q if sign > 0 else found[i] - q
        k = body.parent
    return found[0], found[1], found[2]


def _only(axes: tuple[Vector, ...]) -> Vector:
    (axis,) = axes
    return axis
