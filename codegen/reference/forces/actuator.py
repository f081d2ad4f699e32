"""A force along the line between two points."""

from __future__ import annotations

from collections.abc import Sequence

from ...model.forces import Actuator
from ..pairs import Pairs
from .law import End, Law, Wrench


class ActuatorLaw(Law[Actuator]):
    """The force times the unit vector from the start to the end acts on the end, the opposite on the start."""

    def wrenches(self, element: Actuator, pairs: Pairs, ends: Sequence[End]) -> Sequence[Wrench]:
        start, end = ends
        r = end.x - start.x
        if pairs.dot(r, r).value == 0:
            raise ValueError(f"actuator {element.name}: its two points coincide, so its force has no direction")
        push = pairs.unit(r) * pairs.expression(element.force)
        return Wrench(-push), Wrench(push)
