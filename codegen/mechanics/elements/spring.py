"""A spring and damper between two points: a tension along their line."""

from __future__ import annotations

from collections.abc import Sequence

from ...program.scalar import Value
from ..spatial import dot
from .element import Element, Law, Wrench


class SpringLaw(Law):
    """A tension ``k (d - d_0) + c d'`` along the line, d its length; energy ``k (d - d_0)^2 / 2``.

    Without d_0, the force is smooth where the ends meet: k times the line. Its second derivatives would lose their digits
    there in a product of d and a direction. The same holds for the energy.
    """

    def wrenches(self, e: Element) -> Sequence[Wrench]:
        stiffness, damping, free = (e.coefficient(key) for key in ("stiffness", "damping", "free_length"))
        if not e.kind.first.needs_direction:
            force = e.vector("force", [stiffness * c for c in e.way()])
            return Wrench(force), Wrench([-c for c in force])
        line, length = e.line()
        start, end = (end.velocity for end in e.ends)
        along = e.along(line, length)
        rate = e.let("rate", dot(along, [end[i] - start[i] for i in range(3)]))
        pull = e.let("pull", stiffness * (length - free) + damping * rate)
        force = e.vector("force", [pull * c for c in along])
        return Wrench(force), Wrench([-c for c in force])

    def energy(self, e: Element) -> Value:
        half, stiffness = e.x.half, e.coefficient("stiffness")
        if "free_length" in e.absent:
            line = e.way()
            return e.let("V", half * stiffness * dot(line, line))
        _, length = e.line(directed=e.x.tangents)
        more = e.let("more", length - e.coefficient("free_length"))
        return e.let("V", half * stiffness * more * more)
