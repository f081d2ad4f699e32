"""Centre of mass along an axis."""

from __future__ import annotations

from functools import reduce
from operator import add

from ...model.outputs import Output
from ..pairs import Pair
from .seen import Moving, Seen, along


def center(bodies: list[Moving], seen: Seen) -> Pair:
    """sum m x / sum m, (3, 1)."""
    one = seen.pairs.number(1)
    return reduce(add, (b.x * b.mass for b in bodies)) * (one / reduce(add, (b.mass for b in bodies)))


def center_of_mass(output: Output, seen: Seen) -> Pair:
    """n . c"""
    known = seen.bodies()
    return along(output, seen, center([known[k] for k in output.bodies or range(len(known))], seen))
