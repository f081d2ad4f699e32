"""A spring and damper between two points: a tension along their line."""

from __future__ import annotations

from collections.abc import Sequence

from ...program.scalar import Value
from ..spatial import dot
from .element import Element, Law, Wrench


class SpringLaw(Law):
    """A tension ``k (d - d_0) + c d'`` along the line, d its length; energy ``k (d - d_0)^2 / 2``."""

    def wrenches(self, e: Element) -> Sequence[Wrench]:
        line, length = e.line()
        start, end = (end.velocity for end in e.ends)
        along = e.along(line, length)
        rate = e.let("rate", dot(along, [end[i] - start[i] for i in range(3)]))
        stiffness, damping, free = (e.coefficient(key) for key in ("stiffness", "damping", "free_length"))
        pull = e.let("pull", stiffness * (length - free) + damping * rate)
        force = e.vector("force", [pull * c for c in along])
        return Wrench(force), Wrench([-c for c in force])

    def energy(self, e: Element) -> Value:
        _, length = e.line(directed=e.x.tangents)
        more = e.let("more", length - e.coefficient("free_length"))
        return e.let("V", e.x.half * e.coefficient("stiffness") * more * more)
