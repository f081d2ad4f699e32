"""A force on a body, through one of its points."""

from __future__ import annotations

from collections.abc import Sequence

from ...model.forces import Force
from ..pairs import Pairs
from .law import End, Law, Wrench


class ForceLaw(Law[Force]):
    """The components as they are; those along axes of the body are turned into the ground frame."""

    def wrenches(self, element: Force, pairs: Pairs, ends: Sequence[End]) -> Sequence[Wrench]:
        f = pairs.vector(element.value)
        return (Wrench(ends[0].R @ f if element.axes == "body" else f),)
