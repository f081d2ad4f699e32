"""A force along the line between two points."""

from __future__ import annotations

from collections.abc import Sequence

from .element import Element, Law, Wrench


class ActuatorLaw(Law):
    """A force along the line that drives the ends apart."""

    def wrenches(self, e: Element) -> Sequence[Wrench]:
        line, length = e.line()
        push = e.let("push", e.coefficient("force") / length)
        force = e.vector("force", [push * c for c in line])
        return Wrench([-c for c in force]), Wrench(force)
