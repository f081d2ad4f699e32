"""A torque on a body."""

from __future__ import annotations

from collections.abc import Sequence

from .element import Element, Law, Wrench


class TorqueLaw(Law):
    """The components along axes of the ground, or of the body."""

    def wrenches(self, e: Element) -> Sequence[Wrench]:
        n = e.coefficients("value")
        on = e.ends[0]
        return (Wrench(torque=on.from_face(n), in_link=True) if on.is_face else Wrench(torque=n),)
