"""Momentum of all bodies along an axis."""

from __future__ import annotations

from functools import reduce
from operator import add

from ...model.outputs import Output
from ..pairs import Pair
from .center_of_mass import center
from .seen import Seen, along


def momentum(output: Output, seen: Seen) -> Pair:
    """n . sum m v, or n . sum (spin + (x - o) x m v), o the ground's origin or the centre of mass."""
    kind, about = output.choice
    bodies = list(seen.bodies())
    if kind == "linear":
        return along(output, seen, reduce(add, (b.v * b.mass for b in bodies)))
    arms = [b.x for b in bodies]
    if about == "center_of_mass":
        o = center(bodies, seen)
        arms = [x - o for x in arms]
    moments = (b.spin + seen.pairs.skew(r) @ b.v * b.mass for b, r in zip(bodies, arms, strict=True))
    return along(output, seen, reduce(add, moments))
