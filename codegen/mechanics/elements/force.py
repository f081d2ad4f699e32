"""A force on a body, through one of its points."""

from __future__ import annotations

from collections.abc import Sequence

from .element import Element, Law, Wrench


class ForceLaw(Law):
    """The components along axes of the ground, or of the body."""

    def wrenches(self, e: Element) -> Sequence[Wrench]:
        f = e.coefficients("value")
        on = e.ends[0]
        return (Wrench(on.from_face(f), in_link=True) if on.is_face else Wrench(f),)
