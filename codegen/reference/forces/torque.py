"""A torque on a body."""

from __future__ import annotations

from collections.abc import Sequence

from ...model.forces import Torque
from ..pairs import Pairs
from .law import End, Law, Wrench


class TorqueLaw(Law[Torque]):
    """The components as they are; those along axes of the body are turned into the ground frame."""

    def wrenches(self, element: Torque, pairs: Pairs, ends: Sequence[End]) -> Sequence[Wrench]:
        n = pairs.vector(element.value)
        return (Wrench(torque=ends[0].R @ n if element.axes == "body" else n),)
