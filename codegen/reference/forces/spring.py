"""A spring and damper between two points."""

from __future__ import annotations

from collections.abc import Sequence

from ...model.forces import Spring
from ..pairs import Pair, Pairs
from .law import End, Law, Wrench, line


class SpringLaw(Law[Spring]):
    """A tension k (d - d_0) + c d' along r, which leads from the start to the end and is d long; energy k (d - d_0)^2 / 2.

    Where the points coincide the force has no direction; without damping and free length it is k r all the same.
    """

    def wrenches(self, element: Spring, pairs: Pairs, ends: Sequence[End]) -> Sequence[Wrench]:
        start, end = ends
        k, c, free = (pairs.expression(e) for e in element.coefficients)
        r = end.x - start.x
        if self._is_linear(element, pairs, r):
            pull = r * k
        else:
            along, d = line(element, pairs, ends)
            pull = along * (k * (d - free) + c * pairs.dot(along, end.v - start.v))
        return Wrench(pull), Wrench(-pull)

    def energy(self, element: Spring, pairs: Pairs, ends: Sequence[End]) -> Pair:
        start, end = ends
        k, _, free = (pairs.expression(e) for e in element.coefficients)
        r, two = end.x - start.x, pairs.number(2)
        if self._is_linear(element, pairs, r):
            return pairs.dot(r, r) * k / two
        stretch = line(element, pairs, ends)[1] - free
        return k * stretch * stretch / two

    @staticmethod
    def _is_linear(element: Spring, pairs: Pairs, r: Pair) -> bool:
        """Whether the points coincide and the force is k r."""
        zero = all(not e.names and e.value == 0 for e in (element.damping, element.free_length))
        return zero and bool(pairs.dot(r, r).value == 0)
