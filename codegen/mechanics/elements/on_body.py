"""A force on a body through one of its points, or a torque on a body."""

from __future__ import annotations

from collections.abc import Sequence

from .element import Element, Law, Wrench


class OnBodyLaw(Law):
    """A force or a torque (`acts`), with components along the axes of the ground or of the body."""

    def __init__(self, acts: str):
        self.acts = acts

    def wrenches(self, e: Element) -> Sequence[Wrench]:
        value, on = e.coefficients("value"), e.ends[0]
        own = on.from_face(value) if on.is_face else value
        force, torque = (own if self.acts == name else None for name in ("force", "torque"))
        return (Wrench(force, torque, in_link=on.is_face),)
