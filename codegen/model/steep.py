"""Functions that may change steeply within a small part of a motion, such as ``tanh(u.x/w)`` for a small ``w``.

An integrator must resolve such layers more closely for derivatives of a motion than for the motion itself.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from .expressions import Expression
from .grammar import Tree
from .switches import varies_in_motion
from .trees import nodes

if TYPE_CHECKING:
    from .model import Model

EVEN_PACED = ("sin", "cos", "abs", "sign", "at_least")
"""Functions that change no faster than their arguments while their branch is fixed."""

HIGHEST = 3
"""Highest power of a varying number that does not count as steep."""


def has_steep_functions(model: Model) -> bool:
    """Whether forces or prescribed motion contain functions that may change steeply during a motion."""
    varies = varies_in_motion(model.inputs)
    trees = [x.value.tree for x in model.prescribed]
    trees += [e.tree for force in model.elements for e in force.coefficients]
    return any(_is_steep(part, varies) for tree in trees for part in nodes(tree))


def _is_steep(tree: Tree, varies: Callable[[str], bool]) -> bool:
    """Whether a function of a varying number may change steeply: most functions, quotients, and high or fractional powers."""
    if tree[0] == "call":
        steep = tuple(tree[2:]) if tree[1] not in EVEN_PACED else ()
    elif tree[0] == "/":
        steep = tree[2:]
    elif tree[0] == "**":
        even = tree[2][0] == "number" and float(tree[2][1]) in range(HIGHEST + 1)
        steep = () if even else tree[1:]
    else:
        return False
    return any(varies(name) for of in steep for name in Expression(of).names)


__all__ = ["has_steep_functions"]
